"""Recordings and jobs put straight into the tables, for tests that need them to exist rather than to be true."""

import asyncio
import hashlib
import tempfile
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import insert, select

from stridelab.schemas.recordings import PlateInfo, RecordingFacts, SubjectFields
from stridelab.service.api.parts import Parts
from stridelab.service.jobs.attempts import Attempt, Attempts
from stridelab.service.jobs.kinds.registry import KINDS
from stridelab.service.jobs.queue import Delivery
from stridelab.service.storage.tables import job, recording

CORNERS_M = [[0.3, 0.2, 0.0], [-0.3, 0.2, 0.0], [-0.3, -0.2, 0.0], [0.3, -0.2, 0.0]]


def facts(**changes: Any) -> RecordingFacts:
    known: dict[str, Any] = {
        "duration_s": 1.0,
        "n_frames": 101,
        "marker_rate_hz": 100.0,
        "force_rate_hz": 1000.0,
        "marker_set": "plug-in-gait",
        "n_markers": 2,
        "subject": SubjectFields(mass_kg=60.0),
        "mass_from_force_kg": 60.2,
        "plates": [PlateInfo(index=i, type=2, corners_m=CORNERS_M, loaded_s=[(0.2, 0.8)]) for i in (1, 2)],
        "windows_s": [(0.3, 0.7)],
        "up_axis": "z",
        "walking_direction": [1.0, 0.0, 0.0],
        "labels": ["LASI", "RASI"],
        "landmarks": {"l_asis": "LASI", "r_asis": "RASI"},
        "missing_landmarks": ["head_top"],
        "warnings": [],
    }
    return RecordingFacts.model_validate({**known, **changes})


async def add_recording(
    parts: Parts, recording_id: str | None = None, content: bytes | None = None, **columns: Any
) -> str:
    """Insert a recording with two small files; their ``content`` is its id unless given; returns its id."""
    recording_id = recording_id or uuid.uuid4().hex
    content = recording_id.encode() if content is None else content
    values = {
        "id": recording_id,
        "filename": "walk.c3d",
        "sha256": hashlib.sha256(content).hexdigest(),
        "bytes": len(content),
        "blob_key": f"uploads/{recording_id}",
        "tracks_key": f"recordings/{recording_id}/tracks.parquet",
        "facts": facts().model_dump(mode="json"),
        "subject_fields": {},
        **columns,
    }
    with tempfile.TemporaryDirectory() as folder:
        for key in ("blob_key", "tracks_key"):
            path = Path(folder) / "file"
            path.write_bytes(content)
            await parts.blobs.put_file(values[key], path)
    async with parts.engine.begin() as connection:
        await connection.execute(insert(recording).values(values))
    return recording_id


async def add_job(parts: Parts, recording_id: str | None = None) -> str:
    """Queue a job; returns its id."""
    recording_id = recording_id or await add_recording(parts)
    submitted = await parts.store.submit("estimate-com", {"recording_id": recording_id}, recording_id=recording_id)
    return submitted.job_id


async def start_job(parts: Parts, job_id: str) -> Attempt:
    """Do what a worker does when it takes up a job."""
    async with parts.engine.connect() as connection:
        queue_id = (await connection.execute(select(job.c.queue_id).where(job.c.id == job_id))).scalar_one()
    attempt = await Attempts(parts.engine, KINDS).start(Delivery(queue_id, job_id))
    assert attempt is not None
    return attempt


async def report(parts: Parts, attempt: Attempt, fraction: float, message: str) -> None:
    assert await Attempts(parts.engine, KINDS).report(attempt, fraction, message)


async def succeed(
    parts: Parts,
    attempt: Attempt,
    files: Sequence[tuple[str, str, bytes]] = (),
    summary: Mapping[str, Any] | None = None,
) -> None:
    """Publish a result with ``files`` (name, media type, content)."""
    artifacts = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, media_type, content in files:
            (folder / file).write_bytes(content)
            await parts.blobs.put_file(f"{attempt.blob_prefix}/{file}", folder / file)
            artifacts.append({"name": file, "media_type": media_type, "bytes": len(content)})
        outcome = {
            "summary": {"mass_kg": 60.2} if summary is None else dict(summary),
            "references": ["carpentier2017thesis"],
            "versions": {"stridelab": "0.1.0"},
        }
        assert await Attempts(parts.engine, KINDS).succeed(attempt, parts.blobs, outcome, artifacts, folder, "log")


async def fail(parts: Parts, attempt: Attempt, kept: tuple[Any, list[Any]] | None = None) -> None:
    problem = {"code": "no-plates", "detail": "No plates.", "errors": [{"where": "plates", "message": "none"}]}
    assert await Attempts(parts.engine, KINDS).end(attempt, "failed", problem, "log", kept)


async def pause(seconds: float) -> None:
    await asyncio.sleep(seconds)
