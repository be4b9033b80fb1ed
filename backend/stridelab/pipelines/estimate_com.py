"""Estimation of the centre-of-mass trajectory from a recording (chapter 2).

file -> Recording -> landmarks -> GeometricCom -> WrenchTrack -> latency -> ComEstimate -> quality

Quality of a result: converts the checks of ``estimation.quality`` to the response schema.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.estimation.estimator import ComEstimate, ComEstimator
from stridelab.estimation.evaluation.physics_residuals import bias_m, force_residual_n
from stridelab.estimation.observability import summarise_observability
from stridelab.estimation.quality import Check, Recorded, assess_quality, worst_verdict
from stridelab.estimation.quality import Quality as Assessed
from stridelab.estimation.smoother import Smoother, SmootherPriors
from stridelab.pipelines.com_inputs import ComInputs, prepare_com_inputs, require_method
from stridelab.pipelines.progress import ProgressCallback
from stridelab.recordings.marker_sets import PROPOSED
from stridelab.recordings.orientation import walking_direction
from stridelab.recordings.recording import Remark
from stridelab.schemas import base
from stridelab.schemas import quality as contract
from stridelab.schemas.jobs import ComparedMass, EstimateComInput, EstimateComSummary, SmootherOptions
from stridelab.schemas.tasks import EstimateComTask

BEST_METHOD: Final = Smoother.name
"""Method used for ``method: null``: the most accurate estimator of this version."""
GEOMETRY_ONLY: Final = "geometry"
FALLBACK_METHOD: Final = "complementary"
"""Fallback for ``method: null`` if the best estimator rejects the recording."""


@dataclass(frozen=True)
class ComResult:
    """CoM estimate of a recording: inputs of the estimator, estimate and summary."""

    prepared: ComInputs
    estimate: ComEstimate
    summary: EstimateComSummary

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the methods used."""
        prepared = self.prepared
        used = (*prepared.geometric.references, *self.estimate.references, *prepared.latency.citation_keys)
        return tuple(dict.fromkeys(used))


def estimate_com(task: EstimateComTask, folder: Path, progress: ProgressCallback) -> ComResult:
    """Estimate the centre of mass of ``task.recording`` in ``folder``; covers 0.02 to 0.85 of the progress.

    Raises ``UnreadableFile`` or ``InvalidInput`` for an unusable file or value, ``NotEstimable`` if the data do not
    allow an estimate; code and faults name what is missing.
    """
    request = task.input
    method = requested_method(request)
    prepared = prepare_com_inputs(task, folder, progress, needs_force=method != GEOMETRY_ONLY)
    trial, windows, geometric, wrench = prepared.trial, prepared.windows, prepared.geometric, prepared.wrench
    mass, latency = prepared.mass, prepared.latency

    progress(0.7, "fusing markers and force" if method != GEOMETRY_ONLY else "smoothing the geometry")
    estimate = estimate_with_fallback(method, request, prepared)

    quality = assess_estimate(prepared, estimate)
    direction = walking_direction(estimate.com_m[:, None, :], trial.recording.marker_rate_hz)
    summary = EstimateComSummary(
        **summary_fields(prepared, estimate, quality, estimate.remarks, "laboratory"),
        method=estimate.method,
        mass_kg=mass.known_kg,
        mass_source=mass.source,
        mass_sd_kg=mass.known_sd_kg,
        mass_from_force_kg=trial.force_mass_kg,
        masses=[ComparedMass.model_validate(asdict(known)) for known in mass.compared],
        latency_sd_s=latency.sd_s,
        latency_trial_s=latency.trial_estimate.latency_s if latency.trial_estimate else None,
        latency_trial_sd_s=latency.trial_estimate.sd_s if latency.trial_estimate else None,
        latency_along_s=latency.trial_estimate.along.lag_s if latency.trial_estimate else None,
        latency_lateral_s=latency.trial_estimate.lateral.lag_s if latency.trial_estimate else None,
        latency_vertical_s=latency.trial_estimate.vertical.lag_s if latency.trial_estimate else None,
        rms_force_residual_n=force_residual_n(estimate, wrench, mass.mass_kg).tolist() if windows else [],
        bias_m=bias_m(estimate, geometric).tolist(),
        sd_m=np.median(estimate.sd_m, axis=0).tolist(),
        walking_direction=None if direction is None else (float(direction[0]), float(direction[1])),
        observability=asdict(summarise_observability(estimate)) if windows else {},
        diagnostics={name: value for name, value in estimate.diagnostics.items() if math.isfinite(value)},
    )
    return ComResult(prepared, estimate, summary)


def summary_fields(
    prepared: ComInputs,
    estimate: ComEstimate,
    quality: Assessed,
    remarks: Sequence[Remark],
    frame: Literal["laboratory", "belt"],
) -> dict[str, Any]:
    """The fields of a ``RecordingSummary``, with positions in ``frame``; ``remarks`` come after those of the inputs."""
    latency, all_remarks = prepared.latency, (*quality.remarks, *prepared.all_remarks, *remarks)
    match = prepared.trial.match
    return {
        "window_s": (estimate.window.start_s, estimate.window.end_s),
        "rate_hz": prepared.trial.recording.marker_rate_hz,
        "segment_table": prepared.geometric.table,
        "latency_s": latency.latency_s,
        "latency_applied_s": latency.applied_s,
        "latency_source": latency.latency_source,
        "latency_n_trials": latency.n_trials,
        "session": prepared.session,
        "treadmill": prepared.treadmill(frame),
        "proposed_names": dict(match.landmarks) if match.name == PROPOSED else {},
        "quality": quality_schema(quality),
        "warnings": [base.Remark(code=r.code, message=r.message) for r in dict.fromkeys(all_remarks)],
    }


def requested_method(request: EstimateComInput) -> str | None:
    """The requested method, or the only method with the given cut-offs or options; None requests the best method.

    Raises ``InvalidInput`` (``cutoffs-not-used``) for cut-offs that would have no effect.
    """
    named = None if request.method is None else require_method(request.method)
    if request.smoother is not None:
        named = Smoother.name
    if request.cutoffs == "auto":
        return named
    if named in (GEOMETRY_ONLY, Smoother.name):
        raise _cutoffs_not_used(named)
    return named or FALLBACK_METHOD


def estimate_with_fallback(
    method: str | None, request: EstimateComInput, prepared: ComInputs, *, beyond_window: bool = False
) -> ComEstimate:
    """Estimate by ``method``; None uses ``BEST_METHOD`` and, if that rejects the recording, ``FALLBACK_METHOD``.

    The fallback adds a remark.

    ``beyond_window`` extends the smoother's estimate and the geometry's over all gap-free geometry. Raises
    ``NotEstimable`` if no applicable method accepts the recording.
    """
    inputs = prepared.geometric, prepared.wrench, prepared.mass.mass_kg
    try:
        com_estimator = build_estimator(method or BEST_METHOD, request)
        if beyond_window:
            com_estimator = _beyond_window(com_estimator)
        return com_estimator.estimate(*inputs)
    except NotEstimable as refusal:
        if method is not None:
            raise
        estimate = build_estimator(FALLBACK_METHOD, request).estimate(*inputs)
        message = (
            f"The {BEST_METHOD} rejects this recording; the {FALLBACK_METHOD} filter is used instead: {refusal.message}"
        )
        return replace(estimate, remarks=(Remark("best-method-refused", message), *estimate.remarks))


def _beyond_window(com_estimator: ComEstimator) -> ComEstimator:
    """The estimator over all gap-free geometry, if it can say something outside the measured window."""
    from stridelab.estimation.markers_only import GeometryOnly

    if isinstance(com_estimator, Smoother | GeometryOnly):
        return replace(com_estimator, beyond_window=True)
    return com_estimator


def build_estimator(method: str, request: EstimateComInput) -> ComEstimator:
    """The estimator with the requested parameters.

    Raises ``InvalidInput`` (``cutoffs-not-used``) for cut-offs of a method that has none.
    """
    if method != FALLBACK_METHOD and isinstance(request.cutoffs, tuple):
        raise _cutoffs_not_used(method)
    if method == GEOMETRY_ONLY:
        from stridelab.estimation.markers_only import GeometryOnly

        return GeometryOnly()
    if method != FALLBACK_METHOD and request.cutoffs == "spectra":
        raise _cutoffs_not_used(method)
    if method == Smoother.name:
        return build_smoother(request.smoother or SmootherOptions())
    # These import scipy.signal, which takes longer than the estimation of a walk by the smoother.
    from stridelab.estimation.complementary.filter import ComplementaryFilter
    from stridelab.estimation.kalman.filter import KalmanFilter, RtsSmoother

    thesis = request.cutoffs == "thesis"
    if method == KalmanFilter.name:
        return KalmanFilter() if thesis else KalmanFilter.tuned()
    if method == RtsSmoother.name:
        return RtsSmoother() if thesis else RtsSmoother.tuned()
    if isinstance(request.cutoffs, tuple):
        low_hz, high_hz = request.cutoffs
        return ComplementaryFilter(low_hz=low_hz, high_hz=high_hz)
    return ComplementaryFilter.thesis() if thesis else ComplementaryFilter(from_spectra=request.cutoffs == "spectra")


def build_smoother(options: SmootherOptions) -> Smoother:
    """The smoother with the given priors, the others by default; the clock is the compared one unless it is stated."""
    stated = options.priors.model_dump(exclude_none=True)
    return Smoother(
        priors=SmootherPriors(**stated),
        learn=options.learn,
        segment_momentum=options.segment_momentum,
        compared_clock="clock_s" not in stated,
    )


def _cutoffs_not_used(method: str) -> InvalidInput:
    return InvalidInput(
        "cutoffs-not-used",
        f"The {method} estimator has no cut-off frequencies; only the complementary filter has.",
        [Fault("cutoffs", "not used by this method")],
    )


MAX_REPORTED_VALUE = 1e12
"""Replaces infinite values, which JSON cannot represent."""


def assess_estimate(prepared: ComInputs, estimate: ComEstimate) -> Assessed:
    """Check one estimate against its inputs."""
    recorded = Recorded(
        recording=prepared.trial.recording,
        landmarks=prepared.trial.match.landmarks,
        geometric=prepared.geometric,
        wrench=prepared.wrench,
        mass_kg=prepared.mass.mass_kg,
        with_force=bool(prepared.windows) and estimate.method != GEOMETRY_ONLY,
        standing_mass_kg=prepared.standing_mass_kg,
        stated_mass_kg=prepared.mass.stated_kg,
        mass_sd_kg=prepared.mass.sd_kg if prepared.mass.source == "force" else None,
        names_proposed=prepared.trial.match.name == PROPOSED,
    )
    return assess_quality(recorded, estimate)


def quality_schema(quality: Assessed) -> contract.Quality:
    """Convert a quality assessment to the response schema."""
    return contract.Quality(
        verdict=quality.verdict,
        checks=[_check_schema(check) for check in quality.checks],
        not_checked=dict(quality.not_checked),
    )


def worst_quality(qualities: Sequence[contract.Quality]) -> contract.Quality:
    """The worst value of every check; a check made in no result has the reason given by the first."""
    checks: dict[str, contract.QualityCheck] = {}
    for check in (check for quality in qualities for check in quality.checks):
        previous = checks.get(check.name)
        if previous is None or check.value > previous.value:
            checks[check.name] = check
    missing: dict[str, str] = {}
    for quality in qualities:
        missing = {name: why for name, why in quality.not_checked.items() if name not in checks} | missing
    return contract.Quality(
        verdict=worst_verdict(quality.verdict for quality in qualities),
        checks=list(checks.values()),
        not_checked=missing,
    )


def _check_schema(check: Check) -> contract.QualityCheck:
    value = check.value if math.isfinite(check.value) else MAX_REPORTED_VALUE
    return contract.QualityCheck(**asdict(check) | {"value": value, "passed": check.passed})
