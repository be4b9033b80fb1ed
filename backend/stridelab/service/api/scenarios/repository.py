"""Queries of scenarios, and conversion of their rows to the ``StoredScenario`` schema."""

from collections.abc import Mapping
from typing import Any, Final

from sqlalchemy import Select, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Conflict
from stridelab.schemas.base import Page
from stridelab.schemas.scenarios import StoredScenario
from stridelab.service.api.dependencies import require_id_form, required_row
from stridelab.service.api.pagination import Order
from stridelab.service.storage.search import contains_words
from stridelab.service.storage.tables import scenario

Row = Mapping[str, Any]

PAGE_PARTS: Final = 20_000
"""Maximum number of surfaces, phases and contacts per page; a page of very long scenarios has fewer items."""
_BATCH: Final = 10


async def scenario_row(connection: AsyncConnection, scenario_id: str, *, lock: bool = False) -> Row:
    """The row of one scenario, optionally locked until the transaction ends.

    Raises ``NotFound`` (``scenario-not-found``).
    """
    query = select(scenario).where(scenario.c.id == require_id_form(scenario_id, "scenario"))
    if lock:
        query = query.with_for_update()
    return await required_row(connection, query, "scenario")


async def lock_changeable_row(connection: AsyncConnection, scenario_id: str) -> Row:
    """Lock and return the row of a scenario that is not bundled.

    Raises ``NotFound`` (``scenario-not-found``), ``Conflict`` (``scenario-read-only``) for a bundled one.
    """
    row = await scenario_row(connection, scenario_id, lock=True)
    if row["bundled"]:
        raise Conflict(
            "scenario-read-only",
            "This scenario is part of the program and cannot be changed or deleted; store a copy of it instead.",
        )
    return row


def check_if_match(row: Row, if_match: str | None) -> None:
    """Check the precondition of an ``If-Match`` header.

    Raises ``Conflict`` (``scenario-changed``) if ``if_match`` does not contain the ETag of the row.
    """
    tags = {tag.strip() for tag in (if_match or "*").split(",")}
    if not tags & {"*", scenario_of(row).etag}:
        raise Conflict("scenario-changed", "This scenario has been changed elsewhere since it was read.")


async def scenarios_page(
    connection: AsyncConnection, limit: int, cursor: str | None, search: str | None = None, sort: str = "newest"
) -> Page[StoredScenario]:
    """Read one page; rows are streamed, so that no more are fetched than the page contains."""
    name = scenario.c.body["name"].astext
    wanted = select(scenario)
    if search is not None:
        wanted = wanted.where(contains_words(search, name, scenario.c.body["robot"].astext))
    order = Order(scenario, sort, name)
    query: Select[Any] = order.restrict(wanted, limit, cursor)
    rows: list[Row] = []
    parts = 0
    async with connection.stream(query.execution_options(yield_per=_BATCH)) as result:
        async for row in result.mappings():
            parts += _parts_of(row["body"])
            if rows and parts > PAGE_PARTS:
                limit = len(rows)
            rows.append(row)
            if len(rows) > limit:
                break
    shown, following = order.cut_page(rows, limit)
    return Page[StoredScenario](items=[scenario_of(row) for row in shown], next=following)


def scenario_of(row: Row) -> StoredScenario:
    """Convert a row to a ``StoredScenario``."""
    about = {name: row[name] for name in ("id", "created_at", "updated_at", "bundled", "owner")}
    return StoredScenario.model_validate({**row["body"], **about})


def _parts_of(body: Mapping[str, Any]) -> int:
    return len(body["terrain"]) + sum(1 + len(phase["contacts"]) for phase in body["phases"])
