"""``GET /metrics``: Prometheus text, read from the database when it is asked for, so any API process tells the same."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from fastapi import APIRouter, Response
from prometheus_client import CollectorRegistry
from prometheus_client.core import GaugeMetricFamily, SummaryMetricFamily
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector
from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.api.parts import AppParts
from stridelab.service.storage.tables import job, recording

router = APIRouter(tags=["service"])

_PLAIN: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "Prometheus text format.", "content": {"text/plain": {"schema": {"type": "string"}}}}
}


@dataclass(frozen=True)
class Counts:
    """What the database says at one moment."""

    jobs: tuple[tuple[str, str, int], ...]
    durations: tuple[tuple[str, str, int, float], ...]
    oldest_queued_s: float
    recordings: int
    upload_bytes: float


@router.get("/metrics", summary="Metrics", responses=_PLAIN, response_class=Response)
async def metrics(parts: AppParts) -> Response:
    """Jobs by kind and state, their durations, the age of the queue and the stored recordings, for Prometheus."""
    async with parts.engine.connect() as connection:
        counts = await count(connection)
    return Response(exposition(counts), media_type=CONTENT_TYPE_PLAIN_0_0_4)


async def count(connection: AsyncConnection) -> Counts:
    """Read the counts."""
    by_state = select(job.c.kind, job.c.state, func.count()).group_by(job.c.kind, job.c.state)
    took_s = func.extract("epoch", job.c.finished_at - job.c.started_at)
    finished = job.c.state.in_(FINAL_STATES) & job.c.started_at.is_not(None) & job.c.finished_at.is_not(None)
    durations = (
        select(job.c.kind, job.c.state, func.count(), func.sum(took_s))
        .where(finished)
        .group_by(job.c.kind, job.c.state)
    )
    oldest = select(func.extract("epoch", func.now() - func.min(job.c.created_at))).where(job.c.state == "queued")
    stored = (await connection.execute(select(func.count(), func.sum(recording.c.bytes)))).one()
    return Counts(
        jobs=tuple((str(k), str(s), int(n)) for k, s, n in (await connection.execute(by_state)).all()),
        durations=tuple(
            (str(k), str(s), int(n), float(t)) for k, s, n, t in (await connection.execute(durations)).all()
        ),
        oldest_queued_s=float((await connection.execute(oldest)).scalar_one() or 0.0),
        recordings=int(stored[0]),
        upload_bytes=float(stored[1] or 0),
    )


def exposition(counts: Counts) -> bytes:
    """``counts`` in Prometheus' text format."""
    registry = CollectorRegistry()
    registry.register(_Told(counts))
    return generate_latest(registry)


class _Told(Collector):
    def __init__(self, counts: Counts) -> None:
        self._counts = counts

    def collect(self) -> Iterator[Any]:
        present = GaugeMetricFamily("stridelab_jobs", "Jobs by kind and state", labels=["kind", "state"])
        for kind, state, number in self._counts.jobs:
            present.add_metric([kind, state], number)
        yield present
        took = SummaryMetricFamily(
            "stridelab_job_duration_seconds", "From start to end of a job", labels=["kind", "state"]
        )
        for kind, state, number, total_s in self._counts.durations:
            took.add_metric([kind, state], count_value=number, sum_value=total_s)
        yield took
        yield from self._plain()

    def _plain(self) -> Iterable[Any]:
        yield GaugeMetricFamily(
            "stridelab_queue_oldest_seconds", "Age of the oldest queued job", value=self._counts.oldest_queued_s
        )
        yield GaugeMetricFamily("stridelab_recordings", "Stored recordings", value=self._counts.recordings)
        yield GaugeMetricFamily(
            "stridelab_upload_bytes", "Size of the stored recordings", value=self._counts.upload_bytes
        )
