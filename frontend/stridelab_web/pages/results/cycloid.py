"""The rolling wheel on the page of a job: all steps, and charts of one of them."""

from typing import Any, Final

from starlette.concurrency import run_in_threadpool

from stridelab.client import AsyncClient
from stridelab.schemas.cycloid import FitCycloidSummary
from stridelab.schemas.jobs import JobResult
from stridelab_web.pages.results.cycloid_charts import WHEEL_TABLE, StepCharts, draw_step, samples_of
from stridelab_web.pages.results.cycloid_steps import (
    PARAMETERS,
    WheelStep,
    contests_of,
    medians_of,
    steps_of,
    values_of,
)
from stridelab_web.parquet import read_columns

KIND: Final = "fit-cycloid"
MIN_SAMPLES: Final = 4
SOURCES: Final = {"plates": "Plates", "markers": "Markers", "mixed": "Plates and markers"}


async def cycloid_of(client: AsyncClient, job_id: str, result: JobResult, step_number: str) -> dict[str, Any]:
    """Values for the template; shows the step of the given number (from 1), or the first one."""
    summary = FitCycloidSummary.model_validate(result.summary)
    steps = steps_of(summary)
    number = int(step_number) if step_number.isdecimal() and 1 <= int(step_number) <= len(steps) else 1
    shown = steps[number - 1] if steps else None
    charts = None
    if shown is not None and any(item.name == WHEEL_TABLE for item in result.artifacts):
        content = await client.read_artifact(job_id, WHEEL_TABLE)
        charts = await run_in_threadpool(lambda: _step_charts(content, shown))
    return {
        "summary": summary,
        "steps": steps,
        "parameters": PARAMETERS,
        "sources": SOURCES,
        "medians": medians_of(steps),
        "shown": shown,
        "charts": charts,
        "lines": values_of(shown, summary.step_to_step_sd) if shown else (),
        "contests": contests_of(shown, steps) if shown else (),
        "previous": number - 1 if number > 1 else None,
        "next": number + 1 if number < len(steps) else None,
    }


def _step_charts(content: bytes, step: WheelStep) -> StepCharts | None:
    samples = samples_of(read_columns(content), step)
    return draw_step(samples, step) if len(samples["time_s"]) >= MIN_SAMPLES else None
