"""Lists, newest first, in pages. A cursor names the last row of a page, so rows that come or go move nothing."""

import base64
import binascii
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Annotated, Any

from fastapi import Query
from sqlalchemy import ColumnElement, Select, Table, tuple_

from stridelab.errors import Fault, InvalidInput

Limit = Annotated[int, Query(ge=1, le=200, description="most items on a page", examples=[20])]
Cursor = Annotated[str | None, Query(max_length=200, description="`next` of the page before")]


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
        raise _invalid() from error
    if not separator or not row_id.isprintable() or created_at.tzinfo is None:
        raise _invalid()
    return created_at, row_id


def _invalid() -> InvalidInput:
    return InvalidInput(
        "invalid-cursor", "The cursor is none of ours; take it from `next` of a page.", [Fault("cursor", "invalid")]
    )


def newest_first(query: Select[Any], table: Table, limit: int, cursor: str | None) -> Select[Any]:
    """``query`` for one page and one row more, which says whether a further page exists."""
    if cursor is not None:
        created_at, row_id = decode_cursor(cursor)
        before: ColumnElement[bool] = tuple_(table.c.created_at, table.c.id) < tuple_(created_at, row_id)
        query = query.where(before)
    return query.order_by(table.c.created_at.desc(), table.c.id.desc()).limit(limit + 1)


def cut(rows: Sequence[Mapping[str, Any]], limit: int) -> tuple[list[dict[str, Any]], str | None]:
    """The rows of one page of a ``newest_first`` query, and the cursor of the next page where there is one."""
    shown = [dict(row) for row in rows[:limit]]
    more = len(rows) > limit
    return shown, encode_cursor(shown[-1]["created_at"], shown[-1]["id"]) if more else None
