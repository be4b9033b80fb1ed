"""The receding horizon on the page of a job: figures as text, a chart of the replans, and pushes."""

from typing import Any, Final

import numpy as np
from starlette.concurrency import run_in_threadpool

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.receding import PlanRecedingInput, PlanRecedingSummary
from stridelab_web.formatting import with_unit
from stridelab_web.pages.results.receding_plots import (
    LIMIT_MS,
    effect_times_s,
    push_text,
    receding_curves,
    replan_chart,
)
from stridelab_web.pages.results.receding_plots import RECEDING_TABLE as TABLE
from stridelab_web.parquet import Columns, read_columns

KIND: Final = "plan-receding"
AT_REST_M: Final = 1e-5
"""Distance from its place of rest below which the CoM counts as at rest."""


async def receding_of(client: AsyncClient, job_id: str, result: JobResult) -> dict[str, Any]:
    """Values of _receding.html."""
    columns = await _read_table(client, job_id)
    job_input = PlanRecedingInput.model_validate(result.input)
    summary = PlanRecedingSummary.model_validate(result.summary)
    took_ms = columns["replan_ms"][np.isfinite(columns["replan_ms"])]
    within = int((took_ms <= LIMIT_MS).sum())
    felt = zip(effect_times_s(job_input.pushes, job_input.period_s), job_input.pushes, strict=True)
    at_rest = summary.goal_gap_m < AT_REST_M
    return {
        "summary": summary,
        "input": job_input,
        "text": f"{within} of {len(took_ms)} replans took at most {LIMIT_MS:.0f} ms, the period of 20 Hz; the motion "
        f"was replanned every {with_unit(job_input.period_s, 's')}, {with_unit(job_input.horizon_s, 's')} ahead.",
        "ends": "at its place of rest" if at_rest else f"{with_unit(summary.goal_gap_m, 'm')} from its place of rest",
        "pushes": [{"at_s": at_s, "text": push_text(push)} for at_s, push in felt],
        "chart": await run_in_threadpool(replan_chart, columns, job_input.pushes, job_input.period_s),
        "limit_ms": LIMIT_MS,
    }


async def receding_plot(client: AsyncClient, job_id: str, result: JobResult) -> dict[str, Any]:
    """Plot document of the same page."""
    columns = await _read_table(client, job_id)
    job_input = PlanRecedingInput.model_validate(result.input)
    return await run_in_threadpool(receding_curves, columns, job_input.pushes, job_input.period_s)


async def _read_table(client: AsyncClient, job_id: str) -> Columns:
    content = await client.read_artifact(job_id, TABLE)
    return await run_in_threadpool(read_columns, content)
