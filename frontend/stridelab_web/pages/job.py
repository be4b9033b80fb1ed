"""The page of one job and of its result."""

from typing import Any, Final

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import QueryParams
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import Job, JobResult
from stridelab.schemas.recordings import Recording
from stridelab_web.api_client import JobFiles, client_of, none_if_missing, took_s
from stridelab_web.assets import plotly_style_ids
from stridelab_web.pages import reproduction
from stridelab_web.pages.render import render_page
from stridelab_web.pages.results import (
    com_bench,
    comparison,
    cycloid,
    imitation,
    measures,
    population,
    push_basin,
    reachability,
    receding,
    sweep,
)
from stridelab_web.pages.results.com_plots import COM_TABLE, com_curves
from stridelab_web.pages.results.quality import shown_quality
from stridelab_web.pages.results.summary_facts import facts_of, headline_of, main_and_other_facts, sentences_of
from stridelab_web.parquet import read_columns
from stridelab_web.scene.result_files import SCENARIO, SCENE_TABLES

VIEWS: Final = (
    "comparison",
    "cycloid",
    "learned",
    "sweep",
    "receding",
    "measures",
    "com_bench",
    "reproduction",
    "basin",
    "imitation",
)
"""Views of a result in the template."""
TRANSLATED: Final = frozenset({"comparison", "cycloid", "measures", "com_bench"})
"""Those of them that exist in all languages."""


async def job_page(request: Request) -> Response:
    """``GET /jobs/{id}``."""
    client = client_of(request)
    job = await client.job(request.path_params["id"])
    if job.kind == "plan-motion":
        return RedirectResponse(f"/plans/{job.id}", status_code=303)
    if job.kind == population.KIND:
        return RedirectResponse(f"/population/{job.id}", status_code=303)
    result = await client.result(job.id) if job.state == "succeeded" else None
    recording = await _recording_of(client, job, result)
    views: dict[str, Any] = dict.fromkeys(VIEWS)
    files = JobFiles(client, job.id)
    if result is not None:
        views |= await _result_view(files, job, result, request.query_params)
    facts, other_facts = main_and_other_facts(result, facts_of(result)) if result else ([], [])
    present = {item.name for item in result.artifacts} if result is not None else set()
    compared, learned = views["comparison"], views["learned"]
    curves = COM_TABLE in present and views["cycloid"] is None
    executed = views["receding"] is not None and not files.gone
    plots = curves or executed or (compared is not None and compared["figure"] is not None)
    return render_page(
        request,
        "pages/job.html",
        section="Jobs",
        job=job,
        took_s=took_s(job),
        result=result,
        quality=shown_quality(result.summary) if result else None,
        facts=reachability.facts_beside_table(facts) if learned else facts,
        other_facts=other_facts,
        headline=headline_of(result) if result else None,
        sentences=sentences_of(result) if result else [],
        english_result=any(views[name] is not None for name in VIEWS if name not in TRANSLATED),
        recording=recording,
        gone=files.gone,
        plots=plots,
        plots_url=compared["plots_url"] if compared else f"/jobs/{job.id}/plots.json",
        plotly_style_ids=plotly_style_ids() if plots or learned else (),
        **views,
        viewer_url=_viewer_url(job, recording, present),
    )


async def _result_view(files: JobFiles, job: Job, result: JobResult, query: QueryParams) -> dict[str, Any]:
    """Values of the view for the kind of the job, by the name of the view; empty for kinds that have none."""
    match job.kind:
        case comparison.KIND:
            return {"comparison": comparison.comparison_of(job.id, result, query.get("figure", ""))}
        case cycloid.KIND:
            return {"cycloid": await cycloid.cycloid_of(files, result, query.get("step", ""))}
        case reachability.KIND:
            return {"learned": await reachability.learned_of(files, result)}
        case sweep.KIND:
            return {"sweep": await sweep.sweep_of(files, result)}
        case receding.KIND:
            return {"receding": await receding.receding_of(files, result)}
        case push_basin.KIND:
            return {"basin": await push_basin.push_basin_of(files, result)}
        case imitation.KIND:
            return {"imitation": await imitation.imitation_of(files, result)}
        case com_bench.KIND:
            return {"com_bench": com_bench.com_bench_of(result)}
        case kind if kind in measures.KINDS:
            return {"measures": measures.measures_of(result)}
        case reproduction.KIND:
            drawings = await reproduction.stored_drawings(files, result)
            return {
                "reproduction": reproduction.reproduction_of(result),
                "drawings": drawings,
                "bar_of": reproduction.claim_bar,
            }
    return {}


async def plots_json(request: Request) -> Response:
    """``GET /jobs/{id}/plots.json``: the curves of the result, for its page."""
    client = client_of(request)
    result = await client.result(request.path_params["id"])
    if result.kind == receding.KIND:
        drawn = await receding.receding_plot(client, request.path_params["id"], result)
    elif any(item.name == COM_TABLE for item in result.artifacts):
        content = await client.read_artifact(request.path_params["id"], COM_TABLE)
        drawn = await run_in_threadpool(lambda: com_curves(read_columns(content), result.summary))
    else:
        raise HTTPException(404, "This job has no curves.")
    return JSONResponse(drawn, headers={"Cache-Control": "private, max-age=600"})


def _viewer_url(job: Job, recording: Recording | None, present: set[str]) -> str | None:
    """Address of the 3D view of the result, or None."""
    if recording is not None and present & SCENE_TABLES:
        return f"/view/?recording={recording.id}&job={job.id}"
    return f"/view/?plan={job.id}" if job.kind in (receding.KIND, imitation.KIND) and SCENARIO in present else None


async def _recording_of(client: AsyncClient, job: Job, result: JobResult | None) -> Recording | None:
    """The recording of a job of a single one, None for other jobs."""
    given = result.input if result else {}
    listed = given.get("recording_ids") or []
    recording_id = job.recording_id or given.get("recording_id") or (listed[0] if len(listed) == 1 else None)
    return None if recording_id is None else await none_if_missing(client.recording(recording_id))
