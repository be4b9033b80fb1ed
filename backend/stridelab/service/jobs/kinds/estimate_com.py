"""``estimate-com``: from a recording to the trajectory of the centre of mass (chapter 2).

    file -> Recording -> landmarks -> GeometricCom -> WrenchTrack -> latency -> ComEstimate -> agreement -> artifacts

``com.parquet`` / ``com.csv`` cover the whole recording at the marker instants. The geometry is given wherever the
markers allow it; the fused position, velocity, acceleration, standard deviation and the force are NaN outside the
window in which all contact force is measured.
"""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.errors import Fault, InvalidInput
from stridelab.estimation.agreement import bias_m, force_residual_n
from stridelab.estimation.complementary import ComplementaryFilter
from stridelab.estimation.estimate import ComEstimator
from stridelab.estimation.geometry import GeometryOnly
from stridelab.estimation.kalman import KalmanFilter
from stridelab.estimation.observability import observability
from stridelab.estimation.rts import RtsSmoother
from stridelab.estimation.smoother import Smoother
from stridelab.schemas import base
from stridelab.schemas.jobs import EstimateComInput, EstimateComSummary
from stridelab.service.jobs.kinds.com_artifacts import write_com
from stridelab.service.jobs.kinds.kind import Json, Outcome, ProgressCallback
from stridelab.service.jobs.kinds.preparing import prepare
from stridelab.service.jobs.kinds.requirements import require_method
from stridelab.service.jobs.kinds.tasks import EstimateComTask

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
    prepared = prepare(task, folder, progress, needs_force=method != GeometryOnly.name)
    trial, windows, geometric, wrench = prepared.trial, prepared.windows, prepared.geometric, prepared.wrench
    mass, latency = prepared.mass, prepared.latency

    progress(0.7, "fusing markers and force" if method != GeometryOnly.name else "smoothing the geometry")
    estimate = estimator(method, request).estimate(geometric, wrench, mass.mass_kg)

    progress(0.85, "writing the result")
    remarks = (*prepared.remarks, *estimate.remarks)
    summary = EstimateComSummary(
        window_s=(estimate.window.start_s, estimate.window.end_s),
        rate_hz=trial.recording.marker_rate_hz,
        method=estimate.method,
        segment_table=geometric.table,
        mass_kg=mass.mass_kg,
        mass_source=mass.source,
        mass_from_force_kg=trial.force_mass_kg,
        latency_s=latency.found.latency_s if latency.found else None,
        latency_sd_s=latency.found.sd_s if latency.found else None,
        latency_applied_s=latency.applied_s,
        latency_along_s=latency.found.along.lag_s if latency.found else None,
        latency_lateral_s=latency.found.lateral.lag_s if latency.found else None,
        latency_vertical_s=latency.found.vertical.lag_s if latency.found else None,
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


def estimator(method: str, request: EstimateComInput) -> ComEstimator:
    """The estimator with the parameters asked for.

    Raises ``InvalidInput`` (``cutoffs-not-used``) for cut-offs of a method that has none.
    """
    thesis = request.cutoffs == "thesis"
    if isinstance(request.cutoffs, tuple):
        if method != ComplementaryFilter.name:
            raise InvalidInput(
                "cutoffs-not-used",
                f"The {method} estimator has no cut-off frequencies; only the complementary filter has.",
                [Fault("cutoffs", "not used by this method")],
            )
        low_hz, high_hz = request.cutoffs
        return ComplementaryFilter(low_hz=low_hz, high_hz=high_hz)
    if method == GeometryOnly.name:
        return GeometryOnly()
    if method == KalmanFilter.name:
        return KalmanFilter() if thesis else KalmanFilter.tuned()
    if method == RtsSmoother.name:
        return RtsSmoother() if thesis else RtsSmoother.tuned()
    if method == Smoother.name:
        return Smoother()
    return ComplementaryFilter.thesis() if thesis else ComplementaryFilter()
