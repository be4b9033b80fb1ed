"""``POST /login`` and ``POST /logout``: exchange a token for an HttpOnly cookie, and delete that cookie."""

import time
from typing import Any, Final
from urllib.parse import parse_qs, quote

from fastapi import APIRouter, Request
from starlette.responses import RedirectResponse, Response

from stridelab.errors import InvalidInput
from stridelab.service.api.dependencies import AppParts
from stridelab.service.api.middleware.authentication import local_target, token_holder
from stridelab.service.api.session_cookies import COOKIE, SESSION_S, SigningKeys
from stridelab.service.api.strict_json import read_limited
from stridelab.service.auth import audit
from stridelab.service.auth.callers import UNAUTHENTICATED

router = APIRouter(tags=["session"])

FORM_LIMIT_BYTES: Final = 8_000
MAX_FIELDS: Final = 10
_FORM: Final[Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "application/x-www-form-urlencoded": {
                "schema": {
                    "type": "object",
                    "required": ["token"],
                    "properties": {"token": {"type": "string"}, "next": {"type": "string"}},
                }
            }
        },
    }
}
_REDIRECT: Final[dict[int | str, dict[str, Any]]] = {303: {"description": "Redirect to the requested page, or back."}}


@router.post(
    "/login",
    status_code=303,
    summary="Log in",
    openapi_extra=_FORM,
    responses=_REDIRECT,
    response_class=Response,
)
async def login(parts: AppParts, request: Request) -> Response:
    """Exchange a token for a cookie (HttpOnly, SameSite=strict) and redirect to `next`. For browsers."""
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "application/x-www-form-urlencoded":
        raise InvalidInput("unsupported-media-type", "This address accepts forms only; scripts send the token itself.")
    raw = await read_limited(request, FORM_LIMIT_BYTES)
    try:
        form = parse_qs(raw.decode(), max_num_fields=MAX_FIELDS)
    except ValueError as error:  # not UTF-8, or too many fields
        raise InvalidInput("malformed-request", "The body is not the form of the login page.") from error
    target = local_target(form.get("next", ["/"])[0])
    keys: SigningKeys | None = request.app.state.keys
    if keys is None:
        return RedirectResponse(target, status_code=303)
    caller = await token_holder(form.get("token", [""])[0].strip(), keys, parts.tokens)
    if caller is None or caller.token_id is None:
        audit.log_action(UNAUTHENTICATED, "refused", "login")
        return RedirectResponse(f"/login?wrong=1&next={quote(target, safe='')}", status_code=303)
    async with parts.engine.begin() as connection:
        await audit.record_action(connection, caller, "login")
    answer = RedirectResponse(target, status_code=303)
    secure = request.url.scheme == "https" or request.headers.get("x-forwarded-proto") == "https"
    answer.set_cookie(
        COOKIE,
        keys.make_cookie(time.time(), caller.token_id),
        max_age=SESSION_S,
        path="/",
        secure=secure,
        httponly=True,
        samesite="strict",
    )
    return answer


@router.post("/logout", status_code=303, summary="Log out", responses=_REDIRECT, response_class=Response)
async def logout() -> Response:
    """Delete the session cookie of this browser."""
    answer = RedirectResponse("/login", status_code=303)
    answer.delete_cookie(COOKIE, path="/", httponly=True, samesite="strict")
    return answer
