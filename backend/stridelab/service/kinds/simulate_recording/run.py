"""``simulate-recording``: simulates a laboratory recording of a walking human or robot, with its ground truth.

The recording is a C3D file like an upload, and its facts are read from this file; it contains the segment table of the
simulated body (table "carried" of ``estimate-com``). ``truth`` is the exact motion.
"""

from pathlib import Path
from typing import Final

from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.simulate_recording import mean_speed_m_s, simulate_recording
from stridelab.pipelines.trial import examine_trial
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.schemas import base
from stridelab.schemas.jobs import SimulateRecordingSummary
from stridelab.schemas.tasks import RecordingSource, SimulateRecordingTask
from stridelab.service.filenames import SIMULATED_FACTS_FILE, SIMULATED_RECORDING_FILE, SIMULATED_TRACKS_FILE
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.parse_upload import recording_facts, write_tracks
from stridelab.service.kinds.result_tables import C3D, write_atomically, write_table
from stridelab.simulation.truth_table import truth_columns

PRIVATE_FILES: Final = (SIMULATED_FACTS_FILE, SIMULATED_TRACKS_FILE, "tracks.csv")
"""Files for the recording's row, which are not artifacts of the job."""


def run(task: SimulateRecordingTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Simulate into ``folder``; the summary is a ``SimulateRecordingSummary`` without ``recording_id``.

    Raises ``InvalidInput`` if body or walk are outside the range of the simulation.
    """
    simulated, references = simulate_recording(task.input, progress)
    progress(0.75, "writing the recording")
    write_atomically(folder / SIMULATED_RECORDING_FILE, lambda path: write_c3d(path, simulated.recording))
    provenance = {"input": task.input.model_dump(mode="json"), "frame": "world, z up"}
    tables = write_table(folder, "truth", truth_columns(simulated.truth), provenance)
    progress(0.85, "reading it back")
    trial = examine_trial(RecordingSource(file=SIMULATED_RECORDING_FILE, filename=SIMULATED_RECORDING_FILE), folder)
    write_tracks(trial, folder, SIMULATED_RECORDING_FILE)
    (folder / SIMULATED_FACTS_FILE).write_text(recording_facts(trial).model_dump_json(), encoding="utf-8")
    summary = SimulateRecordingSummary(
        speed_m_s=mean_speed_m_s(simulated),
        n_steps=sum(event.kind == "foot_strike" for event in simulated.recording.events),
        warnings=[base.Remark(code=r.code, message=r.message) for r in trial.remarks],
    )
    progress(1.0, "done")
    artifacts = (ArtifactFile(SIMULATED_RECORDING_FILE, C3D), *tables)
    return Outcome(summary.model_dump(mode="json"), references, artifacts)


def remove_private_files(folder: Path) -> None:
    """Remove the files of the recording's row, for callers that insert no row."""
    for name in PRIVATE_FILES:
        (folder / name).unlink(missing_ok=True)
