"""Agreement of an estimate with physics, for recordings without a known truth.

- In flight there is no force, so the CoM accelerates with g: the parabola through its height during a flight must have
  that curvature.
- Standing still on plates, the mean centre of pressure lies below the mean CoM: ``z = c - h/g c''`` (2.9), and the mean
  of c'' vanishes over an interval in which the velocity does not change.
- The rate of the angular momentum that the plates imply, ``L' = nu - c x f`` (2.4), against that of the segments,
  ``d/dt sum m_i (c_i - c) x (c_i' - c')``. An error b of the CoM along the walk causes an error b f_z in L' about the
  lateral axis.
- The force required by the estimated acceleration, against the measured force.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, PerAxis, Points, Series, Vector3
from stridelab.dynamics.wrench import Wrench, contact_force, momentum_rate, zmp_of_wrench
from stridelab.estimation.differentiation import BAND_HZ, low_pass, smoothed_derivatives, walk_frame
from stridelab.estimation.estimator import ComEstimate
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import WrenchTrack

WindowPoints = Float[np.ndarray, "window 3"]
"""A track at an estimate's own samples."""
FLIGHT_N = 20.0
"""Force below which the body counts as in flight."""
SHORTEST_FLIGHT = 6
"""Minimum samples of a flight; its first and last samples are excluded."""
STILL_M_S = 0.05
"""RMS velocity below which the body stands: 0.02 m/s in healthy adults, more than 0.05 m/s at a walk of 0.3 m/s."""
MOMENTUM_BAND_HZ = 6.0
"""Band of the angular momentum rate: above it noise dominates second derivatives of marker positions."""


@dataclass(frozen=True)
class Flight:
    """``vertical_share`` is the vertical acceleration over g, minus one; ``horizontal_m_s2`` should be zero."""

    flights: int
    vertical_share: float
    horizontal_m_s2: float


@dataclass(frozen=True)
class Standing:
    """Mean CoM minus mean centre of pressure along x and y of the world, and its length."""

    offset_m: tuple[float, float]
    horizontal_m: float


@dataclass(frozen=True)
class MomentumAgreement:
    """About the axis of the walk, the lateral and the vertical axis: correlation and RMS of the difference in Nm."""

    correlation: PerAxis
    rms_nm: PerAxis


def assess_flight(estimate: ComEstimate, wrench: WrenchTrack) -> Flight | None:
    """Mean acceleration over all flights inside the window; None without flights."""
    rate_hz = (len(estimate.time_s) - 1) / (estimate.time_s[-1] - estimate.time_s[0])
    aloft = np.linalg.norm(track_at_samples(estimate, wrench.time_s, wrench.force_n), axis=1) < FLIGHT_N
    flights = [(i + 1, j - 1) for i, j in true_runs(aloft) if j - i >= SHORTEST_FLIGHT and i > 0 and j < len(aloft)]
    if not flights:
        return None
    # The variance of a parabola's curvature falls with the fifth power of the flight's duration.
    weight = np.array([float(j - i) ** 5 for i, j in flights])
    curvature = np.array([_parabola_curvature(estimate.com_m[i:j], rate_hz) for i, j in flights])
    a = weight @ curvature / weight.sum()
    return Flight(len(flights), float(-a[2] / GRAVITY_M_S2 - 1.0), float(np.hypot(a[0], a[1])))


def assess_standing(
    estimate: ComEstimate, geometric: GeometricCom, wrench: WrenchTrack, floor_height_m: float = 0.0
) -> Standing | None:
    """CoM against centre of pressure over the window; None unless the subject stands still."""
    rate_hz = (len(estimate.time_s) - 1) / (estimate.time_s[-1] - estimate.time_s[0])
    g = track_at_samples(estimate, geometric.time_s, geometric.com_m)
    if np.sqrt(np.mean(np.sum(smoothed_derivatives(g, rate_hz)[0] ** 2, axis=1))) > STILL_M_S:
        return None
    f, nu = (track_at_samples(estimate, wrench.time_s, track) for track in (wrench.force_n, wrench.moment_nm))
    pressure = zmp_of_wrench(Wrench(f, nu), np.array([0.0, 0.0, floor_height_m]), np.array([0.0, 0.0, 1.0]))
    x, y = (estimate.com_m - pressure).mean(axis=0)[:2]
    return Standing((float(x), float(y)), float(np.hypot(x, y)))


def momentum_agreement(
    estimate: ComEstimate, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float
) -> MomentumAgreement | None:
    """L' implied by the plates against that of the segments in a 6 Hz band; None without segments."""
    segments = segment_momentum_rate(geometric, mass_kg)
    if segments is None:
        return None
    rate_hz = (len(estimate.time_s) - 1) / (estimate.time_s[-1] - estimate.time_s[0])
    turn = walk_frame(smoothed_derivatives(track_at_samples(estimate, geometric.time_s, geometric.com_m), rate_hz)[0])
    f, nu = (track_at_samples(estimate, wrench.time_s, track) for track in (wrench.force_n, wrench.moment_nm))
    implied = low_pass(momentum_rate(estimate.com_m, Wrench(f, nu)), rate_hz, MOMENTUM_BAND_HZ) @ turn.T
    seen = track_at_samples(estimate, geometric.time_s, segments) @ turn.T
    edge = int(np.ceil(0.4 * rate_hz / MOMENTUM_BAND_HZ))
    implied, seen = implied[edge:-edge], seen[edge:-edge]
    return MomentumAgreement(_axis_correlation(implied, seen), np.sqrt(np.mean((implied - seen) ** 2, axis=0)))


def segment_momentum_rate(geometric: GeometricCom, mass_kg: float) -> Points | None:
    """d/dt of the angular momentum of the segments' point masses about the CoM, NaN outside the gap-free stretch.

    The rotation of each segment about its own CoM is neglected: it needs inertia tensors that the tables give for few
    segments, and is small compared with the motion of the segments' CoM. Near both ends the low-pass
    reads its own continuation.
    """
    if not geometric.segments:
        return None
    known = np.isfinite(geometric.com_m).all(axis=1)
    for segment in geometric.segments.values():
        known &= np.isfinite(segment.com_m).all(axis=1)
    if not known.any():
        return None
    i, j = max(true_runs(known), key=lambda run: run[1] - run[0])
    t = geometric.time_s[i:j]
    if len(t) < SHORTEST_FLIGHT:
        return None
    rate_hz = (len(t) - 1) / (t[-1] - t[0])
    momentum = np.zeros((j - i, 3))
    for segment in geometric.segments.values():
        arm = segment.com_m[i:j] - geometric.com_m[i:j]
        momentum += (
            segment.mass_fraction * mass_kg * np.cross(arm, smoothed_derivatives(arm, rate_hz, MOMENTUM_BAND_HZ)[0])
        )
    whole = np.full_like(geometric.com_m, np.nan)
    whole[i:j] = smoothed_derivatives(momentum, rate_hz, MOMENTUM_BAND_HZ)[0]
    return whole


def _axis_correlation(x: Points, y: Points) -> PerAxis:
    """Correlation per axis; NaN where one of the two is constant."""
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    norm = np.sqrt((x**2).sum(axis=0) * (y**2).sum(axis=0))
    return np.asarray(np.where(norm > 0.0, (x * y).sum(axis=0) / np.where(norm > 0.0, norm, 1.0), np.nan))


def _parabola_curvature(track: Points, rate_hz: float) -> PerAxis:
    """Second derivative of the parabola through the samples of one flight."""
    t = np.arange(len(track)) / rate_hz
    return np.asarray(2.0 * np.polyfit(t - t.mean(), track, 2)[0])


def force_residual_n(estimate: ComEstimate, wrench: WrenchTrack, mass_kg: float, band_hz: float = BAND_HZ) -> Vector3:
    """RMS of ``m (c'' - g) - f`` per axis over the window, both sides low-passed to ``band_hz`` (zero phase).

    c'' is the second derivative of the estimated *position*. The first and last ``0.6 / band_hz`` seconds, affected by
    filter transients, are excluded. A small residual does not prove accuracy: an estimator that integrates the force
    agrees with it by construction.
    """
    r = force_residual_track_n(estimate, wrench, mass_kg, band_hz)
    return np.asarray(np.sqrt(np.nanmean(r**2, axis=0)))


def force_residual_track_n(
    estimate: ComEstimate, wrench: WrenchTrack, mass_kg: float, band_hz: float = BAND_HZ
) -> Points:
    """``m (c'' - g) - f`` at the estimate's samples, as in ``force_residual_n``; NaN near the ends."""
    rate_hz = (len(estimate.time_s) - 1) / (estimate.time_s[-1] - estimate.time_s[0])
    first = int(np.argmin(np.abs(wrench.time_s - estimate.time_s[0])))
    f = low_pass(wrench.force_n[first : first + len(estimate.time_s)], rate_hz, band_hz)
    acceleration = smoothed_derivatives(estimate.com_m, rate_hz, band_hz)[1]
    edge = int(np.ceil(0.6 * rate_hz / band_hz))
    r = contact_force(acceleration, mass_kg) - f
    r[:edge] = r[-edge:] = np.nan
    return np.asarray(r)


def bias_m(estimate: ComEstimate, geometric: GeometricCom) -> Vector3:
    """Estimate minus geometry, mean over the window, per axis: correction of the geometric CoM by the force."""
    first = int(np.argmin(np.abs(geometric.time_s - estimate.time_s[0])))
    g = geometric.com_m[first : first + len(estimate.time_s)]
    return np.asarray(np.mean(estimate.com_m - g, axis=0))


def track_at_samples(estimate: ComEstimate, time_s: Series, track: Points) -> WindowPoints:
    """Part of a track at the estimate's samples."""
    first = int(np.argmin(np.abs(time_s - estimate.time_s[0])))
    return track[first : first + len(estimate.time_s)]
