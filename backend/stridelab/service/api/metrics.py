"""``GET /metrics``: Prometheus text, read from the database when it is asked for."""

from collections.abc import Iterable, Iterator
from itertools import accumulate
from typing import Any, Final

from fastapi import APIRouter, Response
from prometheus_client import CollectorRegistry
from prometheus_client.core import GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector

from stridelab.service.api.counting import BUCKETS_S, DEATHS, Counts, Histogram, count
from stridelab.service.api.parts import AppParts

router = APIRouter(tags=["service"])

_PLAIN: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "Prometheus text format.", "content": {"text/plain": {"schema": {"type": "string"}}}}
}
_LIMITS: Final = (*map(str, BUCKETS_S), "+Inf")


@router.get("/metrics", summary="Metrics", responses=_PLAIN, response_class=Response)
async def metrics(parts: AppParts) -> Response:
    """Jobs, queue, durations, children that died, workers and what is stored, for Prometheus."""
    async with parts.engine.connect() as connection:
        counts = await count(connection, parts.settings.stall_s)
    return Response(exposition(counts), media_type=CONTENT_TYPE_PLAIN_0_0_4)


def exposition(counts: Counts) -> bytes:
    """``counts`` in Prometheus' text format."""
    registry = CollectorRegistry()
    registry.register(_Told(counts))
    return generate_latest(registry)


class _Told(Collector):
    def __init__(self, counts: Counts) -> None:
        self._counts = counts

    def collect(self) -> Iterator[Any]:
        counts = self._counts
        yield _labelled("stridelab_jobs", "Jobs by kind and state", ["kind", "state"], counts.jobs)
        yield _histogram("stridelab_job_duration_seconds", "From start to end of a job", ["kind", "state"], counts.took)
        yield _histogram(
            "stridelab_job_wait_seconds", "From submission to the last start of a job", ["kind"], counts.waited
        )
        yield _labelled(
            "stridelab_job_failures", "Jobs that ended with an error, by its code", ["kind", "code"], counts.failures
        )
        died = [(kind, DEATHS[code], number) for kind, code, number in counts.failures if code in DEATHS]
        yield _labelled(
            "stridelab_child_crashes", "Children that crashed, or were killed at a limit", ["kind", "reason"], died
        )
        yield _labelled("stridelab_queue_depth", "Waiting deliveries by lane", ["lane"], counts.depth.items())
        workers = (("alive", counts.workers_alive), ("silent", counts.workers_silent))
        yield _labelled("stridelab_workers", "Known workers, by whether they are heard of", ["state"], workers)
        yield from self._plain()

    def _plain(self) -> Iterable[Any]:
        counts = self._counts
        for name, meaning, value in (
            ("stridelab_job_lost_starts", "Starts of jobs that were lost with their worker", counts.lost_starts),
            ("stridelab_queue_oldest_seconds", "Age of the oldest queued job", counts.oldest_queued_s),
            ("stridelab_recordings", "Stored recordings", counts.recordings),
            ("stridelab_upload_bytes", "Size of the stored recordings", counts.upload_bytes),
            ("stridelab_database_bytes", "Size of the database", counts.database_bytes),
        ):
            yield GaugeMetricFamily(name, meaning, value=value)


def _labelled(name: str, meaning: str, labels: list[str], values: Iterable[tuple[Any, ...]]) -> GaugeMetricFamily:
    family = GaugeMetricFamily(name, meaning, labels=labels)
    for *named, value in values:
        family.add_metric(named, value)
    return family


def _histogram(name: str, meaning: str, labels: list[str], values: Iterable[Histogram]) -> HistogramMetricFamily:
    family = HistogramMetricFamily(name, meaning, labels=labels)
    for value in values:
        family.add_metric(list(value.labels), list(zip(_LIMITS, accumulate(value.counts), strict=True)), value.sum_s)
    return family
