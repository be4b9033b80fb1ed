"""Marker sets of users as data for the child processes that identify markers."""

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.marker_sets import MarkerSetBody, SourceMarkerSet
from stridelab.service.storage.tables import marker_set


async def source_marker_sets(connection: AsyncConnection, owner: str | None) -> list[SourceMarkerSet]:
    """All sets in order of preference for a recording of ``owner``: the owner's own first, then the newest."""
    own_first = marker_set.c.owner.is_not_distinct_from(owner).desc()
    query = select(marker_set).order_by(own_first, marker_set.c.created_at.desc(), marker_set.c.id)
    return [
        SourceMarkerSet(id=row["id"], **{name: row["body"].get(name) for name in MarkerSetBody.model_fields})
        for row in (await connection.execute(query)).mappings()
    ]
