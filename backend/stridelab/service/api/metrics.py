"""``GET /metrics``: Prometheus metrics, computed from the database on each request.

All values are read from the tables, so every API process reports the same ones. They count existing rows: numbers fall
when retention removes old jobs.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, Final

from fastapi import APIRouter, Response
from prometheus_client import CollectorRegistry
from prometheus_client.core import GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector
from sqlalchemy import ARRAY, BigInteger, ColumnElement, Float, case, func, literal, select, text
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.api.dependencies import AppParts
from stridelab.service.jobs.queue import LANES
from stridelab.service.storage.tables import job, recording

BUCKETS_S: Final = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0)
"""Upper bounds of the histogram buckets, in seconds."""
CRASH_REASONS: Final = {
    "computation-crashed": "crash",
    "computation-out-of-memory": "memory",
    "computation-timed-out": "timeout",
}
"""Error codes of jobs whose child process was killed or crashed, mapped to the reason in the metrics."""

_WORKERS = text(
    "SELECT count(*) FILTER (WHERE last_heartbeat >= now() - make_interval(secs => :stall_s)), count(*) FROM worker"
)


@dataclass(frozen=True)
class Histogram:
    """Durations in seconds: the count per bucket of ``BUCKETS_S`` and above the last one, and their sum."""

    labels: tuple[str, ...]
    counts: tuple[int, ...]
    sum_s: float


@dataclass(frozen=True)
class Counts:
    """Values of all metrics at one moment."""

    jobs: tuple[tuple[str, str, int], ...]
    durations: tuple[Histogram, ...]
    waiting_times: tuple[Histogram, ...]
    failures: tuple[tuple[str, str, int], ...]
    lost_starts: int
    depth: dict[str, int]
    oldest_queued_s: float
    workers_alive: int
    workers_silent: int
    recordings: int
    upload_bytes: float
    database_bytes: float


async def read_counts(connection: AsyncConnection, stall_s: float) -> Counts:
    """Read the counts; a worker without a heartbeat for ``stall_s`` counts as silent."""
    by_state = select(job.c.kind, job.c.state, func.count()).group_by(job.c.kind, job.c.state)
    code = job.c.error["code"].astext
    failed = select(job.c.kind, code, func.count()).where(job.c.error.is_not(None)).group_by(job.c.kind, code)
    oldest = select(func.extract("epoch", func.now() - func.min(job.c.created_at))).where(job.c.state == "queued")
    # a completed start is not lost, and neither is one that the worker returned to the queue
    started = job.c.attempt - job.c.returned - case((job.c.state == "queued", 0), else_=1)
    lost = select(func.coalesce(func.sum(func.greatest(started, 0)), 0))
    stored = (await connection.execute(select(func.count(), func.sum(recording.c.bytes)))).one()
    alive, known = (await connection.execute(_WORKERS, {"stall_s": stall_s})).one()
    in_lanes = select(job.c.lane, func.count()).where(job.c.state == "queued").group_by(job.c.lane)
    waiting = {str(lane): int(n) for lane, n in (await connection.execute(in_lanes)).all()}
    return Counts(
        jobs=tuple((str(k), str(s), int(n)) for k, s, n in (await connection.execute(by_state)).all()),
        durations=await _read_histograms(connection, job.c.finished_at - job.c.started_at, (job.c.kind, job.c.state)),
        waiting_times=await _read_histograms(connection, job.c.started_at - job.c.created_at, (job.c.kind,)),
        failures=tuple((str(k), str(c), int(n)) for k, c, n in (await connection.execute(failed)).all()),
        lost_starts=int((await connection.execute(lost)).scalar_one()),
        depth={lane: waiting.get(lane, 0) for lane in LANES},
        oldest_queued_s=float((await connection.execute(oldest)).scalar_one() or 0.0),
        workers_alive=int(alive),
        workers_silent=int(known) - int(alive),
        recordings=int(stored[0]),
        upload_bytes=float(stored[1] or 0),
        database_bytes=float(
            (await connection.execute(select(func.pg_database_size(func.current_database())))).scalar_one()
        ),
    )


async def _read_histograms(
    connection: AsyncConnection, interval: ColumnElement[Any], labels: tuple[ColumnElement[str], ...]
) -> tuple[Histogram, ...]:
    """Histograms of ``interval`` over finished jobs, grouped by ``labels``."""
    seconds = func.extract("epoch", interval).cast(Float)
    limits = literal(list(BUCKETS_S), ARRAY(Float))
    # width_bucket assigns a bound to the bucket above it, Prometheus to the one below; clocks are not that exact
    bucket = func.width_bucket(seconds, limits).cast(BigInteger)
    per_bucket = (
        select(*labels, bucket, func.count(), func.sum(seconds))
        .where(job.c.state.in_(FINAL_STATES), job.c.started_at.is_not(None), job.c.finished_at.is_not(None))
        .group_by(*labels, bucket)
    )
    groups: dict[tuple[str, ...], tuple[list[int], list[float]]] = {}
    for *values, index, number, total_s in (await connection.execute(per_bucket)).all():
        counts, sums = groups.setdefault(tuple(map(str, values)), ([0] * (len(BUCKETS_S) + 1), []))
        counts[int(index)] += int(number)
        sums.append(float(total_s))
    return tuple(Histogram(values, tuple(counts), sum(sums)) for values, (counts, sums) in sorted(groups.items()))


router = APIRouter(tags=["service"])

_PLAIN: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "Prometheus text format.", "content": {"text/plain": {"schema": {"type": "string"}}}}
}
_LIMITS: Final = (*map(str, BUCKETS_S), "+Inf")


@router.get("/metrics", summary="Metrics", responses=_PLAIN, response_class=Response)
async def metrics(parts: AppParts) -> Response:
    """Jobs, queue, durations, crashed child processes, workers and storage, for Prometheus."""
    async with parts.engine.connect() as connection:
        counts = await read_counts(connection, parts.settings.stall_s)
    return Response(prometheus_text(counts), media_type=CONTENT_TYPE_PLAIN_0_0_4)


def prometheus_text(counts: Counts) -> bytes:
    """Format ``counts`` as Prometheus text."""
    registry = CollectorRegistry()
    registry.register(_CountsCollector(counts))
    return generate_latest(registry)


class _CountsCollector(Collector):
    def __init__(self, counts: Counts) -> None:
        self._counts = counts

    def collect(self) -> Iterator[Any]:
        counts = self._counts
        yield _labelled_gauge("stridelab_jobs", "Jobs by kind and state", ["kind", "state"], counts.jobs)
        yield _histogram_metric(
            "stridelab_job_duration_seconds", "From start to end of a job", ["kind", "state"], counts.durations
        )
        yield _histogram_metric(
            "stridelab_job_wait_seconds", "From submission to the last start of a job", ["kind"], counts.waiting_times
        )
        yield _labelled_gauge(
            "stridelab_job_failures", "Jobs that ended with an error, by its code", ["kind", "code"], counts.failures
        )
        died = [(kind, CRASH_REASONS[code], number) for kind, code, number in counts.failures if code in CRASH_REASONS]
        yield _labelled_gauge(
            "stridelab_child_crashes",
            "Child processes that crashed, or were killed at a limit",
            ["kind", "reason"],
            died,
        )
        yield _labelled_gauge("stridelab_queue_depth", "Queued deliveries by lane", ["lane"], counts.depth.items())
        workers = (("alive", counts.workers_alive), ("silent", counts.workers_silent))
        yield _labelled_gauge(
            "stridelab_workers", "Registered workers, by whether they send heartbeats", ["state"], workers
        )
        yield from self._unlabelled_gauges()

    def _unlabelled_gauges(self) -> Iterable[Any]:
        counts = self._counts
        for name, meaning, value in (
            ("stridelab_job_lost_starts", "Starts of jobs that were lost with their worker", counts.lost_starts),
            ("stridelab_queue_oldest_seconds", "Age of the oldest queued job", counts.oldest_queued_s),
            ("stridelab_recordings", "Stored recordings", counts.recordings),
            ("stridelab_upload_bytes", "Size of the stored recordings", counts.upload_bytes),
            ("stridelab_database_bytes", "Size of the database", counts.database_bytes),
        ):
            yield GaugeMetricFamily(name, meaning, value=value)


def _labelled_gauge(name: str, meaning: str, labels: list[str], values: Iterable[tuple[Any, ...]]) -> GaugeMetricFamily:
    family = GaugeMetricFamily(name, meaning, labels=labels)
    for *named, value in values:
        family.add_metric(named, value)
    return family


def _histogram_metric(name: str, meaning: str, labels: list[str], values: Iterable[Histogram]) -> HistogramMetricFamily:
    family = HistogramMetricFamily(name, meaning, labels=labels)
    for value in values:
        family.add_metric(list(value.labels), list(zip(_LIMITS, accumulate(value.counts), strict=True)), value.sum_s)
    return family
