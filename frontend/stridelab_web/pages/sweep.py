"""What the page of a job adds for a sweep: where the scenario has a motion, as a curve or as maps."""

from typing import Any, Final

from starlette.concurrency import run_in_threadpool

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.sweeps import SweepSummary
from stridelab_web.sweep_map import LEGEND, Swept

KIND: Final = "sweep"
TABLE: Final = "sweep.parquet"


async def sweep_of(client: AsyncClient, job_id: str, result: JobResult) -> dict[str, Any] | None:
    """Values for the template; None for a result without its table."""
    if all(item.name != TABLE for item in result.artifacts):
        return None
    summary = SweepSummary.model_validate(result.summary)
    content = await client.read_artifact(job_id, TABLE)
    charts, borders = await run_in_threadpool(lambda: _drawn(summary, content))
    return {"summary": summary, "charts": charts, "borders": borders, "legend": LEGEND}


def _drawn(summary: SweepSummary, content: bytes) -> tuple[Any, Any]:
    swept = Swept.of(summary, content)
    return swept.charts(), swept.borders()
