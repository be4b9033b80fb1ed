"""Positions of waiting jobs in the queue, which the status of every one of them contains.

Positions assume turns over owners (``jobs.queue``), so that one position takes a look at all waiting jobs: 1.5 ms of
the database for 500 of them, with every status request of every one. Here they are read at most once per second.
"""

import asyncio
import time
from collections.abc import Mapping, Sequence
from typing import Final

from sqlalchemy import bindparam, func, select
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.service.storage.database import connect_autocommit
from stridelab.service.storage.tables import job

_order = (job.c.priority.desc(), job.c.created_at, job.c.id)
_turn = func.row_number().over(partition_by=job.c.owner, order_by=_order).label("turn")
_waiting = select(job.c.id, job.c.priority, job.c.created_at, _turn).where(job.c.state == "queued").subquery()
_place = func.row_number().over(
    order_by=(_waiting.c.turn, _waiting.c.priority.desc(), _waiting.c.created_at, _waiting.c.id)
)
_PLACES: Final = select(_waiting.c.id, _place.label("place"))
_placed = _PLACES.subquery()
_PLACES_OF: Final = select(_placed).where(_placed.c.id.in_(bindparam("job_ids", expanding=True)))


class QueuePositions:
    """Positions, from 1, that are at most ``max_age_s`` old; those of jobs that were submitted since are exact."""

    def __init__(self, engine: AsyncEngine, max_age_s: float) -> None:
        self._engine, self._max_age_s = engine, max_age_s
        self._places: Mapping[str, int] = {}
        self._read_at_s = float("-inf")
        self._reading = asyncio.Lock()

    async def positions_of(self, job_ids: Sequence[str]) -> Mapping[str, int]:
        """Positions of those of ``job_ids`` that wait."""
        if not job_ids:
            return {}
        if self._max_age_s > 0:
            async with self._reading:  # one request reads for all that arrive meanwhile
                if time.monotonic() - self._read_at_s > self._max_age_s:
                    read_at_s = time.monotonic()
                    async with connect_autocommit(self._engine) as connection:
                        self._places = {row.id: row.place for row in await connection.execute(_PLACES)}
                    self._read_at_s = read_at_s
            if all(job_id in self._places for job_id in job_ids):
                return self._places
        async with connect_autocommit(self._engine) as connection:
            return {row.id: row.place for row in await connection.execute(_PLACES_OF, {"job_ids": list(job_ids)})}
