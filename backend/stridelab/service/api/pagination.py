"""Pages of lists: order, search, and cursors, which name the last row of a page so that insertions shift no page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from fastapi import Query
from sqlalchemy import ColumnElement, Select, Table, func, tuple_
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.service.cursors import decode_cursor, decode_name_cursor, encode_cursor, encode_name_cursor

Limit = Annotated[int, Query(ge=1, le=200, description="maximum number of items per page", examples=[20])]
Cursor = Annotated[str | None, Query(max_length=500, description="`next` of the previous page")]
Search = Annotated[
    str | None,
    Query(max_length=100, pattern=r"^[^\x00]*$", description="only items that contain all of these words, in any case"),
]
Sort = Annotated[Literal["newest", "oldest", "name"], Query(description="order of the list")]

_NAME_LENGTH: Final = 80
"""Number of characters of a name that determine its place; ids decide between names that agree in them."""


@dataclass(frozen=True)
class Order:
    """Order of the rows of ``table``; ``name`` is the text by which ``sort="name"`` orders them."""

    table: Table
    sort: str = "newest"
    name: ColumnElement[Any] | None = None

    def restrict(self, query: Select[Any], limit: int, cursor: str | None) -> Select[Any]:
        """Restrict ``query`` to one page and one more row, which shows whether a further page exists.

        Raises ``InvalidInput`` (``invalid-cursor``).
        """
        key, row_id = self._key(), self.table.c.id
        if cursor is not None:
            last = tuple_(*(decode_name_cursor(cursor) if self.sort == "name" else decode_cursor(cursor)))
            place = tuple_(key, row_id)
            query = query.where(place < last if self.sort == "newest" else place > last)
        if self.sort == "name":
            query = query.add_columns(key.label("sort_name"))
        columns = (key.desc(), row_id.desc()) if self.sort == "newest" else (key, row_id)
        return query.order_by(*columns).limit(limit + 1)

    def cut_page(self, rows: Sequence[Mapping[str, Any]], limit: int) -> tuple[list[dict[str, Any]], str | None]:
        """Split the rows of a restricted query into one page and the cursor of the next page (None at the end)."""
        shown = [dict(row) for row in rows[:limit]]
        if len(rows) <= limit:
            return shown, None
        last = shown[-1]
        if self.sort == "name":
            return shown, encode_name_cursor(last["sort_name"], last["id"])
        return shown, encode_cursor(last["created_at"], last["id"])

    def _key(self) -> ColumnElement[Any]:
        if self.sort != "name":
            return self.table.c.created_at
        assert self.name is not None, "no name to sort by"
        return func.left(func.lower(func.coalesce(self.name, "")), _NAME_LENGTH).collate("C")


async def read_page(
    engine: AsyncEngine, query: Select[Any], order: Order, limit: int, cursor: str | None
) -> tuple[list[dict[str, Any]], str | None]:
    """Read the rows of one page of ``query``, and the cursor of the next page (None at the end)."""
    async with engine.connect() as connection:
        rows = (await connection.execute(order.restrict(query, limit, cursor))).mappings().all()
    return order.cut_page(rows, limit)
