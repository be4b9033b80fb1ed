"""Comparison section of the page of a plan: the plans to choose from, and two plans in one table."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from stridelab.client import AsyncClient, ProblemError
from stridelab.schemas.jobs import Job
from stridelab.schemas.plans import PlanMotionSummary
from stridelab_web.formatting import code_words, utc_text, with_unit
from stridelab_web.pages.plans.comparison import PairRow, PlanFacts, max_com_distance, pair_remarks, pair_rows
from stridelab_web.pages.plans.plots import CENTROIDAL_TABLE
from stridelab_web.parquet import Columns, read_columns

KIND: Final = "plan-motion"
MAX_OFFERS: Final = 20
"""Maximum number of newest plans of the same scenario, and of all scenarios; each one's result is read."""


@dataclass(frozen=True)
class Offer:
    """A plan that can be chosen; its label contains ``created_at`` in UTC."""

    id: str
    label: str
    same: bool
    created_at: datetime


@dataclass(frozen=True)
class PlanComparison:
    """Plans to choose from, and the comparison with the chosen one; ``refusal`` is why it cannot be shown."""

    offers: Sequence[Offer]
    chosen: str = ""
    refusal: str = ""
    other: str = ""
    other_at: datetime | None = None
    remarks: Sequence[str] = ()
    rows: Sequence[PairRow] = field(default_factory=list)


async def compare_plans(client: AsyncClient, job: Job, facts: PlanFacts, chosen: str) -> PlanComparison:
    """The plans to choose from, those of the same scenario first, and the comparison with the ``chosen`` one."""
    offers = await _list_offers(client, job, facts)
    if not chosen:
        return PlanComparison(offers)
    try:
        other, columns = await other_plan(client, job.id, chosen)
        own = await curves_of(client, job.id)
    except HTTPException as refusal:
        return PlanComparison(offers, chosen, refusal=refusal.detail)
    other_job = await client.job(chosen)
    distance_m, at_s = await run_in_threadpool(max_com_distance, own, columns)
    distance_row = PairRow(
        "furthest", "CoM paths apart, at most", "", "", f"{with_unit(distance_m, 'm')} at {at_s:.2f} s", group="Paths"
    )
    return PlanComparison(
        offers,
        chosen,
        other=f"{other.summary.scenario_name}, {utc_text(other_job.created_at)}",
        other_at=other_job.created_at,
        remarks=pair_remarks(facts, other),
        rows=[*pair_rows(facts, other), distance_row],
    )


async def other_plan(client: AsyncClient, job_id: str, chosen: str) -> tuple[PlanFacts, Columns]:
    """Facts and curves of the ``chosen`` plan. Raises ``HTTPException`` unless it is a finished plan."""
    if chosen == job_id:
        raise HTTPException(409, "This is the same plan: choose another one.")
    try:
        job = await client.job(chosen)
    except ProblemError as error:
        if error.status in (404, 422):
            raise HTTPException(404, "The other plan does not exist; it may have been deleted.") from error
        raise
    if job.kind != KIND:
        raise HTTPException(409, "The other job is not a plan.")
    if job.state != "succeeded":
        raise HTTPException(409, f"The other plan is {code_words(job.state)}: it has nothing to compare.")
    return await _plan_facts(client, chosen), await curves_of(client, chosen)


async def curves_of(client: AsyncClient, job_id: str) -> Columns:
    """The table of the plan at its nodes."""
    content = await client.read_artifact(job_id, CENTROIDAL_TABLE)
    return await run_in_threadpool(read_columns, content)


async def _list_offers(client: AsyncClient, job: Job, facts: PlanFacts) -> list[Offer]:
    newest = list((await client.jobs(MAX_OFFERS, state="succeeded", kind=KIND)).items)
    if job.scenario_id is not None:
        same = await client.jobs(MAX_OFFERS, state="succeeded", kind=KIND, scenario_id=job.scenario_id)
        newest = [*same.items, *newest]
    others = {each.id: each for each in newest if each.id != job.id}
    offers = await asyncio.gather(*(_make_offer(client, each, job, facts) for each in others.values()))
    return sorted((offer for offer in offers if offer is not None), key=lambda offer: not offer.same)


async def _make_offer(client: AsyncClient, other: Job, job: Job, facts: PlanFacts) -> Offer | None:
    try:
        other_facts = await _plan_facts(client, other.id)
    except ProblemError:  # deleted since it was listed
        return None
    named = (other_facts.summary.scenario_name, other_facts.summary.robot) == (
        facts.summary.scenario_name,
        facts.summary.robot,
    )
    same = named or (job.scenario_id is not None and other.scenario_id == job.scenario_id)
    parts = [
        other_facts.summary.scenario_name,
        utc_text(other.created_at),
        other_facts.control_name,
        other_facts.summary.solver,
    ]
    parts.append("whole body" if other_facts.summary.certificate else "centre of mass alone")
    return Offer(other.id, " · ".join(parts), same, other.created_at)


async def _plan_facts(client: AsyncClient, job_id: str) -> PlanFacts:
    result = await client.result(job_id)
    return PlanFacts(result.input, PlanMotionSummary.model_validate(result.summary))
