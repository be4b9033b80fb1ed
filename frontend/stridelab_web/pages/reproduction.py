"""Figures of the thesis computed anew: where they are started, and what the page of a job adds for one."""

import asyncio
from typing import Final, get_args

from starlette.requests import Request
from starlette.responses import Response

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.reproduction import ReproduceSummary, ReproductionItem
from stridelab_web.pages.render import page
from stridelab_web.service import client_of
from stridelab_web.words import item, verdict

KIND: Final = "reproduce"


async def reproduction(request: Request) -> Response:
    """``GET /reproduction``."""
    client = client_of(request)
    jobs = (await client.jobs(kind=KIND)).items
    done = [job for job in jobs if job.state == "succeeded"]
    results = await asyncio.gather(*(client.result(job.id) for job in done))
    names = {job.id: _named(reproduction_of(result)) for job, result in zip(done, results, strict=True)}
    return page(
        request, "reproduction.html", section="Reproduction", items=get_args(ReproductionItem), jobs=jobs, names=names
    )


def _named(summary: ReproduceSummary) -> str:
    return f"{item(summary.item)}: {verdict(summary.verdict)}"


def reproduction_of(result: JobResult) -> ReproduceSummary:
    """The summary of a reproduction."""
    return ReproduceSummary.model_validate(result.summary)
