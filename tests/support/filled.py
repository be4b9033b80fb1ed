"""A database with something in every table, and the files that its rows name."""

import asyncio
from pathlib import Path
from typing import Any

import psycopg

from stridelab.service.storage.blobs import BlobStore

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
    "INSERT INTO job (id, kind, state, attempt, input, input_hash, recording_id, queue_id, blob_prefix, result,"
    " message) VALUES (%s, 'work', %s, %s, '{\"n\": 1e-7}', 'h', %s, %s, %s, %s, %s)"
)


def fill(url: str, blobs: Path) -> None:
    """Rows in every table that the first schema has too, jobs in every state, and all files."""
    with psycopg.connect(url) as connection:
        connection.execute("INSERT INTO subject (id, fields) VALUES ('p1', '{\"name\": \"P\\u00e4r\"}')")
        connection.execute("INSERT INTO scenario (id, body) VALUES ('sc', '{\"a\": [1, null]}')")
        names = list(FILES)
        connection.execute(_RECORDING, ("rec1", AWKWARD, names[0], names[1], "p1", None, None))
        artifacts = '{"artifacts": [{"name": "%s", "media_type": "text/csv", "bytes": 1}]}'
        jobs: list[tuple[Any, ...]] = [
            ("done", "succeeded", 1, "rec1", 4, "results/done/1", artifacts % "com.csv", AWKWARD),
            ("half", "failed", 2, None, 5, "results/half/2", artifacts % "half.csv", ""),
            ("gone", "cancelled", 0, None, 6, None, None, ""),
            ("at-work", "running", 2, "rec1", 7, None, None, "half"),
            ("second", "queued", 0, None, 9, None, None, ""),
            ("first", "queued", 0, None, 8, None, None, ""),
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
    made = BlobStore.from_url(blobs.as_uri())
    draft = blobs.parent / "draft"

    async def put() -> None:
        for key, content in FILES.items():
            draft.write_bytes(content)
            await made.put_file(key, draft)

    asyncio.run(put())
    draft.unlink()


def stored(blobs: Path) -> dict[str, bytes]:
    """Everything in the folder ``blobs``."""
    return {str(path.relative_to(blobs)): path.read_bytes() for path in blobs.rglob("*") if path.is_file()}


def rows(url: str) -> dict[str, list[dict[str, Any]]]:
    """All rows of our own tables, in order of their keys."""
    tables = {"subject": "id", "scenario": "id", "recording": "id", "job": "id", "job_event": "seq"}
    with psycopg.connect(url) as connection:
        cursor = connection.cursor(row_factory=psycopg.rows.dict_row)
        return {name: cursor.execute(f"SELECT * FROM {name} ORDER BY {key}").fetchall() for name, key in tables.items()}
