"""The job kind ``simulate-recording``."""

import hashlib
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sqlalchemy import insert
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.jobs import SimulateRecordingInput, SimulateRecordingSummary
from stridelab.schemas.recordings import RecordingFacts
from stridelab.service.filenames import SIMULATED_FACTS_FILE, SIMULATED_RECORDING_FILE, SIMULATED_TRACKS_FILE
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.staging import stage_input
from stridelab.service.storage.content_addressed import lock_blob
from stridelab.service.storage.tables import recording

"""Files of ``simulate-recording``: its recording, and the tracks and facts for the recording's row."""
TRUTH_FILE = "truth.parquet"
"""The true motion of a simulated recording, an artifact of the simulation job."""


async def publish(
    connection: AsyncConnection, blobs: Blobs, job_row: Mapping[str, Any], outcome: Json, folder: Path
) -> Json:
    """Insert the recording of a finished simulation; returns the summary with its ``recording_id``.

    The id is derived from the job's id, so that the files of an attempt that died before committing the row are
    overwritten by the next attempt and leave no orphans.
    """
    recording_id = uuid.uuid5(uuid.NAMESPACE_URL, f"stridelab:job:{job_row['id']}").hex
    trial, tracks = folder / SIMULATED_RECORDING_FILE, folder / SIMULATED_TRACKS_FILE
    facts = RecordingFacts.model_validate_json((folder / SIMULATED_FACTS_FILE).read_text(encoding="utf-8"))
    blob_key, tracks_key = (
        f"recordings/{recording_id}/{SIMULATED_RECORDING_FILE}",
        f"recordings/{recording_id}/{SIMULATED_TRACKS_FILE}",
    )
    for key, file in ((blob_key, trial), (tracks_key, tracks)):
        await lock_blob(connection, key)  # the janitor waits for the commit
        await blobs.put_file(key, file)
    content = trial.read_bytes()
    await connection.execute(
        insert(recording).values(
            id=recording_id,
            owner=job_row["owner"],
            filename=f"simulated-{job_row['input'].get('robot', 'human')}-seed-{job_row['input'].get('seed', 0)}.c3d",
            sha256=hashlib.sha256(content).hexdigest(),
            bytes=len(content),
            blob_key=blob_key,
            tracks_key=tracks_key,
            facts=facts.model_dump(mode="json"),
            subject_fields={},
            truth_job_id=job_row["id"],
        )
    )
    return {**outcome["summary"], "recording_id": recording_id}


KIND = JobKind(
    name="simulate-recording",
    title="Simulated recording",
    description="Simulates a laboratory recording of a walking person or robot, with its ground truth.",
    examples={
        "walk": {"summary": "Six seconds of walking", "value": {"duration_s": 6.0, "speed_m_s": 1.2, "seed": 1}},
        "noisy": {
            "summary": "A heavier, slower walker, noisy plates",
            "value": {"speed_m_s": 0.8, "mass_kg": 82.0, "noise": {"force_n": 8.0, "marker_m": 0.002}, "seed": 7},
        },
        "talos": {"summary": "The humanoid TALOS, at its default speed", "value": {"robot": "talos", "seed": 1}},
    },
    input_model=SimulateRecordingInput,
    summary_model=SimulateRecordingSummary,
    stage=stage_input,
    publish=publish,
    timeout_s=300.0,
    lane="long",
)
