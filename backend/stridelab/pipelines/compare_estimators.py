"""From a recording to a comparison of all estimators, with the ground truth or else with physical laws."""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import Series
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.estimator import ComEstimate, ComEstimator
from stridelab.estimation.evaluation.comparison import Assessment, Comparison, ComparisonData, compare
from stridelab.estimation.evaluation.truth_errors import TruthError
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.pipelines.com_inputs import ComInputs, prepare_com_inputs, require_method
from stridelab.pipelines.estimate_com import assess_estimate, build_estimator, summary_fields
from stridelab.pipelines.progress import ProgressCallback
from stridelab.recordings.recording import Recording
from stridelab.schemas import base
from stridelab.schemas.comparison import (
    Axes,
    CompareEstimatorsInput,
    CompareEstimatorsSummary,
    CompareEstimatorsTask,
    ErrorAgainstTruth,
    FlightAgreement,
    MethodAssessment,
    MomentumRateAgreement,
)
from stridelab.schemas.methods import METHODS
from stridelab.simulation.truth_table import known_motion

THESIS_ESTIMATORS: Final = ("complementary", "kalman")
"""Estimators that are also compared with the settings of the thesis, as ``<name>-thesis``."""


@dataclass(frozen=True)
class ComparisonResult:
    """The comparison, the data that the estimators were given, and the summary of the contract."""

    data: ComparisonData
    comparison: Comparison
    summary: CompareEstimatorsSummary

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the geometry and of all compared methods."""
        keys = [key for a in self.comparison.assessments.values() for key in a.estimate.references]
        return tuple(dict.fromkeys((*self.data.geometric.references, *keys)))


def compare_estimators(task: CompareEstimatorsTask, folder: Path, progress: ProgressCallback) -> ComparisonResult:
    """Compare the estimators on ``task.recording`` and ``task.truth``, files in ``folder``.

    Single estimators that fail are listed in ``refused``. Raises as ``estimate_com`` and ``known_motion`` do.
    """
    estimators = estimators_of(task.input)
    prepared = prepare_com_inputs(task, folder, progress, needs_force=True)
    truth = None if task.truth is None else known_motion(folder / task.truth, prepared.geometric.time_s)
    data = ComparisonData(
        prepared.geometric,
        prepared.wrench,
        prepared.mass.mass_kg,
        truth,
        floor_height_m=floor_height_m(prepared.trial.recording),
    )
    progress(0.7, f"running {len(estimators)} estimators")
    comparison = compare(estimators, data)
    return ComparisonResult(data, comparison, _comparison_summary(prepared, comparison, with_truth=truth is not None))


def estimators_of(request: CompareEstimatorsInput) -> dict[str, ComEstimator]:
    """The estimators to compare, by their names in the result; custom cut-offs apply to the complementary filter."""
    names = METHODS if request.method is None else (GeometryOnly.name, require_method(request.method))
    own = isinstance(request.cutoffs, tuple) or request.cutoffs == "spectra"
    plain = request.model_copy(update={"cutoffs": "auto"}) if own else request
    chosen = {
        name: build_estimator(name, request if name == ComplementaryFilter.name else plain)
        for name in dict.fromkeys(names)
    }
    if request.method is None and request.cutoffs != "thesis":
        thesis = request.model_copy(update={"cutoffs": "thesis"})
        chosen |= {f"{name}-thesis": build_estimator(name, thesis) for name in THESIS_ESTIMATORS if name in chosen}
    return chosen


def _comparison_summary(prepared: ComInputs, found: Comparison, *, with_truth: bool) -> CompareEstimatorsSummary:
    first = next(iter(found.assessments.values())).estimate
    quality = assess_estimate(prepared, _representative_estimate(found))
    return CompareEstimatorsSummary(
        **summary_fields(prepared, first, quality, (), "laboratory"),
        mass_kg=prepared.mass.mass_kg,
        latency_sd_s=prepared.latency.sd_s,
        reference="truth" if with_truth else "geometry",
        methods={name: _method_assessment(a) for name, a in found.assessments.items()},
        refused={name: base.Remark(code=e.code, message=e.message) for name, e in found.failures.items()},
    )


def _representative_estimate(found: Comparison) -> ComEstimate:
    """The estimate whose quality represents the recording: that of the best method that succeeded."""
    fused = [name for name in (*METHODS, *found.assessments) if name in found.assessments and name != GeometryOnly.name]
    return found.assessments[next(iter(fused), GeometryOnly.name)].estimate


def _method_assessment(a: Assessment) -> MethodAssessment:
    momentum = None
    if a.momentum is not None:
        momentum = MomentumRateAgreement(
            correlation=_axis_values(a.momentum.correlation), rms_nm=_axis_values(a.momentum.rms_nm)
        )
    return MethodAssessment(
        method=a.estimate.method,
        offset_m=_axis_values(a.offset_m),
        force_residual_n=_axis_values(a.residual_n),
        held_back_n=None if a.held_back_n is None else _axis_values(a.held_back_n),
        momentum_rate=momentum,
        flight=None if a.flight is None else FlightAgreement(**asdict(a.flight)),
        standing_m=None if a.standing is None else a.standing.horizontal_m,
        truth=None if a.truth is None else _truth_errors(a.truth),
        warnings=[base.Remark(code=r.code, message=r.message) for r in a.estimate.remarks],
    )


def _truth_errors(error: TruthError) -> ErrorAgainstTruth:
    names = ("rms_m", "mean_m", "coverage", "sd_m", "lag_s")
    return ErrorAgainstTruth.from_object(error, **{name: _axis_values(getattr(error, name)) for name in names})


def _axis_values(values: Series) -> Axes:
    along, lateral, vertical = (None if math.isnan(v) else v for v in values.tolist())
    return Axes(along=along, lateral=lateral, vertical=vertical)


def floor_height_m(recording: Recording) -> float:
    """Mean height of the plates in use; 0 without any."""
    used = [plate.corners_m[:, 2].mean() for plate in recording.plates if plate.use]
    return float(np.mean(used)) if used else 0.0
