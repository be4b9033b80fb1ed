"""What killable children of the web service read from the file of a recording.

``run``, of ``POST /recordings``: the facts of the contract, and all tracks in the world frame (SI) for plots and the
viewer. ``propose_markers``, of ``POST /marker-sets/propose``: the landmarks of the markers. ``read_pose``, of
``WS /stream/markers``: the static pose. Names of subjects are never read, so they cannot leave this process.
"""

from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import Mask, Series
from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.trial import Trial, clock_of, event_delays_of, examine_trial, read_source, subject_fields
from stridelab.recordings.marker_proposal import propose_marker_map
from stridelab.recordings.plate_contacts import centre_of_pressure_m, loaded_intervals, wrench_track
from stridelab.recordings.recording import Plate
from stridelab.recordings.static_pose import stands_still
from stridelab.schemas.base import Remark
from stridelab.schemas.marker_sets import MarkerSetProposal, ProposedLabel
from stridelab.schemas.recordings import PlateInfo, RecordingFacts
from stridelab.schemas.tasks import ParseUploadTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import write_table

JOINT: Final = "joint_"
"""Beginning of the columns of a joint centre."""


def run(task: ParseUploadTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Read ``task.recording`` from ``folder``; the summary is a ``RecordingFacts``, the artifact ``tracks``.

    Raises ``UnreadableFile`` or ``InvalidInput`` with the reader's codes.
    """
    progress(0.05, "reading the file")
    trial = examine_trial(task.recording, folder)
    progress(0.6, "writing the tracks")
    artifacts = write_tracks(trial, folder, task.recording.filename)
    progress(1.0, "done")
    facts = recording_facts(trial)
    own = next((one for one in task.recording.marker_sets if one.name == facts.marker_set), None)
    if own is not None:
        facts = facts.model_copy(update={"marker_set_id": own.id})
    return Outcome(facts.model_dump(mode="json"), (), artifacts)


def propose_markers(task: ParseUploadTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Read ``task.recording``; the summary is a ``MarkerSetProposal`` without an id.

    Raises ``UnreadableFile`` or ``InvalidInput`` with the reader's codes.
    """
    progress(0.1, "reading the file")
    recording = read_source(task.recording, folder)
    proposal = propose_marker_map(recording)
    used = {proposed.label for proposed in proposal.values()}
    summary = MarkerSetProposal(
        recording_id="",
        landmarks={
            landmark: ProposedLabel(label=proposed.label, confidence=round(proposed.confidence, 3))
            for landmark, proposed in proposal.items()
        },
        unassigned=[label for label in recording.markers_m if label not in used],
    )
    return Outcome(summary.model_dump(mode="json"), (), ())


def read_pose(task: ParseUploadTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Median position of each marker of ``task.recording`` that is ever seen, in metres with z up.

    Raises ``UnreadableFile`` or ``InvalidInput`` with the reader's codes.
    """
    progress(0.1, "reading the file")
    recording = read_source(task.recording, folder)
    seen = {label: track[np.isfinite(track).all(axis=1)] for label, track in recording.markers_m.items()}
    pose = {label: np.median(track, axis=0).tolist() for label, track in seen.items() if len(track)}
    return Outcome(pose, (), ())


def recording_facts(trial: Trial) -> RecordingFacts:
    """The facts of the contract; ``windows_s`` are the intervals in which all contact force is measured."""
    recording, match = trial.recording, trial.match
    direction = recording.walking_direction
    weight, clock = trial.force_mass, clock_of(trial)
    return RecordingFacts(
        duration_s=recording.duration_s,
        n_frames=recording.n_frames,
        marker_rate_hz=recording.marker_rate_hz,
        force_rate_hz=recording.force_rate_hz,
        marker_set=match.name,
        n_markers=len(recording.markers_m),
        subject=subject_fields(recording.subject),
        mass_from_force_kg=trial.force_mass_kg,
        mass_from_force_sd_kg=None if weight is None else weight.sd_kg,
        clock=clock,
        event_delays=event_delays_of(trial, clock),
        recorded_on=date.fromisoformat(recording.recorded_on) if recording.recorded_on else None,
        still=stands_still(recording),
        simulated=bool(recording.carried),
        plates=[plate_info(plate, recording.force_rate_hz) for plate in recording.plates],
        windows_s=[(window.start_s, window.end_s) for window in trial.windows],
        up_axis=recording.up_axis,
        walking_direction=None if direction is None else direction.tolist(),
        labels=list(recording.markers_m),
        landmarks=dict(match.landmarks),
        missing_landmarks=list(match.missing),
        warnings=[Remark(code=r.code, message=r.message) for r in trial.remarks],
    )


def plate_info(plate: Plate, force_rate_hz: float) -> PlateInfo:
    """A plate of the contract, with the intervals in which its load exceeds its threshold."""
    loaded_s = loaded_intervals(plate, force_rate_hz)
    zero = [*plate.tare_force_n.tolist(), *plate.tare_moment_nm.tolist()] if plate.zero_is_known else None
    return PlateInfo.from_object(plate, corners_m=plate.corners_m.tolist(), loaded_s=loaded_s, zero=zero)


def write_tracks(trial: Trial, folder: Path, filename: str) -> tuple[ArtifactFile, ArtifactFile]:
    """Write ``tracks.parquet`` and ``tracks.csv``: markers, joint centres and plate wrenches at the marker instants."""
    return write_table(folder, "tracks", track_columns(trial), {"file": filename, "frame": "world, z up"})


def track_columns(trial: Trial) -> dict[str, Series | Mask]:
    """``time_s``, ``complete``, ``<label>_x_m..``, ``joint_<name>_x_m..``, ``plate<i>_fx_n.. _mx_nm.. _copx_m..``.

    Moments are about the world origin. ``complete`` marks the frames in which the sum over the plates in use is the
    whole contact wrench. The centre of pressure is NaN while the load of the plate is below its threshold. Joint
    centres are those of the segment model; a marker of the same name takes their place.
    """
    recording, windows = trial.recording, trial.windows
    columns: dict[str, Series | Mask] = {"time_s": recording.time_s}
    columns["complete"] = wrench_track(recording, windows).complete
    joints = {f"{JOINT}{name}": centre_m for name, centre_m in trial.joint_centres_m.items()}
    for label, track in (joints | dict(recording.markers_m)).items():
        columns |= {f"{label}_{axis}_m": track[:, i] for i, axis in enumerate("xyz")}
    for plate in recording.plates:
        alone = wrench_track(replace(recording, plates=(replace(plate, use=True),)), windows)
        force_n, moment_nm = alone.force_n, alone.moment_nm
        cop_m = centre_of_pressure_m(replace(plate, force_n=force_n, moment_nm=moment_nm))
        for i, axis in enumerate("xyz"):
            columns[f"plate{plate.index}_f{axis}_n"] = force_n[:, i]
            columns[f"plate{plate.index}_m{axis}_nm"] = moment_nm[:, i]
            columns[f"plate{plate.index}_cop{axis}_m"] = cop_m[:, i]
    return columns
