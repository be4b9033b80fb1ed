"""A sweep on the page of a job, as a curve or as maps, and the page that lists sweeps."""

import asyncio
from typing import Any, Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import Job, JobResult
from stridelab.schemas.sweeps import SweepSummary
from stridelab_web.api_client import client_of
from stridelab_web.formatting import plain_number
from stridelab_web.pages.render import render_page
from stridelab_web.pages.results.sweep_maps import LEGEND, SweepGrid

KIND: Final = "sweep"
TABLE: Final = "sweep.parquet"


async def sweep_of(client: AsyncClient, job_id: str, result: JobResult) -> dict[str, Any] | None:
    """Values for the template; None for a result without its table."""
    if all(item.name != TABLE for item in result.artifacts):
        return None
    summary = SweepSummary.model_validate(result.summary)
    content = await client.read_artifact(job_id, TABLE)
    charts, borders = await run_in_threadpool(lambda: _draw_sweep(summary, content))
    left = {"rejected before solving": summary.refused, "no motion found": summary.infeasible}
    left |= {"could not be planned": summary.failed} if summary.failed else {}
    return {
        "summary": summary,
        "counts": f"Scenarios with a motion: {summary.feasible} of {summary.points}; "
        + ", ".join(f"{outcome}: {number}" for outcome, number in left.items())
        + ".",
        "present": ", ".join(
            f"{axis.field} {plain_number(axis.present)} {axis.unit}".rstrip() for axis in summary.axes
        ),
        "charts": charts,
        "borders": borders,
        "legend": LEGEND,
    }


def _draw_sweep(summary: SweepSummary, content: bytes) -> tuple[Any, Any]:
    swept = SweepGrid.from_table(summary, content)
    return swept.draw_charts(), swept.feasible_ranges()


SCOPE_NAMES: Final = {"centre of mass": "centre of mass only", "whole body": "whole body"}


async def sweeps_page(request: Request) -> Response:
    """``GET /sweeps``."""
    client = client_of(request)
    listed = await client.jobs(kind=KIND, cursor=request.query_params.get("cursor"))
    named = await asyncio.gather(*(_sweep_name(client, job) for job in listed.items))
    names = {job.id: name for job, name in zip(listed.items, named, strict=True) if name}
    return render_page(request, "pages/sweeps.html", section="Sweeps", jobs=listed.items, names=names, next=listed.next)


async def _sweep_name(client: AsyncClient, job: Job) -> str:
    return sweep_title(await client.result(job.id)) if job.state == "succeeded" else ""


def sweep_title(result: JobResult) -> str:
    """``Steps over stride, friction: 31 of 105, centre of mass only``."""
    summary = SweepSummary.model_validate(result.summary)
    fields = ", ".join(axis.field for axis in summary.axes)
    return (
        f"{summary.scenario_name} over {fields}: {summary.feasible} of {summary.points}, {SCOPE_NAMES[summary.scope]}"
    )
