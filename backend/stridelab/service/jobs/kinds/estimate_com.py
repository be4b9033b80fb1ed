"""``estimate-com``: from a recording to the trajectory of the centre of mass (chapter 2).

    file -> Recording -> landmarks -> GeometricCom -> WrenchTrack -> latency -> ComEstimate -> agreement -> artifacts

``com.parquet`` / ``com.csv`` cover the whole recording at the marker instants. The geometry is given wherever the
markers allow it; the fused position, velocity, acceleration, standard deviation and the force are NaN outside the
window in which all contact force is measured.
"""

from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.agreement import bias_m, force_residual_n
from stridelab.estimation.complementary import ComplementaryFilter
from stridelab.estimation.estimate import ComEstimator
from stridelab.estimation.geometry import GeometryOnly
from stridelab.estimation.observability import observability
from stridelab.recordings.gaps import runs
from stridelab.recordings.recording import Recording, Subject, Window, WrenchTrack
from stridelab.recordings.wrench import wrench_track
from stridelab.schemas import base
from stridelab.schemas.jobs import EstimateComInput, EstimateComSummary
from stridelab.schemas.recordings import SubjectFields
from stridelab.service.jobs.kinds.com_artifacts import write_com
from stridelab.service.jobs.kinds.kind import Json, Outcome, ProgressCallback
from stridelab.service.jobs.kinds.latency_choice import LatencyChoice, choose_latency
from stridelab.service.jobs.kinds.requirements import body_mass, require_marker_set, require_method, require_windows
from stridelab.service.jobs.kinds.tasks import EstimateComTask
from stridelab.service.jobs.kinds.trial import examine, read

BEST_METHOD: Final = "complementary"
"""What ``method: null`` takes: the best estimator of this version."""


def run_in_child(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """``run`` with JSON on both sides."""
    return run(EstimateComTask.model_validate(task), folder, progress).to_json()


def run(task: EstimateComTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Estimate the CoM of ``task.recording`` in ``folder``; the summary is an ``EstimateComSummary``.

    Raises ``UnreadableFile`` or ``InvalidInput`` for a file or value that makes no sense, ``NotEstimable`` where the
    data do not allow an estimate; code and faults say what is missing.
    """
    request = task.input
    method = require_method(request.method or BEST_METHOD)
    progress(0.02, "reading the recording")
    trial = examine(task.recording, folder)
    recording = trial.recording
    require_marker_set(trial.match, tuple(recording.markers_m))
    windows = require_windows(trial, request.window_s, needs_force=method != GeometryOnly.name)
    stated = task.recording.subject
    mass = body_mass(stated.mass_kg, recording.subject.mass_kg, trial.force_mass_kg)

    progress(0.3, "placing the body segments")
    static = None if task.static is None else read(task.static, folder)
    subject = merged_subject(stated, recording.subject, mass.mass_kg)
    geometric = SegmentModel(table=request.segment_table).com(
        recording, trial.match.landmarks, subject=subject, static=static
    )

    progress(0.6, "comparing the clocks of force and markers")
    if windows:
        wrench_at = partial(_wrench_at, recording, windows)
        latency = choose_latency(request.latency, geometric, wrench_at, mass.mass_kg)
        wrench = wrench_at(latency.applied_s)
    else:
        latency, wrench = LatencyChoice(None, 0.0), without_force(geometric)

    progress(0.7, "fusing markers and force" if method != GeometryOnly.name else "smoothing the geometry")
    estimate = estimator(method, request).estimate(geometric, wrench, mass.mass_kg)

    progress(0.85, "writing the result")
    remarks = (
        *trial.remarks,
        *geometric.remarks,
        *mass.remarks,
        *latency.remarks,
        *estimate.remarks,
    )
    summary = EstimateComSummary(
        window_s=(estimate.window.start_s, estimate.window.end_s),
        rate_hz=recording.marker_rate_hz,
        method=estimate.method,
        segment_table=geometric.table,
        mass_kg=mass.mass_kg,
        mass_source=mass.source,
        mass_from_force_kg=trial.force_mass_kg,
        latency_s=latency.found.latency_s if latency.found else None,
        latency_sd_s=latency.found.sd_s if latency.found else None,
        latency_applied_s=latency.applied_s,
        rms_force_residual_n=force_residual_n(estimate, wrench, mass.mass_kg).tolist() if windows else [],
        bias_m=bias_m(estimate, geometric).tolist(),
        observability=asdict(observability(estimate)) if windows else {},
        warnings=[base.Remark(code=r.code, message=r.message) for r in dict.fromkeys(remarks)],
    )
    shown = wrench if windows else replace(wrench, complete=np.zeros_like(wrench.complete))
    artifacts = write_com(folder, task.recording, trial, geometric, shown, estimate, summary)
    progress(1.0, "done")
    references = (*geometric.references, *estimate.references)
    return Outcome(summary.model_dump(mode="json"), tuple(dict.fromkeys(references)), artifacts)


def merged_subject(stated: SubjectFields, in_file: Subject, mass_kg: float) -> Subject:
    """What is known of the person: the user's values win over the file's."""
    return Subject(
        height_m=stated.height_m or in_file.height_m,
        mass_kg=mass_kg,
        sex=stated.sex or in_file.sex,
        age_years=in_file.age_years if stated.age_years is None else stated.age_years,
    )


def estimator(method: str, request: EstimateComInput) -> ComEstimator:
    """The estimator with the parameters asked for."""
    if method == GeometryOnly.name:
        return GeometryOnly()
    if request.cutoffs == "auto":
        return ComplementaryFilter()
    if request.cutoffs == "thesis":
        return ComplementaryFilter.thesis()
    low_hz, high_hz = request.cutoffs
    return ComplementaryFilter(low_hz=low_hz, high_hz=high_hz)


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
