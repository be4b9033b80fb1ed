"""The state space of the smoother: 29 coloured-error states that fall apart into three small ones.

With the moments reduced to metres (``signals``), every axis of the walking frame has its own model. Eight states

    c, v      position and velocity of the CoM; the measured acceleration drives them
    b         slow error of the segment table (Ornstein-Uhlenbeck)
    p, q, r   low-pass memories that make the noise of geometry, force and moment high-passed
    l, l'     angular momentum over weight, a damped resonator: bounded, so that its derivative has no mean

and three unknown constants: table error b0, acceleration error (plates, mass), moment error (plates, clocks). Those are
not states but regression coefficients (``recursions``), so that the gains converge. Measurements in metres:

    y1 = c + b0 + b + (w - p)                      geometry, white w
    y2 = phi c + l' + (z/g) ab + mu + (n - r)      moment over weight, white n

phi is 1, the weight over itself; in running the low-passed vertical force over it, never the measured one.

The noises w and n also drive their own memories p and r one step later. Such correlation is taken out by writing
the measurement into the transition: A - G H and an input G y (Anderson & Moore, Optimal Filtering, 5.5).
A force bias of ``ab`` metres per second squared acts at the floor, z below the CoM, and so in y2 as well.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.smoother.priors import SmootherPriors

STATES, MEASURED, CONSTANTS = 8, 2, 3
C, V, B, P, Q, R, L, DL = range(STATES)
TABLE, ACCELERATION, MOMENT = range(CONSTANTS)
UNSEEN_M2 = 1e8
"""Variance of a measurement that does not exist."""

AxesByState = Float[np.ndarray, "3 8"]
Covariance = Float[np.ndarray, "3 8 8"]
PerAxis = Float[np.ndarray, "3"]
Constants = Float[np.ndarray, "3 3"]


@dataclass(frozen=True)
class Circumstances:
    """What of one recording enters the model: rate, mass, height of the CoM, steps, speed and the table's error.

    ``speed_m_s`` is horizontal; ``sway_n`` the RMS of the force along each axis, which an error in height turns into a
    moment. ``frame`` has the walking direction, the lateral and the vertical axis as rows.
    """

    rate_hz: float
    mass_kg: float
    height_m: float
    step_hz: float
    speed_m_s: float
    sway_n: PerAxis
    table_sd_m: PerAxis


@dataclass(frozen=True)
class Regime:
    """Transition and noise of one kind of sample; axes x, y, z of the walking frame first."""

    transition: Covariance
    process: Covariance
    feed: Float[np.ndarray, "3 8 2"]
    noise_m2: Float[np.ndarray, "3 2"]


@dataclass(frozen=True)
class StateSpace:
    """Everything that does not depend on the data. ``regimes``: force seen and going on, seen last, not seen."""

    regimes: tuple[Regime, Regime, Regime]
    start_covariance: Covariance
    constant_sd: Constants
    moment_per_constant: Float[np.ndarray, "3"]
    drive: Float[np.ndarray, "8"]


def adult_momentum_m_s(mass_kg: float, height_m: float) -> tuple[float, float]:
    """RMS of L / (m g) about the walking and the lateral axis: 1.0 and 1.5 Nms at 70 kg and 1.70 m, scaled.

    The CoM lies at 0.55 of the stature.
    """
    scale = (height_m / 0.55) ** 2 / (70.0 * 1.7**2 * GRAVITY_M_S2)
    return 1.0 * scale, 1.5 * scale


def state_space(priors: SmootherPriors, at: Circumstances) -> StateSpace:
    """The model (module docstring) for these priors."""
    dt, weight = 1.0 / at.rate_hz, at.mass_kg * GRAVITY_M_S2
    marker_pole, plate_pole = (np.exp(-2 * np.pi * f * dt) for f in (priors.marker_corner_hz, priors.plate_corner_hz))
    white_marker = priors.marker_m * np.sqrt((1 + marker_pole) / 2)
    white_force = priors.force_n / at.mass_kg * np.sqrt((1 + plate_pole) / 2)
    moment = np.hypot(priors.moment_nm, at.height_m * priors.force_n) / weight
    white_moment = moment * np.sqrt((1 + plate_pole) / 2)
    lever = at.table_sd_m[2] * at.sway_n / weight
    drive = np.zeros(STATES)
    drive[[C, V]] = dt * dt / 2, dt

    a = np.zeros((3, STATES, STATES))
    q = np.zeros_like(a)
    start = np.zeros_like(a)
    a[:, C, C] = a[:, V, V] = 1.0
    a[:, C, V] = dt
    slow = np.exp(-dt / priors.table_varying_s)
    a[:, B, B] = slow
    q[:, B, B] = priors.table_varying_m**2 * (1 - slow**2)
    start[:, C, C], start[:, V, V], start[:, B, B] = 0.25, 4.0, priors.table_varying_m**2
    for memory, pole, white in (
        (P, marker_pole, white_marker),
        (Q, plate_pole, white_force),
        (R, plate_pole, white_moment),
    ):
        a[:, memory, memory] = pole
        start[:, memory, memory] = (1 - pole) / (1 + pole) * white**2
    momentum = priors.momentum_m_s or adult_momentum_m_s(at.mass_kg, at.height_m)
    # The moment about the lateral axis moves x, the one about the walking axis moves y.
    for axis, sd, hz in ((0, momentum[1], at.step_hz), (1, momentum[0], at.step_hz / 2)):
        a[axis, L:, L:], q[axis, L:, L:], start[axis, L:, L:] = _resonator(sd, hz, priors.damping, dt)

    seen = a.copy()
    seen[:, C, Q], seen[:, V, Q] = drive[C], drive[V]
    u = drive.copy()
    u[Q] = 1 - plate_pole
    # The force is measured + (q - u) away from the truth; see ``drive``.
    u[[C, V]] *= -1.0
    with_force = q + white_force**2 * np.outer(u, u)
    beyond = priors.acceleration_beyond_m_s2 * np.sqrt(priors.acceleration_beyond_s / dt)
    without = q + beyond**2 * np.outer(drive, drive)
    unfed = without.copy()
    unfed[:, R, R] += (1 - plate_pole) ** 2 * white_moment**2
    for matrix in (without, unfed):
        matrix[:, Q, Q] += (1 - plate_pole) ** 2 * white_force**2

    feed = np.zeros((3, STATES, MEASURED))
    feed[:, P, 0] = 1 - marker_pole
    fed_moment = feed.copy()
    fed_moment[:2, R, 1] = 1 - plate_pole
    noise = np.full((3, 2), white_marker**2)
    noise[:, 1] = UNSEEN_M2
    noise_seen = noise.copy()
    noise_seen[:2, 1] = white_moment**2 + lever[:2] ** 2
    bias = np.zeros((3, CONSTANTS))
    bias[:, TABLE] = at.table_sd_m
    bias[:, ACCELERATION] = np.hypot(priors.plate_force_n / at.mass_kg, [0, 0, priors.mass_share * GRAVITY_M_S2])
    bias[:2, MOMENT] = np.hypot(priors.plate_moment_nm / weight, [priors.clock_s * at.speed_m_s, 0.0])
    return StateSpace(
        regimes=(
            Regime(seen, with_force, fed_moment, noise_seen),
            Regime(a, without, fed_moment, noise_seen),
            Regime(a, unfed, feed, noise),
        ),
        start_covariance=start,
        constant_sd=bias,
        moment_per_constant=np.array([0.0, at.height_m / GRAVITY_M_S2, 1.0]),
        drive=drive,
    )


def observation(phi: float) -> Float[np.ndarray, "3 2 8"]:
    """Rows of y1 and y2; the vertical axis has no moment row."""
    h = np.zeros((3, MEASURED, STATES))
    h[:, 0, [C, B]] = 1.0
    h[:, 0, P] = -1.0
    h[:2, 1, C] = phi
    h[:2, 1, DL] = 1.0
    h[:2, 1, R] = -1.0
    return h


def _resonator(
    sd: float, hz: float, damping: float, dt: float
) -> tuple[Float[np.ndarray, "2 2"], Float[np.ndarray, "2 2"], Float[np.ndarray, "2 2"]]:
    """Exact discrete transition, process noise and stationary covariance of a noise-driven damped oscillator."""
    w = 2 * np.pi * hz
    rest = np.diag([sd**2, (sd * w) ** 2])
    decay, swing = damping * w, w * np.sqrt(1 - damping**2)
    cos, sin = np.cos(swing * dt), np.sin(swing * dt)
    a = np.exp(-decay * dt) * np.array(
        [[cos + decay / swing * sin, sin / swing], [-(w**2) / swing * sin, cos - decay / swing * sin]]
    )
    return a, rest - a @ rest @ a.T, rest
