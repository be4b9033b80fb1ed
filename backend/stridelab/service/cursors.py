"""Pagination cursors of all lists: creation time or name, and id, of the last row of a page, as opaque text."""

import base64
import binascii
from datetime import datetime
from typing import Final

from stridelab.errors import Fault, InvalidInput

_BY_NAME: Final = "name"


def encode_cursor(created_at: datetime, row_id: str) -> str:
    """The cursor after the row ``(created_at, row_id)``."""
    return _encode(f"{created_at.isoformat()} {row_id}")


def decode_cursor(cursor: str) -> tuple[datetime, str]:
    """Inverse of ``encode_cursor``. Raises ``InvalidInput`` (``invalid-cursor``)."""
    moment, separator, row_id = _decode(cursor).partition(" ")
    try:
        created_at = datetime.fromisoformat(moment)
    except ValueError as error:
        raise _invalid_cursor() from error
    if not separator or not row_id.isprintable() or created_at.tzinfo is None:
        raise _invalid_cursor()
    return created_at, row_id


def encode_name_cursor(name: str, row_id: str) -> str:
    """The cursor after the row ``row_id`` in a list that is sorted by name."""
    return _encode(f"{_BY_NAME} {row_id} {name}")


def decode_name_cursor(cursor: str) -> tuple[str, str]:
    """Inverse of ``encode_name_cursor``. Raises ``InvalidInput`` (``invalid-cursor``)."""
    marker, _, rest = _decode(cursor).partition(" ")
    row_id, separator, name = rest.partition(" ")
    if marker != _BY_NAME or not separator or not row_id.isprintable() or "\0" in name:
        raise _invalid_cursor()
    return name, row_id


def _encode(text: str) -> str:
    return base64.urlsafe_b64encode(text.encode()).decode().rstrip("=")


def _decode(cursor: str) -> str:
    try:
        return base64.b64decode(cursor.encode() + b"=" * (-len(cursor) % 4), altchars=b"-_", validate=True).decode()
    except (binascii.Error, ValueError) as error:
        raise _invalid_cursor() from error


def _invalid_cursor() -> InvalidInput:
    return InvalidInput(
        "invalid-cursor", "Invalid cursor: use the `next` value of a previous page.", [Fault("cursor", "invalid")]
    )
