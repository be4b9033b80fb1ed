"""Figures of the thesis computed anew: where they are started, and what the page of a job adds for one."""

from typing import Final, get_args

from starlette.requests import Request
from starlette.responses import Response

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.reproduction import ReproduceSummary, ReproductionItem
from stridelab_web.pages.render import page
from stridelab_web.service import client_of

KIND: Final = "reproduce"


async def reproduction(request: Request) -> Response:
    """``GET /reproduction``."""
    jobs = await client_of(request).jobs(kind=KIND)
    return page(request, "reproduction.html", section="Reproduction", items=get_args(ReproductionItem), jobs=jobs.items)


def reproduction_of(result: JobResult) -> ReproduceSummary:
    """The summary of a reproduction."""
    return ReproduceSummary.model_validate(result.summary)
