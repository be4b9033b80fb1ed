"""Sizes of all errors per axis of the walking frame, from the user's priors and from the recording itself.

The learned sizes maximise the posterior probability of the recording's data. The likelihood of the Kalman filter
separates into the axes, and its gradient costs one pass: perturbed parameters of all axes are further models in the
same batch. The unknowns are the logarithms of the sizes, each with a normal prior of width ``WIDTH`` (a factor of
e^WIDTH is one standard deviation), because a second of data does not determine every size. The constant errors (table,
plates, clocks) are not learned: one recording shows only their sum.

Priors of the smoother: sizes of the input errors, as standard deviations.
"""

from dataclasses import asdict, dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import optimize

from stridelab.conventions import GRAVITY_M_S2, Points, Rotation
from stridelab.errors import Fault, InvalidInput
from stridelab.estimation.smoother.kalman_rts import Signals, compute_gains, filter_forward, log_likelihood
from stridelab.estimation.smoother.measurements import CONSISTENCY_WALKS_M_S, Walk, step_frequency_hz, swing_at_ends
from stridelab.estimation.smoother.state_space import (
    ACCELERATION,
    CONSTANTS,
    HEIGHT,
    MOMENT,
    SEGMENTS,
    TABLE,
    Sizes,
    state_space,
)

MAY_BE_ZERO = frozenset(
    {
        "marker_corner_hz",
        "plate_corner_hz",
        "plate_force_n",
        "plate_moment_nm",
        "walking_moment_nm",
        "clock_s",
        "mass_share",
    }
)


@dataclass(frozen=True, kw_only=True)
class SmootherPriors:
    """Standard deviations unless noted otherwise; the table's constant error is in ``GeometricCom.sd_m``.

    Noise of the sensors: ``marker_m`` of the geometric CoM, ``force_n`` and ``moment_nm`` per axis. A ``corner_hz`` of
    0 is white noise; above 0 the noise is high-passed there (first order), which assumes small slow errors.

    Constant errors of the plates, declared by the user: ``plate_force_n`` of the total force, acting at the floor, and
    ``plate_moment_nm`` about the plate. ``walking_moment_nm`` is the further error of the moments along and lateral
    under feet that roll over plates; it is added in walking only. ``mass_share`` is the relative error of the mass,
    ``clock_s`` the residual latency between force and markers.

    ``table_varying_m`` is the posture-dependent part of the table's horizontal error in walking, with correlation time
    ``table_varying_s``; it is twice as large in runs, vertically ``CALM_SHARE`` of it, and that share squared where the
    body stands. It is not learned: a second of data makes it too small.
    ``momentum_m_s`` is the angular momentum about the walking axis and the lateral axis divided by the weight,
    L / (m g); None uses that of an adult of this height. It is modelled as a resonator of damping ratio ``damping`` at
    half the step frequency and at ``step_hz`` (None: estimated from the vertical motion), with overtones whose L is
    ``overtone_share`` of it. ``acceleration_beyond_m_s2`` with correlation time ``acceleration_beyond_s`` is the
    acceleration of the body where no force is measured.
    """

    marker_m: float = 0.001
    marker_corner_hz: float = 0.0
    force_n: float = 5.0
    moment_nm: float = 3.0
    plate_corner_hz: float = 0.0
    plate_force_n: float = 1.0
    plate_moment_nm: float = 1.0
    walking_moment_nm: tuple[float, float] = (2.8, 1.1)
    mass_share: float = 0.01
    clock_s: float = 0.005
    table_varying_m: float = 0.003
    table_varying_s: float = 0.3
    momentum_m_s: tuple[float, float] | None = None
    overtone_share: float = 0.25
    damping: float = 0.08
    step_hz: float | None = None
    acceleration_beyond_m_s2: float = 2.5
    acceleration_beyond_s: float = 0.15

    def __post_init__(self) -> None:
        """Raise ``InvalidInput`` (``prior-out-of-range``) for an invalid standard deviation."""
        faults = []
        for name, value in asdict(self).items():
            numbers = np.atleast_1d(np.asarray([] if value is None else value, dtype=float))
            least = 0.0 if name in MAY_BE_ZERO else np.nextafter(0.0, 1.0)
            if not (np.isfinite(numbers).all() and (numbers >= least).all()):
                faults.append(Fault(f"priors.{name}", f"{value} is not a valid standard deviation"))
        if not self.damping < 1.0:
            faults.append(Fault("priors.damping", "a damping ratio of 1 or more does not oscillate"))
        if faults:
            raise InvalidInput(
                "prior-out-of-range",
                "The stated error of an input must be a positive number: " + ", ".join(f.where for f in faults) + ".",
                faults,
            )


LEARNED: Final = ("marker_m", "moment_m", "swing_m_s", "overtone_m_s", "damping")
WIDTH: Final = 1.0
DOWN, UP = 1.1, 3.0
"""Learned sizes lie between a third of the prior (e^-DOWN) and e^UP times it: filtered markers appear noise-free, but
have slow errors instead."""
ITERATIONS: Final = 8
STEP: Final = 1e-3
MAX_LEARNING_SAMPLES: Final = 600
LARGEST_DAMPING: Final = 0.9
SETTLING: Final = 1e-4
"""Relative change at which gains count as converged here: the sizes change by less than 1e-3, in half the time."""

HORIZONTAL: Final = np.array([0, 1])

Logs = Float[np.ndarray, "p axes"]


def learn_sizes(sizes: Sizes, signals: Signals, rate_hz: float) -> Sizes:
    """The sizes with those of ``LEARNED`` replaced, per axis, by the most probable ones.

    Only the horizontal sizes are learned. The vertical axis has a single measurement: its sizes scale with the mean
    change of the others, the noise of the geometry also with the ratio of roughness. At most ``MAX_LEARNING_SAMPLES``
    samples around the middle of the samples with force are used.

    Where the segments' angular momentum is used, its rest does not become smaller than its prior within one period of
    the walk: an error of the table would take its place. Each further period allows another factor of e^-DOWN.
    """
    roughness = np.sqrt(np.mean(np.diff(signals.geometry_m, 3, axis=0) ** 2, axis=0))
    signals = _middle_stretch(signals).select_axes(HORIZONTAL)
    middle = replace(sizes, ends=(1.0, 1.0)).select_axes(HORIZONTAL)
    start = np.log([getattr(middle, name) for name in LEARNED])

    def negative_log_posterior(x: Float[np.ndarray, "_"]) -> tuple[float, Float[np.ndarray, "_"]]:
        logs = x.reshape(start.shape)
        values = -log_likelihoods(middle, np.array([logs, *_perturbed_logs(logs)]), signals, rate_hz)
        deviation = (logs - start) / WIDTH
        slope = (values[1:] - values[0]) / STEP + deviation / WIDTH
        return float(values[0].sum() + 0.5 * np.sum(deviation**2)), slope.ravel()

    highest = start + UP
    highest[LEARNED.index("damping")] = np.log(LARGEST_DAMPING)
    lowest = start - DOWN
    beyond_one = np.clip(signals.seen.sum() / rate_hz * middle.swing_hz - 1.0, 0.0, None)
    rests = middle.bias[:, SEGMENTS] > 0.0
    for k in (LEARNED.index("swing_m_s"), LEARNED.index("overtone_m_s")):
        lowest[k, rests] = start[k, rests] - np.minimum(DOWN * beyond_one, UP)[rests]
    bounds = list(zip(lowest.ravel(), highest.ravel(), strict=True))
    optimum = optimize.minimize(
        negative_log_posterior,
        start.ravel(),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": ITERATIONS},
    )
    change = optimum.x.reshape(start.shape) - start
    factors = np.exp(np.column_stack([change, change.mean(axis=1)]))
    rough = roughness[2] / np.mean(roughness[:2]) if roughness.min() > 0.0 else 1.0
    factors[LEARNED.index("marker_m"), 2] *= np.clip(rough, np.exp(-DOWN), np.exp(UP))
    return replace(sizes, **{name: getattr(sizes, name) * x for name, x in zip(LEARNED, factors, strict=True)})


def is_explained(prior: Sizes, learned: Sizes, signals: Signals, blind: Signals, rate_hz: float, *, runs: bool) -> bool:
    """Whether ``signals``, with the segments' angular momentum, are more probable than ``blind``, without it.

    In a run they may be less probable by ``RUN_ALLOWANCE``. ``learned`` are the sizes learned from ``signals``; without
    the segments the momentum may be larger and periodic.
    """
    middle = replace(prior, ends=(1.0, 1.0)).select_axes(HORIZONTAL)
    usual, best = (np.log([getattr(one, name)[HORIZONTAL] for name in LEARNED]) for one in (prior, learned))
    momentum = np.array([name in ("swing_m_s", "overtone_m_s") for name in LEARNED])[:, None]
    candidates = best + np.log([1.0, 2.5, 6.0])[:, None, None] * momentum
    periodic = candidates.copy()
    periodic[:, LEARNED.index("damping")] = np.log(SmootherPriors.damping)
    candidates = np.concatenate([candidates, periodic])
    penalties = 0.5 * np.sum(((candidates - usual) / WIDTH) ** 2, axis=1)
    explained, without = (
        log_likelihoods(middle, some, _middle_stretch(data).select_axes(HORIZONTAL), rate_hz) - penalties[: len(some)]
        for some, data in ((candidates[:1], signals), (candidates, blind))
    )
    return bool(explained.sum() + RUN_ALLOWANCE * runs > without.max(axis=0).sum())


def log_likelihoods(
    sizes: Sizes, candidates: Float[np.ndarray, "k p axes"], signals: Signals, rate_hz: float
) -> Float[np.ndarray, "k axes"]:
    """Log-likelihood per axis of every candidate (logarithms of the sizes)."""
    space = state_space(with_logs(sizes, candidates), rate_hz)
    gain_sets = compute_gains(space, signals, SETTLING)
    return log_likelihood(space, gain_sets, filter_forward(space, signals, gain_sets)).reshape(len(candidates), -1)


def with_logs(sizes: Sizes, candidates: Float[np.ndarray, "k p axes"]) -> Sizes:
    """Batch of models with all axes for each candidate."""
    k = len(candidates)
    batch = sizes.repeat_batch(k)
    given = {name: np.exp(candidates[:, i]).ravel() for i, name in enumerate(LEARNED)}
    given = {name: np.where(getattr(batch, name) > 0, value, 0.0) for name, value in given.items()}
    return replace(batch, **given)


def _middle_stretch(signals: Signals) -> Signals:
    at = int(np.median(np.flatnonzero(signals.seen)))
    first = max(0, min(at - MAX_LEARNING_SAMPLES // 2, len(signals) - MAX_LEARNING_SAMPLES))
    return signals.slice_samples(first, first + MAX_LEARNING_SAMPLES)


def _perturbed_logs(logs: Logs) -> Float[np.ndarray, "p p axes"]:
    """Finite-difference perturbations: each parameter increased by ``STEP`` in all axes at once."""
    return np.asarray(logs + STEP * np.eye(len(logs))[:, :, None])


USUAL_STEP_HZ, USUAL_SPEED_M_S = 1.8, 1.2
CALM_SHARE: Final = 1 / 3
"""Share of the table's varying error where the posture hardly changes it: vertically, and its square in standing."""
STANDS_SHARE: Final = 0.1
"""Range of the vertical force over the weight below which a body stands; a slow walk has 0.2."""
RUNS_SHARE, RUN_FACTOR = 1.8, 2.0
"""The same above which it runs or jumps, and the table's varying error there over that of walking.

With that of walking the innovations of four runs (3 to 5 m/s, three people) are 1.4 to 3.1, with twice it 0.6 to 1.2.
"""
RUN_ALLOWANCE: Final = 25.0
"""Log density by which the segments may be worse in a run: drawn runs have -18 to 1, runs of people 5 to 215, robots
whose segments are noise -42 and less; without the segments, a hidden plate becomes an error of the table."""
RUN_VERTICAL_FACTOR: Final = 3.0
"""Noise of the vertical force there over that of walking: errors of mass and clock move a force that changes more."""
BRIDGED_M_S2, RUN_BRIDGED_M_S2 = 0.7, 0.2
"""Error of an acceleration that is interpolated over a short gap of the force: in walking, which has heel strikes, and
in flight, where both ends have almost that of gravity."""
UNDIRECTED_HZ_SHARE, UNDIRECTED_DAMPING = 0.75, 0.6
SAGITTAL_OVERTONE, LATERAL_OVERTONE = 2.0, 4.5
"""Ratios of the overtones to the step and the stride frequency: the second, and the third to seventh combined."""


def adult_momentum_m_s(mass_kg: float, height_m: float) -> tuple[float, float]:
    """RMS of L / (m g) about the walking and the lateral axis: 1.0 and 1.5 Nms at 70 kg and 1.70 m, scaled.

    The CoM lies at 0.55 of the stature.
    """
    scale = (height_m / 0.55) ** 2 / (70.0 * 1.7**2 * GRAVITY_M_S2)
    return 1.0 * scale, 1.5 * scale


WALK_SEGMENTS: Final = np.array([[1.4, 1.15, 0.0], [0.15, 0.25, 0.0]])
RUN_SEGMENTS: Final = np.array([[0.75, 1.1, 0.0], [0.15, 0.15, 0.0]])
"""L' of a body over that of its segments as point masses, which do not turn, about the lateral and the walking axis:
mean and standard deviation of 21 walks of nine people, and of 12 runs of three others (2 to 5 m/s)."""
SEGMENT_REST: Final = np.array([0.6, 1.2, 1.0])
"""Size of what the segments do not explain over the size of the angular momentum. It is not only angular momentum: it
also stands for errors of the moments that change within a step, so its resonator is broad and its overtones large."""
REST_DAMPING, REST_OVERTONE_SHARE, REST_OVERTONE = 0.5, 1.0, 2.5


def with_segments(sizes: Sizes, signals: Signals, segments_m: Points, *, runs: bool) -> tuple[Sizes, Signals]:
    """Model in which the segments explain the angular momentum, up to a factor and a rest.

    ``segments_m`` is the rate of the segments' angular momentum, as ``Signals.segments_m``. It is that of a run if the
    body ``runs``.
    """
    factor, factor_sd = RUN_SEGMENTS if runs else WALK_SEGMENTS
    bias = sizes.bias.copy()
    bias[:, SEGMENTS] = factor_sd
    swing = SEGMENT_REST * sizes.swing_m_s
    rest = replace(
        sizes,
        swing_m_s=swing,
        damping=np.full(3, REST_DAMPING),
        overtone_m_s=REST_OVERTONE_SHARE * swing,
        overtone_hz=np.array([1.0, REST_OVERTONE / LATERAL_OVERTONE, 1.0]) * sizes.overtone_hz,
        bias=bias,
    )
    moment = signals.moment_m - factor * segments_m * signals.seen[:, None]
    return rest, replace(signals, moment_m=moment, segments_m=segments_m)


def with_walking_noise(sizes: Sizes) -> Sizes:
    """Sizes of a run with the noise of the vertical force in walking."""
    return replace(sizes, acceleration_m_s2=sizes.acceleration_m_s2 / np.array([1.0, 1.0, RUN_VERTICAL_FACTOR]))


def moves_ahead(walk: Walk) -> bool:
    """Whether the body moves over the ground."""
    return walk.speed_m_s > CONSISTENCY_WALKS_M_S


def is_airborne(walk: Walk, mass_kg: float) -> bool:
    """Whether the vertical force ranges as in a run or a jump."""
    return bool(np.ptp(walk.force_n[walk.seen, 2]) > RUNS_SHARE * mass_kg * GRAVITY_M_S2)


def is_walk(walk: Walk, mass_kg: float) -> bool:
    """Whether the body moves over the ground, and does not run."""
    return moves_ahead(walk) and not is_airborne(walk, mass_kg)


def sizes_of(priors: SmootherPriors, walk: Walk, mass_kg: float, table_sd_m: tuple[float, float, float]) -> Sizes:
    """Prior sizes for the axes x, y, z of the walking frame.

    The moment about the lateral axis affects x, that about the walking axis y. A clock error of ``clock_s`` displaces
    the force by the motion in the laboratory, which a treadmill does not have.
    """
    height = float(np.mean(walk.geometry_m[:, 2]))
    step_hz = priors.step_hz or step_frequency_hz(walk) or USUAL_STEP_HZ
    in_laboratory_m_s = float(np.linalg.norm(walk.velocity_m_s[:2]))
    sizes = _prior_sizes(priors, mass_kg, table_sd_m, walk.frame, height, step_hz, in_laboratory_m_s)
    vertical_n = walk.force_n[walk.seen, 2]
    if np.ptp(vertical_n) < STANDS_SHARE * mass_kg * GRAVITY_M_S2:
        sizes = replace(sizes, table_varying_m=np.full(3, CALM_SHARE**2 * priors.table_varying_m))
    if is_walk(walk, mass_kg):
        bias = sizes.bias.copy()
        walking_m = np.array(priors.walking_moment_nm) / (mass_kg * GRAVITY_M_S2)
        bias[:2, MOMENT] = np.hypot(bias[:2, MOMENT], walking_m)
        sizes = replace(sizes, bias=bias)
    if is_airborne(walk, mass_kg):
        sizes = replace(
            sizes,
            table_varying_m=RUN_FACTOR * sizes.table_varying_m,
            acceleration_m_s2=np.array([1.0, 1.0, RUN_VERTICAL_FACTOR]) * sizes.acceleration_m_s2,
            beyond_m_s2=np.maximum(sizes.beyond_m_s2, GRAVITY_M_S2),
            bridged_m_s2=np.full(3, RUN_BRIDGED_M_S2),
        )
    return replace(sizes, ends=swing_at_ends(walk))


def online_sizes(
    priors: SmootherPriors,
    mass_kg: float,
    table_sd_m: tuple[float, float, float],
    frame: Rotation,
    height_m: float,
    *,
    directed: bool,
) -> Sizes:
    """Prior sizes for a stream, with typical values of the unknown speed and step frequency.

    Without a direction, both horizontal axes use the larger momentum and a resonator that covers stride and step
    frequency.
    """
    step_hz = priors.step_hz or USUAL_STEP_HZ
    sizes = _prior_sizes(priors, mass_kg, table_sd_m, frame, height_m, step_hz, USUAL_SPEED_M_S)
    if directed:
        return sizes
    largest = np.array([1.0, 1.0, 0.0])
    return replace(
        sizes,
        swing_m_s=sizes.swing_m_s.max() * largest,
        swing_hz=np.full(3, UNDIRECTED_HZ_SHARE * step_hz),
        damping=np.full(3, UNDIRECTED_DAMPING),
        overtone_m_s=sizes.overtone_m_s.max() * largest,
        bias=np.maximum(sizes.bias, sizes.bias[[1, 0, 2]]),
    )


def _prior_sizes(
    priors: SmootherPriors,
    mass_kg: float,
    table_sd_m: tuple[float, float, float],
    frame: Rotation,
    height: float,
    step_hz: float,
    speed_m_s: float,
) -> Sizes:
    weight = mass_kg * GRAVITY_M_S2
    table = np.sqrt((frame**2) @ np.square(table_sd_m))
    moment = np.hypot(priors.moment_nm, height * priors.force_n) / weight
    about_walk, about_side = priors.momentum_m_s or adult_momentum_m_s(mass_kg, height)
    swing = np.array([about_side, about_walk, 0.0])
    bias = np.zeros((3, CONSTANTS))
    bias[:, TABLE] = table
    bias[:, ACCELERATION] = np.hypot(priors.plate_force_n / mass_kg, [0.0, 0.0, priors.mass_share * GRAVITY_M_S2])
    bias[:2, HEIGHT] = table[2]
    bias[:2, MOMENT] = np.hypot(priors.plate_moment_nm / weight, [priors.clock_s * speed_m_s, 0.0])
    every = np.ones(3)
    return Sizes(
        turned=np.array([True, True, False]),
        marker_m=priors.marker_m * every,
        marker_corner_hz=priors.marker_corner_hz * every,
        acceleration_m_s2=priors.force_n / mass_kg * every,
        moment_m=moment * every,
        plate_corner_hz=priors.plate_corner_hz * every,
        table_varying_m=priors.table_varying_m * np.array([1.0, 1.0, CALM_SHARE]),
        table_varying_s=priors.table_varying_s * every,
        swing_m_s=swing,
        swing_hz=step_hz * np.array([1.0, 0.5, 1.0]),
        damping=priors.damping * every,
        overtone_m_s=priors.overtone_share * swing,
        overtone_hz=step_hz * np.array([SAGITTAL_OVERTONE, 0.5 * LATERAL_OVERTONE, 1.0]),
        bias=bias,
        beyond_m_s2=priors.acceleration_beyond_m_s2 * every,
        beyond_s=priors.acceleration_beyond_s * every,
        bridged_m_s2=BRIDGED_M_S2 * every,
        height_m=height,
    )
