"""Cursor pagination, newest first. A cursor names the last row of a page, so that insertions do not shift pages."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from fastapi import Query
from sqlalchemy import ColumnElement, Select, Table, tuple_
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.service.cursors import decode_cursor, encode_cursor

Limit = Annotated[int, Query(ge=1, le=200, description="maximum number of items per page", examples=[20])]
Cursor = Annotated[str | None, Query(max_length=200, description="`next` of the previous page")]


def newest_first(query: Select[Any], table: Table, limit: int, cursor: str | None) -> Select[Any]:
    """Restrict ``query`` to one page and one more row, which shows whether a further page exists."""
    if cursor is not None:
        created_at, row_id = decode_cursor(cursor)
        before: ColumnElement[bool] = tuple_(table.c.created_at, table.c.id) < tuple_(created_at, row_id)
        query = query.where(before)
    return query.order_by(table.c.created_at.desc(), table.c.id.desc()).limit(limit + 1)


async def read_page(
    engine: AsyncEngine, query: Select[Any], table: Table, limit: int, cursor: str | None
) -> tuple[list[dict[str, Any]], str | None]:
    """Read the rows of one page of ``query``, newest first, and the cursor of the next page (None at the end)."""
    async with engine.connect() as connection:
        rows = (await connection.execute(newest_first(query, table, limit, cursor))).mappings().all()
    return cut_page(rows, limit)


def cut_page(rows: Sequence[Mapping[str, Any]], limit: int) -> tuple[list[dict[str, Any]], str | None]:
    """Split the rows of a ``newest_first`` query into one page and the cursor of the next page (None at the end)."""
    shown = [dict(row) for row in rows[:limit]]
    more = len(rows) > limit
    return shown, encode_cursor(shown[-1]["created_at"], shown[-1]["id"]) if more else None
