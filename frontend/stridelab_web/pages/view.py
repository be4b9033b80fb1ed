"""The viewer's page: a frame with viser's client, and our own timeline under it."""

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from stridelab.client import AsyncClient
from stridelab_web import strips
from stridelab_web.frames import Frames, build_frames
from stridelab_web.pages.job import COM_TABLE
from stridelab_web.pages.render import page
from stridelab_web.service import client_of, read_tracks
from stridelab_web.tables import read_columns

NO_JOB = "-"
"""Stands for "no result" in the address of a scene."""


async def view(request: Request) -> Response:
    """``GET /view/?recording=&job=&t=``; without ``job``, the newest estimate of the recording is shown.

    Without ``t`` the scene opens where the force is measured: many files begin before anybody is in sight.
    """
    client, query = client_of(request), request.query_params
    job_id = query.get("job", "")
    recording_id = query.get("recording", "")
    if job_id and not recording_id:
        recording_id = (await client.job(job_id)).recording_id or ""
    if not recording_id:
        return page(
            request,
            "error.html",
            404,
            title="Nothing to show",
            detail="The viewer needs a recording: open one and press “Open in viewer”.",
            code="",
            status=404,
            errors=[],
        )
    recording = await client.recording(recording_id)
    job_id = job_id or await _newest_estimate(client, recording.id)
    return page(
        request,
        "view.html",
        section="",
        recording=recording,
        job_id=job_id,
        scene=f"/view/scene/{recording.id}/{job_id or NO_JOB}",
        windows=strips.bars(recording.windows_s, recording.duration_s),
        windows_text=strips.windows_text(recording),
        start_s=recording.windows_s[0][0] if recording.windows_s else 0.0,
        plate_bars=[strips.plate_bars(plate, recording.duration_s) for plate in recording.plates if plate.use],
    )


async def layout(request: Request) -> Response:
    """``GET /view/scene/{recording}/{job}/frames.json``: what the numbers of ``frames.f32`` are."""
    return JSONResponse((await _frames(request)).layout())


async def values(request: Request) -> Response:
    """``GET /view/scene/{recording}/{job}/frames.f32``: little-endian float32, one row per frame."""
    content = (await _frames(request)).values.astype("<f4").tobytes()
    return Response(content, media_type="application/octet-stream")


async def _frames(request: Request) -> Frames:
    client, job_id = client_of(request), request.path_params["job"]
    recording = await client.recording(request.path_params["recording"])
    tracks = await read_tracks(client, recording.id)
    com = None if job_id == NO_JOB else await client.read_artifact(job_id, COM_TABLE)

    def build() -> Frames:
        return build_frames(recording, read_columns(tracks), None if com is None else read_columns(com))

    return await run_in_threadpool(build)  # a minute of markers takes longer than other requests may wait


async def _newest_estimate(client: AsyncClient, recording_id: str) -> str:
    found = await client.jobs(1, state="succeeded", kind="estimate-com", recording_id=recording_id)
    return found.items[0].id if found.items else ""
