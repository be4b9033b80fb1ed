"""Compares estimators on the same data: with the truth if it is known, else with physics.

Works with any estimators. Figures are given along the walk, lateral and vertical, or horizontal and vertical; never as
one number for all axes.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import PerAxis, Points
from stridelab.dynamics.wrench import Wrench, com_acceleration
from stridelab.errors import NotEstimable, StridelabError
from stridelab.estimation.complementary.forward_backward import filter_inputs
from stridelab.estimation.differentiation import smoothed_derivatives, walk_frame, window_span
from stridelab.estimation.estimator import ComEstimate, ComEstimator
from stridelab.estimation.evaluation.error_spectra import ErrorSpectrum, error_spectrum
from stridelab.estimation.evaluation.holdout_force import withheld_residual_n
from stridelab.estimation.evaluation.physics_residuals import (
    Flight,
    MomentumAgreement,
    Standing,
    assess_flight,
    assess_standing,
    force_residual_track_n,
    momentum_agreement,
)
from stridelab.estimation.evaluation.truth_errors import TruthError, error_m, truth_error
from stridelab.recordings.recording import WrenchTrack


@dataclass(frozen=True)
class KnownMotion:
    """True CoM and true contact force at the instants of the geometry."""

    com_m: Points
    force_n: Points


@dataclass(frozen=True)
class ComparisonData:
    """Input of all estimators, and the truth if it is known. ``floor_height_m`` is the height of the plates."""

    geometric: GeometricCom
    wrench: WrenchTrack
    mass_kg: float
    truth: KnownMotion | None = None
    floor_height_m: float = 0.0


@dataclass(frozen=True)
class Assessment:
    """One estimate with its error figures; ``None`` where a check does not apply.

    ``offset_m`` is estimate minus geometry, mean over the window. ``offset_m``, ``residual_n`` and ``held_back_n`` are
    along the walk, lateral, vertical. ``spectrum`` is that of the error; without a truth, that of estimate minus
    geometry.
    """

    estimate: ComEstimate
    offset_m: PerAxis
    residual_n: PerAxis
    held_back_n: PerAxis | None
    momentum: MomentumAgreement | None
    flight: Flight | None
    standing: Standing | None
    truth: TruthError | None
    spectrum: ErrorSpectrum


@dataclass(frozen=True)
class Comparison:
    """Assessments by estimator name, errors of the estimators that failed, and the spectra of the three inputs.

    ``inputs`` has "geometry" (m), "force" (m/s^2) and "axis" (m): errors if the truth is known; otherwise "force" is
    the acceleration from the force minus that of the geometry, "axis" is the projection minus the geometry, and there
    is no "geometry".
    """

    assessments: Mapping[str, Assessment]
    failures: Mapping[str, StridelabError]
    inputs: Mapping[str, ErrorSpectrum]


def compare(estimators: Mapping[str, ComEstimator], data: ComparisonData) -> Comparison:
    """Run all estimators on ``data`` and assess each.

    An estimator that fails is listed with its error; if all fail, the first error is raised.
    """
    assessments: dict[str, Assessment] = {}
    refusals: dict[str, StridelabError] = {}
    for name, estimator in estimators.items():
        try:
            assessments[name] = assess_estimator(estimator, data)
        except StridelabError as error:
            refusals[name] = error
    if not assessments:
        raise next(iter(refusals.values()))
    return Comparison(assessments, refusals, input_spectra(data))


def assess_estimator(estimator: ComEstimator, data: ComparisonData) -> Assessment:
    """Run and assess one estimator on ``data``; raises as the estimator does."""
    geometric, wrench, mass_kg, truth = data.geometric, data.wrench, data.mass_kg, data.truth
    estimate = estimator.estimate(geometric, wrench, mass_kg)
    span = window_span(geometric, wrench)
    g = geometric.com_m[span.inside]
    turn = walk_frame(smoothed_derivatives(geometric.com_m[span.around], span.rate_hz)[0])
    residual = force_residual_track_n(estimate, wrench, mass_kg) @ turn.T
    if truth is None:
        spectrum = error_spectrum(estimate.com_m - g, span.rate_hz)
    else:
        spectrum = error_spectrum(error_m(estimate, geometric.time_s, truth.com_m), span.rate_hz)
    return Assessment(
        estimate=estimate,
        offset_m=np.mean(estimate.com_m - g, axis=0) @ turn.T,
        residual_n=np.sqrt(np.nanmean(residual**2, axis=0)),
        held_back_n=_withheld_residual_n(estimator, data),
        momentum=momentum_agreement(estimate, geometric, wrench, mass_kg),
        flight=assess_flight(estimate, wrench),
        standing=assess_standing(estimate, geometric, wrench, data.floor_height_m),
        truth=None if truth is None else truth_error(estimate, geometric.time_s, truth.com_m),
        spectrum=spectrum,
    )


def input_spectra(data: ComparisonData) -> Mapping[str, ErrorSpectrum]:
    """Spectra of the input errors over the window (figure 2.6); without a truth, of the input differences."""
    span = window_span(data.geometric, data.wrench)
    total = Wrench(data.wrench.force_n[span.inside], data.wrench.moment_nm[span.inside])
    inputs = filter_inputs(data.geometric.com_m[span.inside], total, data.mass_kg)
    g, a, p = inputs.geometry_m, inputs.acceleration_m_s2, inputs.axis_point_m
    if data.truth is None:
        of_geometry = smoothed_derivatives(data.geometric.com_m[span.around], span.rate_hz)[1][span.within]
        errors = {"force": a - of_geometry, "axis": p - g}
    else:
        c = data.truth.com_m[span.inside]
        true_a = com_acceleration(data.truth.force_n[span.inside], data.mass_kg)
        errors = {"geometry": g - c, "force": a - true_a, "axis": p - c}
    return {name: error_spectrum(error, span.rate_hz) for name, error in errors.items()}


def _withheld_residual_n(estimator: ComEstimator, data: ComparisonData) -> PerAxis | None:
    """Residual at withheld force; None if the estimator fails with half of the force."""
    try:
        return withheld_residual_n(estimator, data.geometric, data.wrench, data.mass_kg)
    except NotEstimable:
        return None
