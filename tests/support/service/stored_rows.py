"""A database with something in every table, and the files that its rows name.

Recordings and jobs put straight into the tables, for tests that need them to exist rather than to be true.
"""

import asyncio
import hashlib
import tempfile
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import psycopg
from sqlalchemy import func, insert, update

from stridelab.schemas.recordings import PlateInfo, RecordingFacts, SubjectFields
from stridelab.schemas.robots import RobotFacts
from stridelab.service.api.dependencies import Parts
from stridelab.service.jobs.attempts import AttemptStore
from stridelab.service.jobs.events import emit_event
from stridelab.service.jobs.queue import Attempt
from stridelab.service.kinds.registry import KINDS
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.tables import job, recording, robot

AWKWARD = 'tab\there, line\nbreak, back\\slash, \\., "quotes", Ünïcode \U0001f9b6'
FILES = {
    "uploads/" + "a" * 64: b"C3D" * 5000,
    "recordings/rec1/tracks.parquet": b"PAR1",
    "recordings/rec2/trial.c3d": b"",
    "recordings/rec2/tracks.parquet": b"PAR1" * 300_000,
    "results/done/1/com.csv": b"time_s\n0.0\n",
    "results/half/2/half.csv": b"x",
}
_RECORDING = (
    "INSERT INTO recording (id, filename, sha256, bytes, blob_key, tracks_key, facts, subject_fields, subject_id,"
    " static_recording_id, truth_job_id) VALUES (%s, %s, 's', 5, %s, %s, '{\"labels\": [\"a\"]}', '{}', %s, %s, %s)"
)
_JOB = (
    "INSERT INTO job (id, kind, state, attempt, input, input_hash, recording_id, created_at, blob_prefix, result,"
    " message) VALUES (%s, 'work', %s, %s, '{\"n\": 1e-7}', 'h', %s, now() - %s * interval '1 s', %s, %s, %s)"
)


def fill_tables(url: str, blobs: Path) -> None:
    """Rows in every table that the first schema has too, jobs in every state, and all files."""
    with psycopg.connect(url) as connection:
        connection.execute("INSERT INTO subject (id, fields) VALUES ('p1', '{\"name\": \"P\\u00e4r\"}')")
        connection.execute("INSERT INTO scenario (id, body) VALUES ('sc', '{\"a\": [1, null]}')")
        names = list(FILES)
        connection.execute(_RECORDING, ("rec1", AWKWARD, names[0], names[1], "p1", None, None))
        artifacts = '{"artifacts": [{"name": "%s", "media_type": "text/csv", "bytes": 1}]}'
        jobs: list[tuple[Any, ...]] = [
            ("done", "succeeded", 1, "rec1", 9, "results/done/1", artifacts % "com.csv", AWKWARD),
            ("half", "failed", 2, None, 8, "results/half/2", artifacts % "half.csv", ""),
            ("gone", "cancelled", 0, None, 7, None, None, ""),
            ("at-work", "running", 2, "rec1", 6, None, None, "half"),
            ("second", "queued", 0, None, 4, None, None, ""),
            ("first", "queued", 0, None, 5, None, None, ""),
        ]
        for job in jobs:
            connection.execute(_JOB, job)
            connection.execute(
                "INSERT INTO job_event (job_id, state, attempt, fraction, message) VALUES (%s, %s, %s, 0.25, %s)",
                (job[0], job[1], job[2], AWKWARD),
            )
        connection.execute(_RECORDING, ("rec2", "two", names[2], names[3], None, "rec1", "done"))
    store(blobs)


def store(blobs: Path) -> None:
    """All files, into the folder ``blobs``."""
    blobs_store = BlobStore.from_url(blobs.as_uri())
    draft = blobs.parent / "draft"

    async def put() -> None:
        for key, content in FILES.items():
            draft.write_bytes(content)
            await blobs_store.put_file(key, draft)

    asyncio.run(put())
    draft.unlink()


def read_stored_files(blobs: Path) -> dict[str, bytes]:
    """Everything in the folder ``blobs``."""
    return {str(path.relative_to(blobs)): path.read_bytes() for path in blobs.rglob("*") if path.is_file()}


def read_rows(url: str) -> dict[str, list[dict[str, Any]]]:
    """All rows of our own tables, in order of their keys."""
    tables = {"subject": "id", "scenario": "id", "recording": "id", "job": "id", "job_event": "seq"}
    with psycopg.connect(url) as connection:
        cursor = connection.cursor(row_factory=psycopg.rows.dict_row)
        return {name: cursor.execute(f"SELECT * FROM {name} ORDER BY {key}").fetchall() for name, key in tables.items()}


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
    start = update(job).values(state="running", attempt=job.c.attempt + 1, started_at=func.now())
    async with parts.engine.begin() as connection:
        started = await connection.execute(start.where(job.c.id == job_id, job.c.state == "queued").returning(job))
        row = started.mappings().one()
        await emit_event(connection, job_id)
    return Attempt(row["id"], row["attempt"], row["kind"], dict(row))


async def report_progress(parts: Parts, attempt: Attempt, fraction: float, message: str) -> None:
    assert await AttemptStore(parts.engine, KINDS).report_progress(attempt, fraction, message)


async def publish_result(
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
        assert await AttemptStore(parts.engine, KINDS).publish_success(
            attempt, parts.blobs, outcome, artifacts, folder, "log"
        )


async def fail_attempt(parts: Parts, attempt: Attempt, partial: tuple[Any, list[Any]] | None = None) -> None:
    problem = {"code": "no-plates", "detail": "No plates.", "errors": [{"where": "plates", "message": "none"}]}
    assert await AttemptStore(parts.engine, KINDS).end_attempt(attempt, "failed", problem, "log", partial)


async def pause(seconds: float) -> None:
    await asyncio.sleep(seconds)


async def add_own_robot(parts: Parts, name: str) -> None:
    """Insert a robot of a user; its files exist and hold nothing that anybody reads."""
    facts = RobotFacts(
        name=name,
        title=name,
        mass_kg=50.0,
        licence="",
        sha256="0" * 64,
        effectors=[],
        q_reference=[],
        com_height_m=0.8,
        limits=[],
        links=[],
        link_poses=[],
        proxies=[],
        measures=[],
        stale_measures=[],
        default_measure="conditioned",
    )
    row = {
        "id": uuid.uuid4().hex,
        "name": name,
        "filename": "robot.zip",
        "sha256": "0" * 64,
        "bytes": 0,
        "bundle_key": f"own-robots/{name}/robot.zip",
        "links_key": f"own-robots/{name}/links.glb",
        "state": "proposed",
        "card": {"title": name, "licence": "", "effectors": {}},
        "assumed": {},
        "facts": facts.model_dump(mode="json"),
        "shapes": {},
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "file")
        file.write_bytes(b"glTF")
        for key in ("bundle_key", "links_key"):
            await parts.blobs.put_file(str(row[key]), file)
    async with parts.engine.begin() as connection:
        await connection.execute(insert(robot).values(row))
