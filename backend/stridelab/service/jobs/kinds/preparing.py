"""What every job on a recording does first: from the task's files to the inputs that the estimators share.

    file -> Recording -> landmarks -> GeometricCom -> WrenchTrack -> latency

``estimate-com`` and ``compare-estimators`` start from the same numbers because they start here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.recordings.gaps import runs
from stridelab.recordings.recording import Recording, Remark, Subject, Window, WrenchTrack
from stridelab.recordings.wrench import wrench_track
from stridelab.schemas.recordings import SubjectFields
from stridelab.service.jobs.kinds.kind import ProgressCallback
from stridelab.service.jobs.kinds.latency_choice import LatencyChoice, choose_latency
from stridelab.service.jobs.kinds.requirements import BodyMass, body_mass, require_marker_set, require_windows
from stridelab.service.jobs.kinds.tasks import EstimateComTask
from stridelab.service.jobs.kinds.trial import Trial, examine, read


@dataclass(frozen=True)
class Prepared:
    """Inputs of the estimators: geometry, wrench with the latency that is applied, mass.

    ``windows`` is empty where the geometry is to be given without any force; ``remarks`` are those of all steps so far.
    """

    trial: Trial
    windows: tuple[Window, ...]
    geometric: GeometricCom
    wrench: WrenchTrack
    mass: BodyMass
    latency: LatencyChoice

    @property
    def remarks(self) -> tuple[Remark, ...]:
        return (*self.trial.remarks, *self.geometric.remarks, *self.mass.remarks, *self.latency.remarks)


def prepare(task: EstimateComTask, folder: Path, progress: ProgressCallback, *, needs_force: bool) -> Prepared:
    """Read the recording of ``task`` in ``folder`` and place the body's segments; takes 0.02 to 0.7 of the progress.

    Raises ``UnreadableFile``, ``InvalidInput`` or ``NotEstimable`` for a file, a value or data that do not do.
    """
    request = task.input
    progress(0.02, "reading the recording")
    trial = examine(task.recording, folder)
    recording = trial.recording
    require_marker_set(trial.match, tuple(recording.markers_m))
    windows = require_windows(trial, request.window_s, needs_force=needs_force)
    stated = task.recording.subject
    mass = body_mass(stated.mass_kg, recording.subject.mass_kg, trial.force_mass_kg)

    progress(0.3, "placing the body segments")
    static = None if task.static is None else read(task.static, folder)
    subject = merged_subject(stated, recording.subject, mass.mass_kg)
    geometric = SegmentModel(table=request.segment_table).com(
        recording, trial.match.landmarks, subject=subject, static=static
    )

    progress(0.6, "comparing the clocks of force and markers")
    if not windows:
        return Prepared(trial, windows, geometric, without_force(geometric), mass, LatencyChoice(None, 0.0))
    wrench_at: Callable[[float], WrenchTrack] = partial(_wrench_at, recording, windows)
    latency = choose_latency(request.latency, geometric, wrench_at, mass.mass_kg)
    return Prepared(trial, windows, geometric, wrench_at(latency.applied_s), mass, latency)


def merged_subject(stated: SubjectFields, in_file: Subject, mass_kg: float) -> Subject:
    """What is known of the person: the user's values win over the file's."""
    return Subject(
        height_m=stated.height_m or in_file.height_m,
        mass_kg=mass_kg,
        sex=stated.sex or in_file.sex,
        age_years=in_file.age_years if stated.age_years is None else stated.age_years,
    )


def without_force(geometric: GeometricCom) -> WrenchTrack:
    """Stand-in for the missing wrench, so that the geometry can be given for its own longest run of frames.

    Only the contract that all estimators share needs it: its zeros enter no number of a result.
    """
    seen = np.isfinite(geometric.com_m).all(axis=1)
    start, stop = max(runs(seen), key=lambda run: run[1] - run[0])
    time_s = geometric.time_s
    complete = np.zeros(len(time_s), dtype=bool)
    complete[start:stop] = True
    window = Window(float(time_s[start]), float(time_s[stop - 1]))
    nothing = np.zeros((len(time_s), 3))
    return WrenchTrack(time_s, nothing, nothing, complete, (window,))


def _wrench_at(recording: Recording, windows: tuple[Window, ...], latency_s: float) -> WrenchTrack:
    return wrench_track(recording, windows, latency_s=latency_s)
