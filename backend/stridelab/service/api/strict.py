"""What this service takes for JSON: ``application/json``, UTF-8, RFC 8259, no NUL and no half characters.

Python's own reader also takes NaN and Infinity, and strings that no database column can hold.
"""

import json
from collections.abc import Callable, Coroutine
from typing import Any, Final, NoReturn

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import TypeAdapter, ValidationError
from starlette.responses import Response

from stridelab.errors import Fault, InvalidInput, TooLarge

JSON_LIMIT_BYTES: Final = 1_000_000
"""Largest JSON body."""


class StrictRoute(APIRoute):
    """A route whose JSON body, if it takes one, is read and checked strictly before anything else looks at it."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handler = super().get_route_handler()
        annotation: Any = None if self.body_field is None else self.body_field.field_info.annotation
        if annotation is None:
            return handler
        model: TypeAdapter[Any] = TypeAdapter(annotation)

        async def read_strictly(request: Request) -> Response:
            strict = _StrictRequest(request.scope, request.receive)
            media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
            if media_type != "application/json":
                raise InvalidInput(
                    "unsupported-media-type",
                    "This address reads application/json only; say so in the Content-Type header.",
                    [Fault("Content-Type", media_type[:60] or "missing")],
                )
            strict.raw = await read_limited(request, JSON_LIMIT_BYTES)
            strict.document = parse_json(strict.raw)
            try:
                # A number in quotes is no number, and true is not 1.
                model.validate_json(strict.raw, strict=True)
            except ValidationError as error:
                raise RequestValidationError(error.errors(include_url=False, include_input=False)) from error
            return await handler(strict)

        return read_strictly


class _StrictRequest(Request):
    raw: bytes = b""
    document: Any = None

    async def body(self) -> bytes:
        """The bytes that were read within the limit."""
        return self.raw

    async def json(self) -> Any:
        """The document that ``parse_json`` has already read."""
        return self.document


async def read_limited(request: Request, limit_bytes: int) -> bytes:
    """The body of ``request``. Raises ``TooLarge`` (``body-too-large``) as soon as it is known to exceed the limit."""
    parts, size = [], 0
    announced = request.headers.get("content-length", "")
    if not (announced.isdecimal() and int(announced) > limit_bytes):
        async for chunk in request.stream():
            size += len(chunk)
            if size > limit_bytes:
                break
            parts.append(chunk)
        else:
            return b"".join(parts)
    raise TooLarge("body-too-large", f"The body is larger than the {limit_bytes} bytes that this address reads.")


def parse_json(raw: bytes) -> Any:
    """The JSON document in ``raw``. Raises ``InvalidInput`` (``not-json``, ``invalid-text``)."""
    try:
        document = json.loads(raw.decode("utf-8"), parse_constant=_refuse_constant)
    except UnicodeDecodeError as error:
        raise InvalidInput("not-json", "The body is not JSON: it is not UTF-8 text.") from error
    except json.JSONDecodeError as error:
        raise InvalidInput(
            "not-json",
            f"The body is not JSON: {error.msg} in line {error.lineno}, column {error.colno}.",
            [Fault(f"line {error.lineno}, column {error.colno}", error.msg)],
        ) from error
    except RecursionError as error:
        raise InvalidInput(
            "not-json", "The body is not JSON that this service reads: it is nested too deep."
        ) from error
    except ValueError as error:
        raise InvalidInput("not-json", "The body is not JSON: a number in it has too many digits.") from error
    _refuse_unstorable(document)
    return document


def _refuse_constant(name: str) -> NoReturn:
    raise InvalidInput("not-json", f"The body is not JSON: {name} is not a JSON number.")


def storable(text: str) -> bool:
    """Whether a database column can hold ``text``: no NUL, no half of a surrogate pair."""
    return "\x00" not in text and not any("\ud800" <= character <= "\udfff" for character in text)


def _refuse_unstorable(document: Any) -> None:
    pending = [document]
    while pending:
        value = pending.pop()
        if isinstance(value, dict):
            pending.extend(value)
            pending.extend(value.values())
        elif isinstance(value, list):
            pending.extend(value)
        elif isinstance(value, str) and not storable(value):
            raise InvalidInput("invalid-text", "The body holds text with a NUL or half of a character in it.")
