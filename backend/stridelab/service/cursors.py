"""Pagination cursors of all lists: creation time and id of the last row of a page, encoded as opaque text."""

import base64
import binascii
from datetime import datetime

from stridelab.errors import Fault, InvalidInput


def encode_cursor(created_at: datetime, row_id: str) -> str:
    """The cursor after the row ``(created_at, row_id)``."""
    return base64.urlsafe_b64encode(f"{created_at.isoformat()} {row_id}".encode()).decode().rstrip("=")


def decode_cursor(cursor: str) -> tuple[datetime, str]:
    """Inverse of ``encode_cursor``. Raises ``InvalidInput`` (``invalid-cursor``)."""
    try:
        text = base64.b64decode(cursor.encode() + b"=" * (-len(cursor) % 4), altchars=b"-_", validate=True).decode()
        moment, separator, row_id = text.partition(" ")
        created_at = datetime.fromisoformat(moment)
    except (binascii.Error, ValueError) as error:
        raise _invalid_cursor() from error
    if not separator or not row_id.isprintable() or created_at.tzinfo is None:
        raise _invalid_cursor()
    return created_at, row_id


def _invalid_cursor() -> InvalidInput:
    return InvalidInput(
        "invalid-cursor", "Invalid cursor: use the `next` value of a previous page.", [Fault("cursor", "invalid")]
    )
