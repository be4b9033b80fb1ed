"""The bundled sample: a simulated recording whose ground truth and estimate are shipped as files.

No job is run for it. ``seed`` stores the files of ``models/recordings/sample-walk`` and writes the rows of two
succeeded jobs, so that pages, downloads and bundles need no special case for samples.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from sqlalchemy import func, select
from sqlalchemy.dialects.postgresql import insert
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from stridelab.machine.models_folder import models_dir
from stridelab.service.filenames import SIMULATED_RECORDING_FILE
from stridelab.service.jobs.store import input_hash
from stridelab.service.kinds.base import Blobs, Json
from stridelab.service.storage import locks
from stridelab.service.storage.tables import job, recording

SAMPLE_ID: Final = "sample-walk"
TRUTH_JOB: Final = "sample-walk-truth"
ESTIMATE_JOB: Final = "sample-walk-com"
SHIPPED_JOBS: Final = (TRUTH_JOB, ESTIMATE_JOB)
INDEX_FILE: Final = "sample.json"


def sample_folder() -> Path:
    """Folder of the sample's files."""
    return models_dir() / "recordings" / SAMPLE_ID


async def seed_sample(engine: AsyncEngine, blobs: Blobs, folder: Path | None = None) -> bool:
    """Write the sample of this version to the database and the store; True if anything had to be written.

    May be called by any number of processes at once and at every start. A sample of an older version is replaced.
    """
    folder = folder or sample_folder()
    index: Json = json.loads((folder / INDEX_FILE).read_text(encoding="utf-8"))
    async with engine.begin() as connection:
        await connection.execute(select(func.pg_advisory_xact_lock(locks.SAMPLE_SEEDING)))
        if await _is_stored(connection, blobs, index):
            return False
        await _store_files(blobs, folder, index)
        truth, estimate = index["jobs"][TRUTH_JOB], index["jobs"][ESTIMATE_JOB]
        await _upsert_row(connection, job, _job_row(TRUTH_JOB, truth, None))
        await _upsert_row(connection, recording, _recording_row(index))
        await _upsert_row(connection, job, _job_row(ESTIMATE_JOB, estimate, SAMPLE_ID))
    return True


def _recording_row(index: Json) -> Json:
    return {
        "id": SAMPLE_ID,
        "bundled": True,
        "filename": index["filename"],
        "sha256": index["sha256"],
        "bytes": index["bytes"],
        "blob_key": f"recordings/{SAMPLE_ID}/{SIMULATED_RECORDING_FILE}",
        "tracks_key": f"recordings/{SAMPLE_ID}/{index['tracks']}",
        "facts": index["facts"],
        "subject_fields": {},
        "truth_job_id": TRUTH_JOB,
    }


def _job_row(job_id: str, done: Json, recording_id: str | None) -> Json:
    return {
        "id": job_id,
        "kind": done["kind"],
        "state": "succeeded",
        "attempt": 1,
        "input": done["input"],
        "input_hash": input_hash(done["kind"], done["input"]),
        "recording_id": recording_id,
        "fraction": 1.0,
        "message": "shipped with the program",
        "result": done["result"],
        "blob_prefix": f"results/{job_id}/1",
        "started_at": func.now(),
        "finished_at": func.now(),
    }


async def _is_stored(connection: AsyncConnection, blobs: Blobs, index: Json) -> bool:
    row = (await connection.execute(select(recording).where(recording.c.id == SAMPLE_ID))).mappings().one_or_none()
    if row is None or any(row[name] != value for name, value in _recording_row(index).items()):
        return False
    job_rows = await connection.execute(select(job.c.id, job.c.result).where(job.c.id.in_(list(index["jobs"]))))
    shipped = {job_id: done["result"] for job_id, done in index["jobs"].items()}
    return {row.id: row.result for row in job_rows} == shipped and await blobs.exists(row["blob_key"])


async def _store_files(blobs: Blobs, folder: Path, index: Json) -> None:
    for name in (SIMULATED_RECORDING_FILE, index["tracks"]):
        await blobs.put_file(f"recordings/{SAMPLE_ID}/{name}", folder / name)
    for job_id, done in index["jobs"].items():
        for artifact in done["result"]["artifacts"]:
            await blobs.put_file(f"results/{job_id}/1/{artifact['name']}", folder / artifact["name"])


async def _upsert_row(connection: AsyncConnection, table: Any, values: Mapping[str, Any]) -> None:
    changed = {name: value for name, value in values.items() if name != "id"}
    statement = insert(table).values(**values).on_conflict_do_update(index_elements=["id"], set_=changed)
    await connection.execute(statement)
