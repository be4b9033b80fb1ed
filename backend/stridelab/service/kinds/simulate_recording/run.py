"""``simulate-recording``: simulates a laboratory recording of a walking human or TALOS, with its ground truth.

The recording is a C3D file like an upload, and its facts are read from this file; it contains the segment table of the
simulated body (table "carried" of ``estimate-com``). ``truth`` is the exact motion.
"""

from pathlib import Path
from typing import Final

from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.trial import examine_trial
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.schemas import base
from stridelab.schemas.jobs import SimulateRecordingInput, SimulateRecordingSummary
from stridelab.schemas.tasks import RecordingSource, SimulateRecordingTask
from stridelab.service.kinds.base import ArtifactFile, Json, Outcome
from stridelab.service.kinds.parse_upload import recording_facts, write_tracks
from stridelab.service.kinds.result_tables import C3D, write_atomically, write_table
from stridelab.service.kinds.simulate_recording.kind import FACTS_FILE, RECORDING_FILE, TRACKS_FILE
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import SimulatedRecording, record
from stridelab.simulation.noise import MeasurementNoise
from stridelab.simulation.robot.gait_plan import gait_for
from stridelab.simulation.robot.runner import running_at
from stridelab.simulation.robot.runner import simulate_run as run_talos
from stridelab.simulation.robot.walker import simulate_walk as walk_talos
from stridelab.simulation.robot_recording import record_robot
from stridelab.simulation.truth_table import truth_columns

Keys = tuple[str, ...]
"""Citation keys."""
PRIVATE_FILES: Final = (FACTS_FILE, TRACKS_FILE, "tracks.csv")
"""Files for the recording's row, which are not artifacts of the job."""


def run_in_child(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """``run`` with JSON on both sides."""
    return run(SimulateRecordingTask.model_validate(task), folder, progress).to_json()


def run(task: SimulateRecordingTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Simulate into ``folder``; the summary is a ``SimulateRecordingSummary`` without ``recording_id``.

    Raises ``InvalidInput`` if body or walk are outside the range of the simulation.
    """
    request = task.input
    progress(0.02, request.gait)
    simulated, references = (
        _simulate_talos(request, progress) if request.robot == "talos" else _simulate_human(request, progress)
    )
    progress(0.75, "writing the recording")
    write_atomically(folder / RECORDING_FILE, lambda path: write_c3d(path, simulated.recording))
    provenance = {"input": request.model_dump(mode="json"), "frame": "world, z up"}
    tables = write_table(folder, "truth", truth_columns(simulated.truth), provenance)
    progress(0.85, "reading it back")
    trial = examine_trial(RecordingSource(file=RECORDING_FILE, filename=RECORDING_FILE), folder)
    write_tracks(trial.recording, trial.windows, folder, RECORDING_FILE)
    (folder / FACTS_FILE).write_text(recording_facts(trial).model_dump_json(), encoding="utf-8")
    summary = SimulateRecordingSummary(
        speed_m_s=mean_speed_m_s(simulated),
        n_steps=sum(event.kind == "foot_strike" for event in simulated.recording.events),
        warnings=[base.Remark(code=r.code, message=r.message) for r in trial.remarks],
    )
    progress(1.0, "done")
    artifacts = (ArtifactFile(RECORDING_FILE, C3D), *tables)
    return Outcome(summary.model_dump(mode="json"), references, artifacts)


def _simulate_human(request: SimulateRecordingInput, progress: ProgressCallback) -> tuple[SimulatedRecording, Keys]:
    """Simulate a walking human; returns the recording and the citation keys of the body model."""
    person = request.model_dump(include={"height_m", "mass_kg", "sex", "speed_m_s", "duration_s", "seed"})
    walk = HumanWalker(**person).walk()
    progress(0.6, "recording markers and plates")
    return record(walk, _measurement_noise(request), request.seed, lab=request.lab), walk.body.table.references


def _simulate_talos(request: SimulateRecordingInput, progress: ProgressCallback) -> tuple[SimulatedRecording, Keys]:
    """Simulate TALOS walking or running; returns the recording and the citation keys of preview control."""
    if request.gait == "running":
        walk = run_talos(running_at(request.speed_m_s, request.duration_s), request.seed)
    else:
        walk = walk_talos(gait_for(request.speed_m_s, request.duration_s), request.seed)
    progress(0.6, "recording markers and plates")
    return record_robot(walk, _measurement_noise(request), request.seed, lab=request.lab), (
        "kajita2003",
        "katayama1985",
    )


def _measurement_noise(request: SimulateRecordingInput) -> MeasurementNoise:
    return MeasurementNoise(**request.noise.model_dump())


def mean_speed_m_s(simulated: SimulatedRecording) -> float:
    """Forward distance of the true CoM over the time of the recording."""
    truth = simulated.truth
    return float((truth.com_m[-1, 0] - truth.com_m[0, 0]) / (truth.time_s[-1] - truth.time_s[0]))


def remove_private_files(folder: Path) -> None:
    """Remove the files of the recording's row, for callers that insert no row."""
    for name in PRIVATE_FILES:
        (folder / name).unlink(missing_ok=True)
