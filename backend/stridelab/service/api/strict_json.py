"""Strict JSON bodies: ``application/json``, UTF-8, RFC 8259, without NUL characters or lone surrogates.

Python's parser also accepts NaN and Infinity, and strings that PostgreSQL cannot store.
"""

import json
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass
from typing import Any, Final, NoReturn

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import TypeAdapter, ValidationError
from starlette.responses import Response

from stridelab.errors import Fault, InvalidInput, TooLarge
from stridelab.service.api.problems import fault_at

JSON_LIMIT_BYTES: Final = 1_000_000
"""Maximum size of a JSON body."""


class StrictRoute(APIRoute):
    """A route whose JSON body, if it has one, is parsed and validated strictly before FastAPI reads it."""

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
                    "This address accepts application/json only; set the Content-Type header.",
                    [Fault("Content-Type", media_type[:60] or "missing")],
                )
            strict.raw = await read_limited(request, JSON_LIMIT_BYTES)
            strict.document = parse_json(strict.raw)
            ignored: frozenset[str] = getattr(annotation, "ignored_fields", frozenset())
            if isinstance(strict.document, dict) and not ignored.isdisjoint(strict.document):
                strict.document = annotation.readable_fields(strict.document)
                strict.raw = json.dumps(strict.document).encode()
            try:
                # strict: a quoted number is not a number, and true is not 1
                model.validate_json(strict.raw, strict=True)
            except ValidationError as error:
                refused = error.errors(include_url=False, include_input=False)
                raise RequestValidationError(refused, body=strict.document) from error
            return await handler(strict)

        return read_strictly


class _StrictRequest(Request):
    raw: bytes = b""
    document: Any = None

    async def body(self) -> bytes:
        """The body, which ``read_limited`` has already read."""
        return self.raw

    async def json(self) -> Any:
        """The document, which ``parse_json`` has already parsed."""
        return self.document


async def read_limited(request: Request, limit_bytes: int) -> bytes:
    """Read the body of ``request``. Raises ``TooLarge`` (``body-too-large``) as soon as it exceeds the limit."""
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
    raise TooLarge("body-too-large", f"The body is larger than {limit_bytes} bytes, the limit of this address.")


def parse_json(raw: bytes) -> Any:
    """Parse the JSON document ``raw``. Raises ``InvalidInput`` (``not-json``, ``invalid-text``)."""
    constants: list[_Constant] = []

    def record_constant(name: str) -> _Constant:
        constants.append(_Constant(name))
        return constants[-1]

    try:
        document = json.loads(raw.decode("utf-8"), parse_constant=record_constant)
    except UnicodeDecodeError as error:
        raise InvalidInput("not-json", "The body is not JSON: it is not UTF-8 text.") from error
    except json.JSONDecodeError as error:
        raise InvalidInput(
            "not-json",
            f"The body is not JSON: {error.msg} in line {error.lineno}, column {error.colno}.",
            [Fault(f"line {error.lineno}, column {error.colno}", error.msg)],
        ) from error
    except RecursionError as error:
        raise InvalidInput("not-json", "The body cannot be parsed as JSON: it is nested too deeply.") from error
    except ValueError as error:
        raise InvalidInput("not-json", "The body is not JSON: a number in it has too many digits.") from error
    if constants:
        _refuse_constant(constants[0], document)
    _refuse_unstorable(document)
    return document


@dataclass(frozen=True)
class _Constant:
    """NaN or Infinity, which Python's parser accepts as a number although JSON does not."""

    name: str


def _refuse_constant(first: _Constant, document: Any) -> NoReturn:
    path = _path_of(first, document)
    fault = fault_at(path, f"{first.name} is not a JSON number", document)
    message = f"The body is not JSON: {first.name} is not a JSON number (in {fault.where})."
    raise InvalidInput("not-json", message, [Fault(fault.where, fault.message)])


def _path_of(wanted: _Constant, document: Any) -> list[str | int]:
    """Path of ``wanted`` in the document, without recursion; empty if a duplicate key has replaced it."""
    path: list[str | int] = []
    pending = [_child_items(document)]
    while pending:
        for part, value in pending[-1]:
            if value is wanted:
                return [*path, part]
            if isinstance(value, dict | list):
                path.append(part)
                pending.append(_child_items(value))
                break
        else:
            pending.pop()
            del path[-1:]
    return []


def _child_items(value: Any) -> Iterator[tuple[str | int, Any]]:
    if isinstance(value, dict):
        yield from value.items()
    elif isinstance(value, list):
        yield from enumerate(value)


def is_storable(text: str) -> bool:
    """Whether PostgreSQL can store ``text``: it contains no NUL and no lone surrogate."""
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
        elif isinstance(value, str) and not is_storable(value):
            raise InvalidInput("invalid-text", "The body contains text with a NUL character or a lone surrogate.")
