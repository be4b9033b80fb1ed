"""Computes the smoother's signals from geometry and wrench: walking frame, reduced moments, step frequency.

Both horizontal moments are reduced to the 4 Hz geometry c_ref, which removes their large known part:

    nu - c_ref x f = (c - c_ref) x f + L'  ~  (c - c_ref) x (0, 0, m g) + L'

and divided by the weight they are positions: x = -(...)^y / m g + phi c_ref^x, y = (...)^x / m g + phi c_ref^y.
The lever is multiplied by the noise-free weight; the noise of a measured force would act as spurious information about
the height, which is not observable (docs/theory/smoother.md).

Consistency checks of the smoother: single support in the window, and errors in agreement with their priors.

Without a full single support, angular momentum and an error of the segment table cannot be distinguished.

A constant error of the force is observable: integrated twice, it moves the CoM away from the geometry. Its posterior
mean m and variance V satisfy m ~ N(0, P0 - V) if the prior variance P0 is true, so m^2 / (P0 - V) is chi-squared with
one degree of freedom. A constant error of the *moment* is not observable: it has the effect of a table error.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from stridelab.conventions import GRAVITY_M_S2, Mask, Points, Rotation, Series, Vector3
from stridelab.dynamics.wrench import com_acceleration
from stridelab.errors import NotEstimable
from stridelab.estimation.differentiation import low_pass, walk_frame
from stridelab.estimation.smoother.kalman_rts import ForwardPass, Gains, Signals
from stridelab.estimation.smoother.state_space import ACCELERATION, HEIGHT, StateSpace
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Remark

REFERENCE_BAND_HZ = 4.0
STEP_RANGE_HZ = (0.8, 5.0)
AIRBORNE_N = 50.0
BRIDGE_S = 0.2
"""Longest gap of the force over which its acceleration is interpolated: a flight in running is shorter."""
BESIDE, CALM_SHARE = 3, 0.25
"""Samples beside a gap that show whether the body is in flight there; change of the vertical force over the weight from
one sample to the next, at the calmer end, up to which the force is known at the end."""
FEWEST_TO_SHIFT = 4
"""Shortest run of samples with force that can be read at another time."""
WALKS_M_S = 0.1
END_S, FULL_SWING = 0.3, 0.6


@dataclass(frozen=True)
class Walk:
    """Geometry and wrench of a gap-free stretch in the walking frame (rows of ``frame``), and its mean velocity.

    ``ground_m_s`` is the velocity of the walking surface, of a treadmill's belt or zero. Force, pressure and velocity
    refer to the laboratory; only frame and speed are relative to the surface.
    """

    frame: Rotation
    geometry_m: Points
    force_n: Points
    moment_nm: Points
    seen: Mask
    rate_hz: float
    velocity_m_s: Vector3
    ground_m_s: Vector3

    @property
    def speed_m_s(self) -> float:
        """Horizontal part of the mean velocity relative to the walking surface."""
        return float(np.linalg.norm((self.velocity_m_s - self.ground_m_s)[:2]))


def in_walking_frame(
    geometry_m: Points, force_n: Points, moment_nm: Points, seen: Mask, rate_hz: float, ground_m_s: Vector3
) -> Walk:
    """Rotate all signals so that x is the mean horizontal direction over the ground; missing forces are 0."""
    duration = (len(geometry_m) - 1) / rate_hz
    velocity = (geometry_m[-1] - geometry_m[0]) / duration
    frame = walk_frame((velocity - ground_m_s)[None])
    measured = seen[:, None]
    f, nu = (np.where(measured, x, 0.0) @ frame.T for x in (force_n, moment_nm))
    return Walk(frame, geometry_m @ frame.T, f, nu, seen, rate_hz, frame @ velocity, frame @ ground_m_s)


def read_later(walk: Walk, late_s: float) -> Walk:
    """The same with the wrench read ``late_s`` later; samples that would be read beyond a gap or an end are missing."""
    read = np.hstack([walk.force_n, walk.moment_nm])
    seen = walk.seen.copy()
    for i, j in true_runs(walk.seen):
        at = np.arange(i, j) + late_s * walk.rate_hz
        seen[i:j] = (at >= i) & (at <= j - 1) & (j - i > FEWEST_TO_SHIFT)
        if seen[i:j].any():
            read[i:j] = CubicSpline(np.arange(i, j), read[i:j])(at)
    read[~seen] = 0.0
    return replace(walk, force_n=read[:, :3], moment_nm=read[:, 3:], seen=seen)


def smoother_signals(walk: Walk, mass_kg: float) -> Signals:
    """y1, y2 and the trapezoidal acceleration, without the angular momentum of the segments."""
    weight = mass_kg * GRAVITY_M_S2
    reference = low_pass(walk.geometry_m, walk.rate_hz, REFERENCE_BAND_HZ)
    reduced = walk.moment_nm - np.cross(reference, walk.force_n)
    smooth = low_pass(walk.force_n, walk.rate_hz, REFERENCE_BAND_HZ)
    phi = supported_share(walk, smooth, weight)
    y2 = moment_in_metres(reduced, weight) + phi[:, None] * reference
    a = com_acceleration(walk.force_n, mass_kg)
    bridged = short_gaps(walk, weight)
    at, known = np.arange(len(a)), np.flatnonzero(walk.seen)
    for axis in range(3):
        a[:, axis] = np.interp(at, known, a[known, axis])
    trapezoid = np.concatenate([(a[:-1] + a[1:]) / 2, np.zeros((1, 3))])
    y2 = np.where(walk.seen[:, None], y2, 0.0)
    return Signals(
        geometry_m=walk.geometry_m,
        moment_m=y2,
        acceleration_m_s2=trapezoid,
        seen=walk.seen,
        turning=walk.seen,
        bridged=bridged,
        phi=phi,
        sway=smooth / weight * walk.seen[:, None],
        segments_m=np.zeros_like(y2),
        velocity_m_s=walk.velocity_m_s,
    )


UNEXPLAINED_S, UNEXPLAINED_SHARE = 0.17, 0.1
"""Time from either end of the tracks in which the rate of the segments' momentum is not known, since its low-pass reads
beyond them, and the largest part of the samples with force that is left out for it."""


def without_ends(signals: Signals, rate_hz: float) -> Signals:
    """Without the moments next to the ends of the tracks, where the segments do not explain them."""
    n = round(min(UNEXPLAINED_S * rate_hz, UNEXPLAINED_SHARE * np.count_nonzero(signals.seen)))
    turning = signals.seen.copy()
    turning[:n] = turning[len(turning) - n :] = False
    return replace(signals, turning=turning)


def short_gaps(walk: Walk, weight_n: float) -> Mask:
    """Steps, from a sample to the next, in gaps of the force of at most ``BRIDGE_S`` between two samples with force.

    Not between two flights, since the contact between them is not like its ends, and not where the force changes fast
    on both sides, so that it is not known at the ends.
    """
    seen, vertical_n = walk.seen, walk.force_n[:, 2]
    bridged = np.zeros(len(seen), dtype=np.bool_)
    for i, j in true_runs(~seen):
        if i > 0 and j < len(seen) and j - i <= BRIDGE_S * walk.rate_hz:
            sides = vertical_n[max(0, i - BESIDE) : i][::-1], vertical_n[j : j + BESIDE]
            loaded = all(side.max() > AIRBORNE_N for side in sides)
            calm = min(abs(side[0] - side[1]) if len(side) > 1 else np.inf for side in sides) < CALM_SHARE * weight_n
            bridged[i - 1 : j] = loaded and calm
    return bridged


def moment_in_metres(moment_nm: Points, weight_n: float) -> Points:
    """Horizontal moments in the walking frame as positions: -y and x over the weight; 0 vertically."""
    return np.column_stack([-moment_nm[:, 1], moment_nm[:, 0], np.zeros(len(moment_nm))]) / weight_n


def supported_share(walk: Walk, smooth_force_n: Points, weight_n: float) -> Series:
    """Vertical force over weight used in the gain: 1 in walking, low-passed f_z for motions with flight."""
    if not (walk.seen & (walk.force_n[:, 2] < AIRBORNE_N)).any():
        return np.ones(len(walk.geometry_m))
    return np.where(walk.seen, np.maximum(smooth_force_n[:, 2] / weight_n, 0.0), 1.0)


def step_frequency_hz(walk: Walk) -> float | None:
    """Frequency of the strongest vertical oscillation between 0.8 and 5 Hz (a sprint); None without walking."""
    z = walk.geometry_m[:, 2]
    n = len(z)
    t = np.linspace(-1, 1, n)
    z = (z - np.polynomial.Polynomial.fit(t, z, 1)(t)) * np.hanning(n)
    padded = int(2 ** np.ceil(np.log2(max(n, 20 * walk.rate_hz))))
    power = np.abs(np.fft.rfft(z, padded)) ** 2
    f = np.fft.rfftfreq(padded, 1 / walk.rate_hz)
    inside = (f >= STEP_RANGE_HZ[0]) & (f <= STEP_RANGE_HZ[1])
    peak = f[inside][np.argmax(power[inside])]
    return float(peak) if walk.speed_m_s > WALKS_M_S else None


def swing_at_ends(walk: Walk) -> tuple[float, float]:
    """Share of the walk's angular momentum swing at its first and last sample; zero at rest.

    It is the speed there, from a line through ``END_S``, over ``FULL_SWING`` times the mean speed, at most 1.
    """
    n = round(END_S * walk.rate_hz)
    if walk.speed_m_s < WALKS_M_S or len(walk.geometry_m) < 2 * n:
        return 1.0, 1.0
    t = np.arange(n) / walk.rate_hz
    first, last = (
        float(np.linalg.norm(np.polynomial.polynomial.polyfit(t, part[:, :2], 1)[1] - walk.ground_m_s[:2]))
        for part in (walk.geometry_m[:n], walk.geometry_m[-n:])
    )
    full = FULL_SWING * walk.speed_m_s
    return min(1.0, first / full), min(1.0, last / full)


CONSISTENCY_WALKS_M_S: Final = 0.3
SHARE_OF_STEP: Final = 0.65
"""A full single support lasts 0.75 to 0.85 of a step in walking."""
CERTAIN_STEPS: Final = 1.8
"""Duration of a window in steps that always contains a full single support."""
LOADED_N: Final = 50.0


def require_single_support(walk: Walk, within: slice, step_hz: float) -> None:
    """Raise ``NotEstimable`` (``no-single-support``) for a short window without a full single support.

    In single support the centre of pressure stays on one side of the CoM; it changes sides in double support. A contact
    between two flights on one side of the CoM is a full single support, however short.
    """
    n = within.stop - within.start
    step = walk.rate_hz / step_hz
    if walk.speed_m_s < CONSISTENCY_WALKS_M_S or n >= CERTAIN_STEPS * step:
        return
    f, nu = walk.force_n[within], walk.moment_nm[within]
    loaded = f[:, 2] > LOADED_N
    side = np.sign(nu[loaded, 0] / f[loaded, 2] - walk.geometry_m[within][loaded, 1])
    number = np.cumsum(loaded) - 1
    if any(i > 0 and j < n and np.ptp(side[number[i] : number[j - 1] + 1]) == 0 for i, j in true_runs(loaded)):
        return
    changes = np.flatnonzero(np.diff(side)) + 1
    longest = np.diff(np.concatenate([[0], changes, [len(side)]])).max()
    if longest < SHARE_OF_STEP * step:
        raise NotEstimable(
            "no-single-support",
            f"The longest time on one foot in the window is {longest / walk.rate_hz:.2f} s of a step of "
            f"{1 / step_hz:.2f} s. At least one full single support is needed.",
        )


FALSE_ALARMS: Final = 1e-3
MIN_LEARNT_SHARE: Final = 0.05
"""Minimum share of the prior variance that the data must have removed for a meaningful test."""


def plate_bias_statistic(space: StateSpace, forward: ForwardPass) -> float:
    """Sum of m^2 / (P0 - V) over the two horizontal axes: chi-squared with two degrees of freedom."""
    return float(_bias_statistics(space, forward).sum())


def plate_bias_remarks(
    space: StateSpace, forward: ForwardPass, mass_kg: float, declared_n: float, frame: Rotation
) -> tuple[Remark, ...]:
    """Remark if the estimated bias of the horizontal force is improbable (1 in 1000) under the declared one.

    The bias is given in the axes of the laboratory; the rows of ``frame`` are the walking axes.
    """
    if plate_bias_statistic(space, forward) < -2.0 * np.log(FALSE_ALARMS):
        return ()
    bias_n = mass_kg * forward.constants[:, ACCELERATION] @ frame
    return (
        Remark(
            "undeclared-plate-bias",
            f"Force and markers agree only if the plates are off by {bias_n[0]:+.1f} N along x and {bias_n[1]:+.1f} N "
            f"along y, and {declared_n:g} N is declared: the stated band is too narrow. "
            "Zero the plates, or declare the bias.",
        ),
    )


def normalised_innovations(gain_sets: Gains, forward: ForwardPass) -> float:
    """Mean of e' S^-1 e over its degrees of freedom, without the constants: 1 if all error sizes are true."""
    e = forward.innovations[..., 0] + np.einsum(
        "kamc,ac->kam", forward.innovations[..., 1 : HEIGHT + 1], forward.constants
    )
    squares = np.einsum("kam,kamn,kan->", e, gain_sets.information[gain_sets.use], e)
    return float(squares / (gain_sets.information[gain_sets.use][:, :, [0, 1], [0, 1]] > 1e-6).sum())


def _bias_statistics(space: StateSpace, forward: ForwardPass) -> np.ndarray:
    prior = space.constant_sd[:2, ACCELERATION] ** 2
    learnt = prior - forward.constants_cov[:2, ACCELERATION, ACCELERATION]
    informative = learnt > MIN_LEARNT_SHARE * prior
    m = forward.constants[:2, ACCELERATION]
    return np.where(informative, m**2 / np.where(informative, learnt, 1.0), 0.0)
