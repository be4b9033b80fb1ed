"""Horizontal path of the centre of mass from the plates alone: the measurement against which an estimator is judged.

The force, integrated twice, is the path up to a line; the moment determines the line, since the angular momentum
about the centre of mass is bounded. With P the double integral of f/m + g, per horizontal axis

    c = c_0 + v_0 t + P(t) + sum_k a_k B_k(t),      L(t) = L_0 + int (nu - c x f) dt

are linear in the unknowns; B_k are double integrals of a constant and of hat functions, ``KNOT_S`` apart, for errors of
the plates that wander. They act at the floor, so that f in L is the corrected force. Least squares with L of the size
of a person's, and a_k of the size of the plates' errors (after Shimba 1984 and Zatsiorsky and King 1998, who used
instants of zero horizontal force). The geometry contributes only its height, which the horizontal force multiplies, and
the angular momentum of its segments, which is subtracted where it is known.

Vertically the force determines neither a height nor, without the exact mass, a curvature: there the path is compared
after a parabola through at most three seconds has been removed.

An estimator that has used the same force shares its errors e with the path p, so the squared distance is too small:

    E |c^ - p|^2 = E |c^ - c|^2 + E |e|^2 - 2 E (c^ - c) e

The second term is the same for all estimators; the third is the optimism of testing on the data of the fit. It is
estimated by the covariance penalty (Efron 2004): wrench, clock and mass are moved by plus and minus a draw of their
stated errors, and d c^ d p is averaged over draws and window. Nothing is withheld, so that the estimator that is judged
is the one that is used.

The momentum that the segments do not explain is drawn with their own frequencies. In a window T an oscillation
A sin(w t) of L has the slope 12 A / (w T^2) against t, to which the lever of a shift c_0 integrates: it moves path and
estimates in proportion to 1/w, so that a draw slower than the body makes all pay that use moments.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import signal
from scipy.integrate import cumulative_trapezoid

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, PerAxis, Points
from stridelab.dynamics.wrench import Wrench, com_acceleration
from stridelab.estimation.differentiation import Span, smoothed_derivatives, walk_frame, window_span
from stridelab.estimation.estimator import ComEstimator
from stridelab.recordings.recording import WrenchTrack

KNOT_S: Final = 0.5
PLATE_N: Final = 1.5
WANDER_N: Final = 1.0
"""Sizes of the constant and of the changing force errors that the path may correct."""
MOMENTUM_NMS: Final = (1.0, 2.0)
"""RMS of L about the walking and the lateral axis at 70 kg and 1.70 m; the mean of both is used for every direction."""
UNEXPLAINED: Final = 0.4
"""Share of L that the segments do not explain."""
UNEXPLAINED_ALOFT: Final = 0.7
"""Further part of it in a movement with flights, over the L of the segments there: soft tissue moves more."""
INDEPENDENT_PER_S: Final = 4.0
"""Independent values of L per second."""
BLOCK_S: Final = 3.0
"""Longest parabola: beyond it the plates' own errors, integrated twice, exceed a millimetre."""
STEP_S: Final = 0.55
STRIDE_HZ: Final = 0.9
STANDS_SHARE: Final = 0.01
"""Standard deviation of the vertical force over the weight below which a body does not swing its limbs."""

LOADED_N: Final = 20.0
DRAWS: Final = 4
"""Draws of the plates' errors. With a single one the band of a recording is known to a factor of two."""

Path = Float[np.ndarray, "n 2"]


@dataclass(frozen=True, kw_only=True)
class PlateErrors:
    """Standard deviations of the errors that estimate and force path share.

    ``force_n`` and ``moment_nm`` are constant for one plate, half of their variance common to all; ``noise_n`` and
    ``noise_nm`` are white. ``clock_s`` is the error of the corrected latency, ``mass_share`` that of the mass.
    ``momentum_share`` is the part of L that the segments do not explain.
    """

    force_n: float = 1.0
    moment_nm: float = 1.0
    noise_n: float = 3.0
    noise_nm: float = 1.0
    clock_s: float = 0.003
    mass_share: float = 0.005
    momentum_share: float = 0.4


@dataclass(frozen=True)
class PathError:
    """Mean squares along the walk, lateral and vertical: distance from the force path, and the covariance penalty.

    ``coverage_95`` is the share of samples whose distance lies within the 95 % band of the errors of estimate and path
    together: what draws of the plates' errors do to the distance, and the stated variance of the estimate beyond
    what the draws do to it.
    """

    distance_m2: PerAxis
    penalty_m2: PerAxis
    coverage_95: PerAxis

    @property
    def square_m2(self) -> PerAxis:
        """Expected squared error of the estimate plus that of the force path, which all estimators share."""
        return np.asarray(self.distance_m2 + 2.0 * self.penalty_m2)


def path_error(
    estimator: ComEstimator,
    geometric: GeometricCom,
    wrench: WrenchTrack,
    mass_kg: float,
    errors: PlateErrors | None = None,
    seed: int = 0,
    draws: int = DRAWS,
) -> PathError:
    """Judge an estimator on the window of a recording. Raises as the estimator does.

    Costs one estimate and two for each of the ``draws`` of the plates' errors. ``seed`` is that of the draws; only
    estimators with the same one are comparable.
    """
    span = window_span(geometric, wrench)
    rate_hz, inside = span.rate_hz, span.inside
    known = momentum_of_segments_nms(geometric, inside, mass_kg, rate_hz)
    turn = walk_frame(smoothed_derivatives(geometric.com_m[span.around], rate_hz)[0])

    def judged(track: WrenchTrack, mass: float) -> tuple[Points, Points, Points]:
        """Estimate, and minus the force path, both as ``distance_from_force_m`` compares them; the stated sd."""
        part = Wrench(track.force_n[inside], track.moment_nm[inside])
        path = force_path_m(part, geometric.com_m[inside, 2], known, mass, rate_hz)
        estimate = estimator.estimate(geometric, track, mass_kg=mass)
        com = estimate.com_m
        at_rest = np.zeros_like(part.force_n)
        at_rest[:, 2] = mass * GRAVITY_M_S2
        still = distance_from_force_m(com, np.zeros_like(path), at_rest, mass, rate_hz)
        minus = distance_from_force_m(np.zeros_like(com), path, part.force_n, mass, rate_hz)
        return still, minus, estimate.sd_m

    sizes = errors or PlateErrors()
    # A draw of the clock must not be found in the recording: it stands for the error of an estimate from it.
    wrench = replace(wrench, clocks_compared=True)
    com, minus_path, sd_m = judged(wrench, mass_kg)
    rng = np.random.default_rng(seed)
    height_m = float(np.mean(geometric.com_m[inside, 2]))
    momentum = _unexplained_nms(known, wrench.force_n[inside], mass_kg, height_m, sizes.momentum_share)
    changes = []
    for _ in range(draws):
        pair = _moved_wrenches(geometric, wrench, span, mass_kg, known, momentum, sizes, rng)
        more, less = (judged(track, mass) for track, mass in pair)
        changes.append([(more[k] - less[k]) / 2 @ turn.T for k in (0, 1)])
    d_com, d_minus_path = np.swapaxes(np.array(changes), 0, 1)
    distance = (com + minus_path) @ turn.T
    penalty_m2 = -np.mean(d_com * d_minus_path, axis=(0, 1))
    own_m2 = np.maximum(sd_m**2 @ (turn**2).T - np.mean(d_com**2, axis=(0, 1)), 0.0)
    variance_m2 = np.maximum(own_m2 + np.mean((d_com + d_minus_path) ** 2, axis=(0, 1)), 1e-12)
    return PathError(
        distance_m2=np.mean(distance**2, axis=0),
        penalty_m2=penalty_m2,
        coverage_95=np.mean(np.abs(distance) <= 1.96 * np.sqrt(variance_m2), axis=0),
    )


def _moved_wrenches(
    geometric: GeometricCom,
    wrench: WrenchTrack,
    span: Span,
    mass_kg: float,
    known_nms: Points | None,
    momentum_nms: Float[np.ndarray, "2"],
    sizes: PlateErrors,
    rng: np.random.Generator,
) -> list[tuple[WrenchTrack, float]]:
    """Wrench and mass moved by plus and minus one draw; constants have the size itself, of random sign.

    The moment of the unexplained momentum acts in flight, too: there the segments' momentum is no less wrong.
    """
    t, n = wrench.time_s, len(wrench.time_s)
    step = ((t - t[0]) / STEP_S).astype(int)

    def constants() -> Points:
        signs = rng.choice([-1.0, 1.0], (step[-1] + 2, 3))
        return np.asarray((signs[-1] + signs[step]) / np.sqrt(2))

    force = sizes.force_n * constants() + sizes.noise_n * rng.normal(size=(n, 3))
    moment = sizes.moment_nm * constants() + sizes.noise_nm * rng.normal(size=(n, 3))
    loaded = np.nan_to_num(wrench.force_n[:, 2:]) > LOADED_N
    force, moment = force * loaded, moment * loaded
    if np.std(wrench.force_n[span.inside, 2]) > STANDS_SHARE * mass_kg * GRAVITY_M_S2:
        height_m = float(np.mean(geometric.com_m[span.inside, 2]))
        size = np.append(momentum_nms, 0.0)
        drawn = _strides_nms(t[span.inside], height_m, rng) if known_nms is None else _out_of_phase(known_nms, rng)
        moment[span.inside] += np.gradient(size * drawn, 1 / span.rate_hz, axis=0)
    moment = moment + np.cross(geometric.com_m * [1.0, 1.0, 0.0], force)
    late = sizes.clock_s * rng.choice([-1.0, 1.0]) * span.rate_hz
    force = force + late * np.gradient(wrench.force_n, axis=0)
    moment = moment + late * np.gradient(wrench.moment_nm, axis=0)
    heavier = sizes.mass_share * float(rng.choice([-1.0, 1.0]))
    return [
        (
            replace(wrench, force_n=wrench.force_n + sign * force, moment_nm=wrench.moment_nm + sign * moment),
            mass_kg * (1 + sign * heavier),
        )
        for sign in (1.0, -1.0)
    ]


def _strides_nms(time_s: Float[np.ndarray, "n"], height_m: float, rng: np.random.Generator) -> Points:
    """Momentum of an unknown body in units of its size: three harmonics of a stride of usual length."""
    track = np.zeros((len(time_s), 3))
    for times in (1, 2, 3):
        w = 2 * np.pi * times * STRIDE_HZ * np.sqrt(0.93 / height_m)
        phase, sign = rng.uniform(0, 2 * np.pi, 3), rng.choice([-1.0, 1.0], 3)
        track += sign * np.cos(w * time_s[:, None] + phase) / times
    return track


def _out_of_phase(momentum_nms: Points, rng: np.random.Generator) -> Points:
    """The given momentum without its line, of RMS 1, all frequencies of an axis turned by one random phase."""
    track = signal.detrend(momentum_nms, axis=0)
    turned = np.fft.rfft(track, axis=0) * np.exp(1j * rng.uniform(0, 2 * np.pi, 3))
    turned[0] = 0.0
    return np.asarray(np.fft.irfft(turned, len(track), axis=0) / np.maximum(track.std(axis=0), 1e-9))


def _momentum_size(mass_kg: float, height_m: float) -> float:
    """RMS of L of an adult, scaled to a body whose centre of mass is at ``height_m``."""
    return float(mass_kg * height_m**2 / (70.0 * 0.93**2) * np.mean(MOMENTUM_NMS))


def _unexplained_nms(
    momentum_nms: Points | None, force_n: Points, mass_kg: float, height_m: float, share: float
) -> Float[np.ndarray, "2"]:
    """RMS about x and y of the part of L that is not known; ``share`` is that of a movement without flight."""
    size = np.full(2, _momentum_size(mass_kg, height_m))
    if momentum_nms is None:
        return size
    aloft = UNEXPLAINED_ALOFT * (force_n[:, 2].min() < LOADED_N)
    return np.asarray(np.hypot(share * size, aloft * momentum_nms[:, :2].std(axis=0)))


def force_path_m(
    wrench: Wrench, height_m: Float[np.ndarray, "n"], momentum_nms: Points | None, mass_kg: float, rate_hz: float
) -> Path:
    """Horizontal path (x, y) in metres from a gap-free wrench about the world origin.

    ``height_m`` is the height of the centre of mass at every sample; ``momentum_nms`` is the known part of L.
    """
    f, nu, n = wrench.force_n, wrench.moment_nm, len(wrench.force_n)
    t = np.arange(n) / rate_hz
    double = _twice_integrated(com_acceleration(f, mass_kg)[:, :2], rate_hz)
    knots = np.linspace(0.0, t[-1], max(2, round(t[-1] / KNOT_S) + 1))
    hats = np.maximum(0.0, 1.0 - np.abs(t[:, None] - knots) / (knots[1] - knots[0]))
    errors = np.column_stack([np.ones(n), hats])
    basis = np.column_stack([np.ones(n), t, _twice_integrated(errors, rate_hz)])
    known = np.zeros((n, 3)) if momentum_nms is None else momentum_nms
    size = _unexplained_nms(momentum_nms, f, mass_kg, float(height_m.mean()), UNEXPLAINED)
    prior = np.zeros((errors.shape[1], basis.shape[1] + 1))
    prior[:, 2:-1] = np.diag(mass_kg / np.array([PLATE_N, *[WANDER_N] * len(knots)]))
    out = np.empty((n, 2))
    # (c x f)_y = c_z f_x - c_x f_z and (c x f)_x = c_y f_z - c_z f_y
    for axis, other, sign in ((0, 1, -1.0), (1, 0, 1.0)):
        free = nu[:, other] + sign * (height_m * f[:, axis] - double[:, axis] * f[:, 2])
        momentum = cumulative_trapezoid(free, dx=1 / rate_hz, initial=0.0) - known[:, other]
        lever = basis * f[:, 2:]
        lever[:, 2:] -= mass_kg * height_m[:, None] * errors
        row = 1.0 / (size[other] * np.sqrt(rate_hz / INDEPENDENT_PER_S))
        moved = sign * cumulative_trapezoid(lever, dx=1 / rate_hz, axis=0, initial=0.0)
        design = np.vstack([row * np.column_stack([moved, np.ones(n)]), prior])
        target = np.concatenate([row * momentum, np.zeros(len(prior))])
        unknowns = np.linalg.lstsq(design, target, rcond=None)[0]
        out[:, axis] = double[:, axis] + basis @ unknowns[:-1]
    return out


def distance_from_force_m(com_m: Points, path_m: Path, force_n: Points, mass_kg: float, rate_hz: float) -> Points:
    """Estimate minus force path: horizontally as it is, vertically without a parabola in each ``BLOCK_S``."""
    vertical = com_m[:, 2] - _twice_integrated(com_acceleration(force_n, mass_kg)[:, 2:], rate_hz)[:, 0]
    blocks = max(1, round(len(vertical) / rate_hz / BLOCK_S))
    moving = np.concatenate([part - _parabola(part) for part in np.array_split(vertical, blocks)])
    return np.column_stack([com_m[:, :2] - path_m, moving])


def momentum_of_segments_nms(geometric: GeometricCom, samples: slice, mass_kg: float, rate_hz: float) -> Points | None:
    """Angular momentum of the segments as point masses; None unless all segments are known there."""
    total = np.zeros_like(geometric.com_m[samples])
    for segment in geometric.segments.values():
        arm = (segment.com_m - geometric.com_m)[samples]
        if not np.isfinite(arm).all():
            return None
        total += segment.mass_fraction * mass_kg * np.cross(arm, smoothed_derivatives(arm, rate_hz)[0])
    return total if geometric.segments else None


def _twice_integrated(x: Float[np.ndarray, "n k"], rate_hz: float) -> Float[np.ndarray, "n k"]:
    once = cumulative_trapezoid(x, dx=1 / rate_hz, axis=0, initial=0.0)
    return np.asarray(cumulative_trapezoid(once, dx=1 / rate_hz, axis=0, initial=0.0))


def _parabola(x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    t = np.linspace(-1.0, 1.0, len(x))
    return np.asarray(np.polynomial.Polynomial.fit(t, x, 2)(t))
