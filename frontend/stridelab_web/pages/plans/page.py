"""The page of one plan: its progress, then its certificate, its replay and its curves."""

from typing import Any
from urllib.parse import urlencode

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import Job
from stridelab.schemas.plans import PLAN_STAGES, PlanMotionSummary
from stridelab.schemas.scenarios import Scenario
from stridelab_web.api_client import JobFiles, client_of, none_if_missing, took_s
from stridelab_web.assets import plotly_style_ids
from stridelab_web.pages.plans.answer import plan_answer
from stridelab_web.pages.plans.comparison import PlanFacts
from stridelab_web.pages.plans.comparison_page import KIND, compare_plans, curves_of, other_plan
from stridelab_web.pages.plans.cost_table import NOT_MINIMISED, cost_rows, cost_text
from stridelab_web.pages.plans.durations import ChosenDurations, chosen_durations
from stridelab_web.pages.plans.plots import CENTROIDAL_TABLE, REPLAY_TABLE, pair_curves, plan_curves, replayed_curves
from stridelab_web.pages.render import render_page
from stridelab_web.pages.terms.checks import CHAPTER, check_term
from stridelab_web.pages.terms.plans import COST_COLUMNS, PLAN_TERMS, REPLAY_TERMS, STAGE_TERMS
from stridelab_web.parquet import read_columns

SCENARIO_FILE = "scenario.json"


async def plan_page(request: Request) -> Response:
    """``GET /plans/{id}``; with ``watch`` the page opens the viewer as soon as the plan is finished.

    ``with`` is the id of another plan that is shown beside this one.
    """
    client = client_of(request)
    job = await client.job(request.path_params["id"])
    if job.kind != KIND:
        return RedirectResponse(f"/jobs/{job.id}", status_code=303)
    result = await client.result(job.id) if job.has_result else None
    summary = PlanMotionSummary.model_validate(result.summary) if result else None
    other_id = request.query_params.get("with", "")
    facts = PlanFacts(result.input, summary) if result and summary else None
    pair = await compare_plans(client, job, facts, other_id) if facts else None
    files = JobFiles(client, job.id)
    durations = await _load_durations(files, summary)
    beside = f"?{urlencode({'with': other_id})}" if pair and pair.other else ""
    watch = f"/view/?plan={job.id}"
    moves = summary is not None and (summary.certificate is not None or summary.stopped is not None)
    return render_page(
        request,
        "pages/plan.html",
        section="Scenarios",
        job=job,
        took_s=took_s(job),
        result=result,
        summary=summary,
        scenario_name=summary.scenario_name if summary else await _scenario_name(client, job),
        answer=plan_answer(summary) if summary else None,
        check_term=check_term,
        plan_terms=PLAN_TERMS,
        replay_terms=REPLAY_TERMS,
        stage_terms=STAGE_TERMS,
        cost_columns=COST_COLUMNS,
        checks_chapter=CHAPTER,
        plots=result is not None,
        plots_url=f"/plans/{job.id}/plots.json{beside}",
        plotly_style_ids=plotly_style_ids() if result else (),
        viewer_url=watch if moves else None,
        then=f"{watch}&play=1" if "watch" in request.query_params else None,
        stages=_stage_times(summary),
        replayed=result is not None and any(item.name == REPLAY_TABLE for item in result.artifacts),
        costs_of=cost_rows(summary) if summary else [],
        objective=cost_text(summary.objective) if summary else "",
        not_minimised=NOT_MINIMISED if facts and facts.has_wrench_control else "",
        pair=pair,
        durations=durations,
        gone=files.gone,
    )


async def plots_json(request: Request) -> Response:
    """``GET /plans/{id}/plots.json``: the curves of the plan and, with ``with``, of another plan."""
    client = client_of(request)
    job_id = request.path_params["id"]
    result = await client.result(job_id)
    if all(item.name != CENTROIDAL_TABLE for item in result.artifacts):
        raise HTTPException(404, "This job has no curves.")
    own = await curves_of(client, job_id)
    steps = result.summary.get("shape") != "cubic"
    scenario = Scenario.model_validate_json(await client.read_artifact(job_id, SCENARIO_FILE))
    if other_id := request.query_params.get("with"):
        facts, other = await other_plan(client, job_id, other_id)
        steps = steps and facts.summary.shape != "cubic"
        drawn = await run_in_threadpool(lambda: pair_curves(own, other, scenario, steps=steps))
    elif any(item.name == REPLAY_TABLE for item in result.artifacts):
        measured = await run_in_threadpool(read_columns, await client.read_artifact(job_id, REPLAY_TABLE))
        drawn = await run_in_threadpool(lambda: replayed_curves(own, measured, scenario, steps=steps))
    else:
        drawn = await run_in_threadpool(lambda: plan_curves(own, scenario, steps=steps))
    return JSONResponse(drawn, headers={"Cache-Control": "private, max-age=600"})


async def _scenario_name(client: AsyncClient, job: Job) -> str:
    """Name of the scenario of a plan without a result; empty if the scenario is deleted or was part of the request."""
    scenario = await none_if_missing(client.scenario(job.scenario_id)) if job.scenario_id else None
    return scenario.name if scenario else ""


async def _load_durations(files: JobFiles, summary: PlanMotionSummary | None) -> ChosenDurations | None:
    if summary is None or summary.phase_durations is None:
        return None
    content = await files.read_file(SCENARIO_FILE)
    return chosen_durations(summary.phase_durations, Scenario.model_validate_json(content)) if content else None


def _stage_times(summary: PlanMotionSummary | None) -> list[dict[str, Any]]:
    """Time of every stage, and its share of the total in percent."""
    times_s = summary.stage_times_s if summary else {}
    order = [*(name for name in PLAN_STAGES if name in times_s), *(name for name in times_s if name not in PLAN_STAGES)]
    times = {name: times_s[name] for name in order}
    whole = sum(times.values()) or 1.0
    return [{"name": name, "time_s": time_s, "share": 100 * time_s / whole} for name, time_s in times.items()]
