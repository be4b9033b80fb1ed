"""``POST /login`` and ``POST /logout``: a browser swaps the token for a cookie that its scripts cannot read."""

import time
from typing import Any, Final
from urllib.parse import parse_qs, quote

from fastapi import APIRouter, Request
from starlette.responses import RedirectResponse, Response

from stridelab.errors import InvalidInput
from stridelab.service.api.auth import COOKIE, SESSION_S, Keys, local_target
from stridelab.service.api.strict import read_limited

router = APIRouter(tags=["session"])

FORM_LIMIT_BYTES: Final = 8_000
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
_AWAY: Final[dict[int | str, dict[str, Any]]] = {303: {"description": "To the page that was asked for, or back."}}


@router.post(
    "/login",
    status_code=303,
    summary="Log in",
    openapi_extra=_FORM,
    responses=_AWAY,
    response_class=Response,
)
async def login(request: Request) -> Response:
    """Swap the API token for a cookie (HttpOnly, SameSite=strict); then go to `next`. For browsers."""
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "application/x-www-form-urlencoded":
        raise InvalidInput("unsupported-media-type", "This address reads a form; scripts use the token directly.")
    raw = await read_limited(request, FORM_LIMIT_BYTES)
    form = parse_qs(raw.decode("utf-8", "replace"), max_num_fields=10)
    target = local_target(form.get("next", ["/"])[0])
    keys: Keys | None = request.app.state.keys
    if keys is None:
        return RedirectResponse(target, status_code=303)
    if not keys.accepts_token(form.get("token", [""])[0].strip()):
        return RedirectResponse(f"/login?wrong=1&next={quote(target, safe='')}", status_code=303)
    answer = RedirectResponse(target, status_code=303)
    secure = request.url.scheme == "https" or request.headers.get("x-forwarded-proto") == "https"
    answer.set_cookie(
        COOKIE, keys.cookie(time.time()), max_age=SESSION_S, path="/", secure=secure, httponly=True, samesite="strict"
    )
    return answer


@router.post("/logout", status_code=303, summary="Log out", responses=_AWAY, response_class=Response)
async def logout() -> Response:
    """Forget the cookie of this browser."""
    answer = RedirectResponse("/login", status_code=303)
    answer.delete_cookie(COOKIE, path="/", httponly=True, samesite="strict")
    return answer
