"""The page of one job and, once it has succeeded, of its result."""

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response

from stridelab.client import AsyncClient, ProblemError
from stridelab.schemas.jobs import Job, JobResult
from stridelab.schemas.recordings import Recording
from stridelab_web.api_client import client_of
from stridelab_web.assets import plotly_style_ids
from stridelab_web.pages import reproduction
from stridelab_web.pages.render import page
from stridelab_web.pages.results import comparison, cycloid, population, reachability, receding, sweep
from stridelab_web.pages.results.com_plots import COM_TABLE, com_curves
from stridelab_web.pages.results.quality import shown_quality
from stridelab_web.pages.results.summary_facts import facts_of, sentences_of
from stridelab_web.parquet import read_columns
from stridelab_web.scene.result_files import SCENARIO, SCENE_TABLES


async def job(request: Request) -> Response:
    """``GET /jobs/{id}``."""
    client = client_of(request)
    found = await client.job(request.path_params["id"])
    if found.kind == "plan-motion":
        return RedirectResponse(f"/plans/{found.id}", status_code=303)
    if found.kind == population.KIND:
        return RedirectResponse(f"/population/{found.id}", status_code=303)
    result = await client.result(found.id) if found.state == "succeeded" else None
    recording = await _recording_of(client, found, result)
    compared = None
    if result is not None and found.kind == comparison.KIND:
        compared = comparison.comparison_of(found.id, result, request.query_params.get("figure", ""))
    rolled = None
    if result is not None and found.kind == cycloid.KIND:
        rolled = await cycloid.cycloid_of(client, found.id, result, request.query_params.get("step", ""))
    reach = None
    if result is not None and found.kind == reachability.KIND:
        reach = await reachability.learned_of(client, found.id, result)
    swept = None
    if result is not None and found.kind == sweep.KIND:
        swept = await sweep.sweep_of(client, found.id, result)
    walked = None
    if result is not None and found.kind == receding.KIND:
        walked = await receding.receding_of(client, found.id, result)
    facts = facts_of(result) if result else []
    present = {item.name for item in result.artifacts} if result is not None else set()
    curves = COM_TABLE in present and rolled is None
    plots = curves or walked is not None or (compared is not None and compared["figure"] is not None)
    return page(
        request,
        "pages/job.html",
        section="Jobs",
        job=found,
        took_s=took_s(found),
        result=result,
        quality=shown_quality(result.summary) if result else None,
        facts=reachability.beside(facts) if reach else facts,
        sentences=sentences_of(result) if result else [],
        recording=recording,
        plots=plots,
        plots_url=compared["plots_url"] if compared else f"/jobs/{found.id}/plots.json",
        comparison=compared,
        cycloid=rolled,
        learned=reach,
        sweep=swept,
        receding=walked,
        reproduction=reproduction.reproduction_of(result) if result and found.kind == reproduction.KIND else None,
        plotly_style_ids=plotly_style_ids() if plots or reach else (),
        viewer_url=_viewer_url(found, recording, present),
    )


async def plots(request: Request) -> Response:
    """``GET /jobs/{id}/plots.json``: the curves of the result, for its page."""
    client = client_of(request)
    result = await client.result(request.path_params["id"])
    if result.kind == receding.KIND:
        drawn = await receding.curves(client, request.path_params["id"], result)
    elif any(item.name == COM_TABLE for item in result.artifacts):
        content = await client.read_artifact(request.path_params["id"], COM_TABLE)
        drawn = await run_in_threadpool(lambda: com_curves(read_columns(content), result.summary))
    else:
        raise HTTPException(404, "This job has no curves.")
    return JSONResponse(drawn, headers={"Cache-Control": "private, max-age=600"})


def _viewer_url(found: Job, recording: Recording | None, present: set[str]) -> str | None:
    """Where the result is to be seen in 3D, if it is."""
    if recording is not None and present & SCENE_TABLES:
        return f"/view/?recording={recording.id}&job={found.id}"
    return f"/view/?plan={found.id}" if found.kind == receding.KIND and SCENARIO in present else None


async def _recording_of(client: AsyncClient, found: Job, result: JobResult | None) -> Recording | None:
    recording_id = found.recording_id or (result.input.get("recording_id") if result else None)
    if recording_id is None:
        return None
    try:
        return await client.recording(recording_id)
    except ProblemError as refusal:
        if refusal.status == 404:  # a recording may be gone while its job is still being looked at
            return None
        raise


def took_s(found: Job) -> float | None:
    """Seconds from start to end of a job that has finished."""
    if found.started_at is None or found.finished_at is None:
        return None
    return (found.finished_at - found.started_at).total_seconds()
