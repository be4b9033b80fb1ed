"""State space of the smoother: coloured-error states, separate for each axis.

With the moments reduced to metres (``measurements``), every axis of the walking frame has its own model. Ten states

    c, v      position and velocity of the CoM; the measured acceleration drives them
    b         slow error of the segment table (Ornstein-Uhlenbeck)
    p, q, r   low-pass memories that make the noise of geometry, force and moment high-passed
    l, l'     angular momentum over weight at the frequency of the walk, a damped resonator: bounded, so that its
              derivative has zero mean
    o, o'     its overtones, a second and broader resonator

and five unknown constants: table error b0, acceleration error ab (plates, mass), moment error mu (plates, clocks), the
factor k of the angular momentum of the segments, less its mean, and the error bz of the height, which the horizontal
force turns into a moment. The constants are not states but regression
coefficients (``kalman_rts``), so that the gains converge. Measurements in metres:

    y1 = c + b0 + b + (w - p)                                geometry, white w
    y2 = phi (c + (z/g) ab + mu) + l' + o' + k d - s bz + (n - r)    moment over weight, white n

d is the rate of the segments' angular momentum over the weight, 0 where it is not used. phi is 1 in walking, and in
running the low-passed vertical force over the weight, never the raw one. s is the low-passed horizontal force over the
weight. The vertical axis has no y2: a nearly vertical force does not determine the height.

The noises w and n also drive the memories p and r one step later. This correlation is removed by including the
measurement in the transition: A - G H and an input G y (Anderson & Moore, Optimal Filtering, 5.5). A force bias of
``ab`` metres per second squared acts at the floor, z below the CoM, and therefore also affects y2. Errors of the plates
act while they carry the body: in flight plates read zero.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from stridelab.conventions import GRAVITY_M_S2

STATES, MEASURED, CONSTANTS = 10, 2, 5
C, V, B, P, Q, R, L, DL, O, DO = range(STATES)
TABLE, ACCELERATION, MOMENT, SEGMENTS, HEIGHT = range(CONSTANTS)
MISSING_VARIANCE_M2 = 1e8
"""Variance of a missing measurement."""
MIN_SWING_SHARE = 1e-4
"""Share of the swing's variance that a body at rest may have."""
START_SD_M, START_SD_M_S = 1.0, 2.0
"""Initial standard deviations of position and velocity."""

PerModel = Float[np.ndarray, "a"]
Matrices = Float[np.ndarray, "a 10 10"]


@dataclass(frozen=True)
class Sizes:
    """Standard deviations and time scales of a batch of models, one per entry; all in metres and seconds.

    ``marker_m``, ``moment_m`` and ``acceleration_m_s2`` are the noise of y1, y2 and of the driving acceleration,
    high-passed at ``marker_corner_hz`` and ``plate_corner_hz`` (0: white). ``swing_m_s`` and ``overtone_m_s`` are L
    over weight at ``swing_hz`` and ``overtone_hz``. ``bias`` holds the five constants. ``turned`` marks the axes
    that have a y2. ``beyond_m_s2`` is the acceleration where no force is measured, ``bridged_m_s2`` its error where it
    is interpolated over a short gap, both with correlation time ``beyond_s``. ``ends`` is the share of the swing at the
    first and after the last sample: 1 in mid-walk, 0 at rest.
    """

    turned: Bool[np.ndarray, "a"]
    marker_m: PerModel
    marker_corner_hz: PerModel
    acceleration_m_s2: PerModel
    moment_m: PerModel
    plate_corner_hz: PerModel
    table_varying_m: PerModel
    table_varying_s: PerModel
    swing_m_s: PerModel
    swing_hz: PerModel
    damping: PerModel
    overtone_m_s: PerModel
    overtone_hz: PerModel
    bias: Float[np.ndarray, "a 5"]
    beyond_m_s2: PerModel
    beyond_s: PerModel
    bridged_m_s2: PerModel
    height_m: float
    ends: tuple[float, float] = (1.0, 1.0)

    def repeat_batch(self, times: int) -> "Sizes":
        """Batch of ``times`` consecutive copies."""
        return self.select_axes(np.tile(np.arange(len(self.turned)), times))

    def select_axes(self, axes: Int[np.ndarray, "_"]) -> "Sizes":
        """Sizes of some axes, in this order."""
        each = {name: value[axes] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        return replace(self, **each)


@dataclass(frozen=True)
class Regime:
    """Transition and noise of the samples of one regime."""

    transition: Matrices
    process: Matrices
    feed: Float[np.ndarray, "a 10 2"]
    noise_m2: Float[np.ndarray, "a 2"]


@dataclass(frozen=True)
class StateSpace:
    """Model matrices that do not depend on the data. ``regimes`` are those of ``regimes_of``.

    ``rest_variance`` is the variance of a zero measurement of the four swing states after the last sample, for a body
    that comes to rest; None in mid-walk.
    """

    turned: Bool[np.ndarray, "a"]
    regimes: tuple[Regime, Regime, Regime, Regime, Regime, Regime]
    start_covariance: Matrices
    constant_sd: Float[np.ndarray, "a 5"]
    lever_s2: float
    drive: Float[np.ndarray, "10"]
    rest_variance: Float[np.ndarray, "a 4"] | None


def state_space(sizes: Sizes, rate_hz: float) -> StateSpace:
    """Build the models of the module docstring for one sampling rate."""
    dt, models = 1.0 / rate_hz, len(sizes.turned)
    on = sizes.turned.astype(float)
    marker_pole = np.exp(-2 * np.pi * sizes.marker_corner_hz * dt)
    plate_pole = np.exp(-2 * np.pi * sizes.plate_corner_hz * dt)
    white_marker = sizes.marker_m * np.sqrt((1 + marker_pole) / 2)
    white_force = sizes.acceleration_m_s2 * np.sqrt((1 + plate_pole) / 2)
    white_moment = sizes.moment_m * np.sqrt((1 + plate_pole) / 2) * on
    drive = np.zeros(STATES)
    drive[[C, V]] = dt * dt / 2, dt

    a, q, start = (np.zeros((models, STATES, STATES)) for _ in range(3))
    a[:, C, C] = a[:, V, V] = 1.0
    a[:, C, V] = dt
    start[:, C, C], start[:, V, V] = START_SD_M**2, START_SD_M_S**2
    slow = np.exp(-dt / sizes.table_varying_s)
    a[:, B, B] = slow
    start[:, B, B] = sizes.table_varying_m**2
    q[:, B, B] = sizes.table_varying_m**2 * (1 - slow**2)
    noises = ((P, marker_pole, white_marker), (Q, plate_pole, white_force), (R, plate_pole, white_moment))
    for memory, pole, white in noises:
        a[:, memory, memory] = pole
        start[:, memory, memory] = (1 - pole) / (1 + pole) * white**2
    swings = (
        (slice(L, O), sizes.swing_m_s * on, sizes.swing_hz, sizes.damping),
        (slice(O, STATES), sizes.overtone_m_s * on, sizes.overtone_hz, np.full(models, OVERTONE_DAMPING)),
    )
    for part, sd, hz, damping in swings:
        a[:, part, part], q[:, part, part], start[:, part, part] = resonator_model(sd, hz, damping, dt)

    first, last = sizes.ends
    rest = None
    if last < 1.0:
        rest = np.maximum(last**2, MIN_SWING_SHARE) / (1 - last**2) * start[:, range(L, STATES), range(L, STATES)]
        rest[~sizes.turned] = MISSING_VARIANCE_M2
    start[:, L:, L:] *= max(first**2, MIN_SWING_SHARE)

    # The measured acceleration exceeds the true one by (u - q); without a force, u still feeds the memory.
    driven = a.copy()
    driven[:, [C, V], Q] = drive[[C, V]]
    error = np.tile(-drive, (models, 1))
    error[:, Q] = 1 - plate_pole
    with_force = q + (white_force**2)[:, None, None] * error[:, :, None] * error[:, None, :]
    beyond = sizes.beyond_m_s2**2 * sizes.beyond_s / dt
    without = q + beyond[:, None, None] * np.outer(drive, drive)
    without[:, Q, Q] += ((1 - plate_pole) * white_force) ** 2
    no_moment = np.zeros_like(q)
    no_moment[:, R, R] = ((1 - plate_pole) * white_moment) ** 2
    unseen = without + no_moment
    bridged = (sizes.bridged_m_s2**2 - sizes.beyond_m_s2**2) * sizes.beyond_s / dt
    bridge = bridged[:, None, None] * np.outer(drive, drive)

    feed = np.zeros((models, STATES, MEASURED))
    feed[:, P, 0] = 1 - marker_pole
    fed_moment = feed.copy()
    fed_moment[:, R, 1] = (1 - plate_pole) * on
    noise = np.column_stack([white_marker**2, np.full(models, MISSING_VARIANCE_M2)])
    noise_seen = noise.copy()
    noise_seen[sizes.turned, 1] = white_moment[sizes.turned] ** 2
    return StateSpace(
        turned=sizes.turned,
        regimes=(
            Regime(driven, with_force, fed_moment, noise_seen),
            Regime(a, without, fed_moment, noise_seen),
            Regime(a, unseen, feed, noise),
            Regime(a, without + bridge, fed_moment, noise_seen),
            Regime(a, unseen + bridge, feed, noise),
            Regime(driven, with_force + no_moment, feed, noise),
        ),
        start_covariance=start,
        constant_sd=sizes.bias,
        lever_s2=sizes.height_m / GRAVITY_M_S2,
        drive=drive,
        rest_variance=rest,
    )


OVERTONE_DAMPING = 0.5


def observation_matrix(phi: float, turned: Bool[np.ndarray, "a"]) -> Float[np.ndarray, "a 2 10"]:
    """Measurement matrix: rows of y1 and y2."""
    h = np.zeros((len(turned), MEASURED, STATES))
    h[:, 0, [C, B]] = 1.0
    h[:, 0, P] = -1.0
    h[turned, 1, C] = phi
    for state, sign in ((DL, 1.0), (DO, 1.0), (R, -1.0)):
        h[turned, 1, state] = sign
    return h


def resonator_model(
    sd: PerModel, hz: PerModel, damping: PerModel, dt: float
) -> tuple[Float[np.ndarray, "a 2 2"], Float[np.ndarray, "a 2 2"], Float[np.ndarray, "a 2 2"]]:
    """Exact discrete transition, process noise and stationary covariance of a noise-driven damped oscillator."""
    w = 2 * np.pi * hz
    rest = np.zeros((len(sd), 2, 2))
    rest[:, 0, 0], rest[:, 1, 1] = sd**2, (sd * w) ** 2
    decay, swing = damping * w, w * np.sqrt(1 - damping**2)
    cos, sin = np.cos(swing * dt), np.sin(swing * dt)
    a = np.exp(-decay * dt) * np.array(
        [[cos + decay / swing * sin, sin / swing], [-(w**2) / swing * sin, cos - decay / swing * sin]]
    )
    a = np.moveaxis(a, 2, 0)
    return a, rest - a @ rest @ np.swapaxes(a, 1, 2), rest
