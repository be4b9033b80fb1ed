"""Failures as ``application/problem+json`` (RFC 9457); the class of an error determines the HTTP status.

Exceptions of endpoints are converted by handlers of the application; middleware creates its responses directly.
"""

import http
from collections.abc import Mapping, Sequence
from typing import Any, Final

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from sqlalchemy.exc import DataError, DBAPIError, InterfaceError, OperationalError
from starlette.exceptions import HTTPException
from starlette.responses import Response

from stridelab.errors import (
    Busy,
    Conflict,
    Forbidden,
    InvalidInput,
    NotEstimable,
    NotFound,
    StorageFull,
    StridelabError,
    TooLarge,
    Unauthenticated,
    Unavailable,
    UnreadableFile,
)
from stridelab.schemas.base import FaultItem, Problem

log = structlog.get_logger(__name__)

MEDIA_TYPE: Final = "application/problem+json"

MAX_FAULTS: Final = 50
"""Maximum number of faults listed in one problem."""
_MAX_CHARACTERS: Final = 300
_MAX_NAME_CHARACTERS: Final = 60

STATUS: Final[Mapping[type[StridelabError], int]] = {
    UnreadableFile: 422,
    InvalidInput: 422,
    NotEstimable: 422,
    NotFound: 404,
    Conflict: 409,
    TooLarge: 413,
    Busy: 429,
    Unauthenticated: 401,
    Forbidden: 403,
    StorageFull: 507,
    Unavailable: 503,
}
"""HTTP status of each error class; a subclass has the status of its nearest listed ancestor."""

_STATUS_OF_CODE: Final[Mapping[str, int]] = {
    "unsupported-media-type": 415,
    "not-json": 400,
    "malformed-request": 400,
    "scenario-changed": 412,
}
"""Codes whose HTTP status differs from that of their error class."""

_HTTP_PROBLEMS: Final[Mapping[int, tuple[str, str]]] = {
    400: ("malformed-request", "The request could not be read."),
    404: ("unknown-path", "There is no resource at this address."),
    405: ("method-not-allowed", "This address does not support that method."),
    413: ("body-too-large", "The body of the request is larger than this address accepts."),
    415: ("unsupported-media-type", "This address does not accept the content type of the request."),
}


def status_of(error: StridelabError) -> int:
    """HTTP status of an error; 500 for a class that is not listed."""
    if error.code in _STATUS_OF_CODE:
        return _STATUS_OF_CODE[error.code]
    return next((STATUS[cls] for cls in type(error).__mro__ if cls in STATUS), 500)


def problem_of(error: StridelabError) -> Problem:
    """Convert ``error`` to a problem."""
    faults = [FaultItem(where=fault.where, message=fault.message) for fault in error.faults]
    return make_problem(status_of(error), error.code, error.message, faults)


def make_problem(status: int, code: str, detail: str, errors: list[FaultItem] | None = None) -> Problem:
    """Create a problem with the title of its status and the id of the current request."""
    return Problem(
        title=http.HTTPStatus(status).phrase,
        status=status,
        code=code,
        detail=detail,
        errors=errors or [],
        request_id=structlog.contextvars.get_contextvars().get("request_id"),
    )


def problem_response(body: Problem, headers: Mapping[str, str] | None = None) -> Response:
    """HTTP response with the problem ``body``."""
    text = body.model_dump_json(exclude_none=True)
    return Response(text, status_code=body.status, media_type=MEDIA_TYPE, headers=dict(headers or {}))


def error_response(error: StridelabError) -> Response:
    """HTTP response for ``error``, with the headers that its status requires."""
    headers: dict[str, str] = {}
    if isinstance(error, Busy):
        headers["Retry-After"] = str(max(1, round(error.retry_after_s)))
    if isinstance(error, Unauthenticated):
        headers["WWW-Authenticate"] = 'Bearer realm="stridelab"'
    return problem_response(problem_of(error), headers)


def faults_of(errors: list[Any], document: Any = None) -> list[FaultItem]:
    """Convert the first Pydantic errors to faults; of rejected values, only effector names are repeated."""
    faults = []
    for item in errors[:MAX_FAULTS]:
        path = list(item["loc"])
        if len(path) > 1 and path[0] in ("body", "query", "path", "header", "cookie"):
            path = path[1:]
        message = str(item["msg"])
        if item["type"] == "value_error":  # raised by a validator of a model
            message = message.removeprefix("Value error, ")
            field, colon, rest = message.partition(": ")
            if path in ([], ["body"]) and colon and field.isidentifier():
                path, message = [field], rest
        faults.append(fault_at(path, message, document))
    return faults


def fault_at(path: Sequence[str | int], message: str, document: Any) -> FaultItem:
    """Fault at the field ``path`` of ``document``; for a field of a contact the message starts with its effector."""
    effector, value = "", document
    for part in path:
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            break
        if isinstance(value, dict) and isinstance(value.get("effector"), str):
            effector = f"{value['effector'][:_MAX_NAME_CHARACTERS]}: "
    return FaultItem(where=_shorten_text(".".join(map(str, path))) or "body", message=_shorten_text(effector + message))


def _shorten_text(text: str) -> str:
    return text if len(text) <= _MAX_CHARACTERS else f"{text[:_MAX_CHARACTERS]}..."


def install_handlers(app: FastAPI) -> None:
    """Register handlers that answer the application's exceptions with problems."""

    async def on_error(_: Request, error: Exception) -> Response:
        if not isinstance(error, StridelabError):
            raise error
        return error_response(error)

    async def on_invalid(_: Request, error: Exception) -> Response:
        if not isinstance(error, RequestValidationError):
            raise error
        faults = faults_of(list(error.errors()), error.body)
        places = ", ".join(dict.fromkeys(fault.where for fault in faults))
        return problem_response(
            make_problem(422, "invalid-request", f"The request is not valid: see {places}.", faults)
        )

    async def on_http(request: Request, error: Exception) -> Response:
        if not isinstance(error, HTTPException):
            raise error
        code, detail = _HTTP_PROBLEMS.get(error.status_code, ("http-error", str(error.detail)))
        headers = dict(error.headers or {})
        if error.status_code == 405:
            headers["Allow"] = ", ".join(_methods_of(app, request.scope["path"])) or headers.get("Allow", "")
        return problem_response(make_problem(error.status_code, code, detail), headers)

    async def on_database(_: Request, error: Exception) -> Response:
        if isinstance(error, DataError):
            return error_response(InvalidInput("invalid-value", "The request contains a value that cannot be stored."))
        if isinstance(error, OperationalError | InterfaceError):
            log.error("database unreachable", error=type(error).__name__)
            return error_response(
                Unavailable("database-unreachable", "The database does not answer. Try again shortly.")
            )
        raise error

    app.add_exception_handler(DBAPIError, on_database)
    app.add_exception_handler(StridelabError, on_error)
    app.add_exception_handler(RequestValidationError, on_invalid)
    app.add_exception_handler(HTTPException, on_http)


def _methods_of(app: FastAPI, path: str) -> list[str]:
    """Methods of ``path`` in the OpenAPI document; the router returns only those of the first matching route."""
    described = app.openapi()["paths"]
    fitting = [path] if path in described else [template for template in described if _matches_template(template, path)]
    return sorted({method.upper() for template in fitting for method in described[template]})


def _matches_template(template: str, path: str) -> bool:
    wanted, given = template.split("/"), path.split("/")
    return len(wanted) == len(given) and all(
        part.startswith("{") or part == piece for part, piece in zip(wanted, given, strict=True)
    )
