"""The viewer's page: a frame with viser's client beside our own timeline or list of contacts."""

import gzip
import itertools
from dataclasses import replace
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient, ProblemError
from stridelab.schemas.jobs import Job
from stridelab.schemas.recordings import Recording
from stridelab.translations.catalogue import gettext, ngettext
from stridelab_web.api_client import JobFiles, client_of, read_tracks
from stridelab_web.assets import gzip_response
from stridelab_web.charts import intervals
from stridelab_web.charts.intervals import Layer, Row
from stridelab_web.languages import in_english
from stridelab_web.pages import robot
from stridelab_web.pages.render import render_page
from stridelab_web.pages.results import measures
from stridelab_web.pages.verdicts import shown_verdict
from stridelab_web.pages.viewer import planner
from stridelab_web.parquet import read_columns, read_texts
from stridelab_web.scene.body_frames import BODY
from stridelab_web.scene.documents import Document, document_of
from stridelab_web.scene.frame_cache import FrameCache
from stridelab_web.scene.frames import FORCE_SCALE, Frames
from stridelab_web.scene.recording_frames import SKELETON
from stridelab_web.scene.result_files import frames_of, second_recording, shown_in_scene
from stridelab_web.scene.second_walk import OTHER

GZIP_LEVEL: Final = 6
RECORDING_LAYERS = (
    Layer(BODY, "Body", tooltip="Drawn around the joint centres of the segment model; its thickness is not measured"),
    Layer("/markers/", "Markers"),
    Layer(SKELETON, "Lines", False, tooltip="Lines between markers"),
    Layer("/forces/plate", "Forces", scale=FORCE_SCALE),
    Layer("/forces/total", "Total force", False),
)
COM_LAYERS = (
    Layer("/paths/", "Path"),
    Layer("/com/band", "Band"),
    Layer("/inputs/geometry/", "Markers only"),
    Layer("/axis/", "Central axis"),
    Layer("/inputs/axis/", "Point on axis", False),
)

WHEEL = "fit-cycloid"
STEP_TABLE: Final = "steps.parquet"
"""Table of measures of gait with a row per step."""
WHEEL_LAYERS = (Layer("/wheel/", "Wheel"),)
STABILITY_LAYERS = (
    Layer("/stability/xcom", "Extrapolated CoM", tooltip="On the floor: where the body would come to rest"),
    Layer("/stability/base", "Base of support"),
    Layer(
        "/margin/", "Margin of stability", tooltip="Sideways to the edge of the standing foot; red where it is negative"
    ),
    Layer("/momentum/", "Angular momentum", False),
)
SECOND_WALK_LAYER: Final = Layer(
    f"{OTHER}/",
    "Another walk",
    False,
    tooltip="The next recording of this result, aligned at the first strike of a foot",
)
KIND_LAYERS: Final = {WHEEL: WHEEL_LAYERS} | dict.fromkeys(measures.KINDS, STABILITY_LAYERS)


async def view_page(request: Request) -> Response:
    """``GET /view/?recording=&job=&t=``, ``?plan=&t=``, ``?scenario=`` or ``?robot=&measure=&effector=``.

    Without ``job``, the newest estimate of the recording is shown. Without ``t``, a recording opens where the force is
    measured, because many files begin before the subject is visible.
    """
    query = request.query_params
    if any(query.get(name) for name in ("plan", "scenario", "robot")):
        return await in_english(_robot_page)(request)
    return await _recording_page(request)


async def _robot_page(request: Request) -> Response:
    """The scene of a plan, of a scenario or of a robot."""
    query = request.query_params
    if plan_id := query.get("plan"):
        return await planner.plan_page(request, plan_id)
    if scenario_id := query.get("scenario"):
        return await planner.scenario_page(request, scenario_id)
    return await robot.robot_view_page(request, query["robot"])


async def frames_bin(request: Request) -> Response:
    """``GET /view/scene/{kind}/{id}/{job}/frames.bin``: the frames, packed (``frame_codec``) and compressed.

    Frames of plans are cached: plans do not change, and packing takes longer than the start of viser's client.
    """
    document = _moving_document(request)
    cache: FrameCache = request.app.state.packed
    packed = await cache.cached_frames(client_of(request), document)
    if packed is None:
        frames = await _load_frames(client_of(request), document)
        packed = await run_in_threadpool(lambda: gzip.compress(frames.to_bytes(), compresslevel=GZIP_LEVEL, mtime=0))
        if document.kind == "plan":
            cache.store_frames(document, packed)
    return gzip_response(request, packed, "application/octet-stream", {"Cache-Control": "no-store"})


async def _recording_page(request: Request) -> Response:
    client, query = client_of(request), request.query_params
    job_id = query.get("job", "")
    recording_id = query.get("recording", "")
    if job_id and not recording_id:
        recording_id = (await client.job(job_id)).recording_id or ""
    if not recording_id:
        return render_page(
            request,
            "pages/error.html",
            404,
            title=gettext("Nothing to show"),
            explanation="",
            detail=gettext(
                "The viewer needs a recording, a scenario, a plan or a robot: open one and press its 3D button."
            ),
            code="",
            status=404,
            errors=[],
        )
    recording = await client.recording(recording_id)
    job_id = job_id or await _newest_job(client, "estimate-com", recording.id)
    measured = intervals.interval_bars(recording.windows_s, recording.duration_s)
    plates = [intervals.plate_bars(plate, recording.duration_s) for plate in recording.plates if plate.use]
    layers = list(RECORDING_LAYERS)
    links = [(gettext("Recording"), f"/recordings/{recording.id}")]
    steps_s = await _steps_s(client, recording.id, job_id)
    verdict = None
    if job_id:
        job, result_url = await client.job(job_id), f"/jobs/{job_id}"
        layers += [*COM_LAYERS, *KIND_LAYERS.get(job.kind, ())]
        if job.kind in measures.KINDS and await _has_second_walk(client, job, recording.id):
            layers.append(SECOND_WALK_LAYER)
        links.append((gettext("Result"), result_url))
        verdict = shown_verdict(job, result_url)
    numbered = intervals.numbered_bars(steps_s, recording.duration_s, first=1)
    steps_text = ngettext(
        "%(num)s step, from strike to strike or, of the wheel, from foot off to foot off",
        "%(num)s steps, from strike to strike or, of the wheel, from foot off to foot off",
        len(steps_s),
    )
    return render_page(
        request,
        "viewer/view.html",
        section="Viewer",
        title=recording.filename,
        scene=(scene := Document("recording", recording.id, job_id or None).address),
        start_s=recording.windows_s[0][0] if recording.windows_s else 0.0,
        rows=[
            Row(gettext("Measured"), measured, intervals.windows_text(recording), "window"),
            *([Row(gettext("Step"), numbered, steps_text, "phase")] if steps_s else []),
            *(Row(gettext("Plate %(index)s", index=plate.index), plate.bars, plate.text, "load") for plate in plates),
        ],
        moments=(),
        steps=steps_s,
        downloads=[(text, f"{scene}/{name}") for name, text in planner.EXPORTS.items()],
        layers=[layer.translated() for layer in layers],
        uploads=True,
        bodies=True,
        bands=bool(job_id),
        links=links,
        verdict=verdict,
    )


def _moving_document(request: Request) -> Document:
    """The document of a request. Raises ``HTTPException`` if it does not exist or does not move."""
    try:
        document = document_of(request.path_params)
    except KeyError as error:
        raise HTTPException(404, "There is no such scene.") from error
    if document.kind in ("scenario", "robot"):
        raise HTTPException(404, f"A {document.kind} does not move by itself.")
    return document


async def _load_frames(client: AsyncClient, document: Document) -> Frames:
    if document.kind == "plan":
        return await planner.load_frames(client, document.id)
    recording = await client.recording(document.id)
    tracks = await read_tracks(client, recording.id)
    job_id = document.job_id
    if job_id is None:
        return await run_in_threadpool(frames_of, recording, tracks, {})
    result = await client.result(job_id)
    present = [item.name for item in result.artifacts]
    files = JobFiles(client, job_id)
    shown = {name: content for name in shown_in_scene(present) if (content := await files.read_file(name)) is not None}
    other_id = second_recording(present, result.summary, recording.id)
    second = None if other_id is None else await _second_walk(client, other_id)
    # A minute of markers takes longer than other requests may wait.
    frames = await run_in_threadpool(frames_of, recording, tracks, shown, second)
    return replace(frames, gone=tuple(files.gone))


async def _second_walk(client: AsyncClient, recording_id: str) -> tuple[Recording, bytes] | None:
    """A recording and its tracks; None if it has been deleted."""
    try:
        return await client.recording(recording_id), await read_tracks(client, recording_id)
    except ProblemError:
        return None


async def _has_second_walk(client: AsyncClient, job: Job, recording_id: str) -> bool:
    if job.state != "succeeded":
        return False
    result = await client.result(job.id)
    return second_recording([item.name for item in result.artifacts], result.summary, recording_id) is not None


async def _newest_job(client: AsyncClient, kind: str, recording_id: str) -> str:
    listed = await client.jobs(1, state="succeeded", kind=kind, recording_id=recording_id)
    return listed.items[0].id if listed.items else ""


async def _steps_s(client: AsyncClient, recording_id: str, job_id: str) -> list[tuple[float, float]]:
    """Start and end of the steps of this job: from strike to strike of measures of gait, else of the wheel.

    Those of another job are of the newest fit of the wheel; empty without a fit.
    """
    kind = (await client.job(job_id)).kind if job_id else ""
    if kind in measures.KINDS:
        return await _strikes_s(client, recording_id, job_id)
    shown = kind == WHEEL
    fitted = job_id if shown else await _newest_job(client, WHEEL, recording_id)
    steps = (await client.result(fitted)).summary["steps"] if fitted else []
    return [(step["t0_s"], step["t1_s"]) for step in steps]


async def _strikes_s(client: AsyncClient, recording_id: str, job_id: str) -> list[tuple[float, float]]:
    """Steps from strike to strike; empty without their table, as in earlier versions, or if its file is gone."""
    if STEP_TABLE not in [item.name for item in (await client.result(job_id)).artifacts]:
        return []
    content = await JobFiles(client, job_id).read_file(STEP_TABLE)
    if content is None:
        return []
    recordings, columns = read_texts(content).get("recording_id", []), read_columns(content)
    at_s = columns["strike_s"].tolist() if "strike_s" in columns else []
    strikes_s = sorted(strike_s for one, strike_s in zip(recordings, at_s, strict=False) if one == recording_id)
    return list(itertools.pairwise(strikes_s))
