"""Motions with a known truth: one axis of a record, wheels, and errors drawn as stated.

One axis of a record in which the force is measured for a while, with a flight in it.

Analytic motions of a body with known CoM, angular momentum and contact wrench: the truth of the estimation tests.

Wheels with a known clock, drawn by hypothesis or by a seed, and the steps that they walk.

Recordings of a walk whose errors are drawn from what an estimator is told of them.

Everything that a simulated recording has measured, as one vector to compare.

A walk in closed form: the CoM, rectangular feet and steps of 0.6 m every 0.5 s, for measures with known values.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from hypothesis import strategies as st

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.kalman.jerk_model import measured_inputs
from stridelab.measures import FootMotion, WalkMotion
from stridelab.recordings.recording import Side, Window, WrenchTrack
from stridelab.simulation.human_recording import SimulatedRecording
from stridelab.walking.curtate_cycloid import Branch, Wheel
from stridelab.walking.steps import GaitStep


def masked_record(rate_hz: float, n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """One axis with geometry throughout, force in one window with a flight in it, and the measured samples."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / rate_hz
    c, a = 3 + 1.2 * t + 0.03 * np.sin(10 * t), -3 * np.sin(10 * t)
    y = np.column_stack([c, a, c]) + rng.normal(size=(n, 3)) * [0.01, 0.1, 0.02]
    force = np.tile([0.0, 0.0, 700.0], (n // 2, 1))
    force[n // 8 : n // 6] = 0.0
    measured = measured_inputs(n, slice(n // 4, n // 4 + n // 2), force)
    return np.where(measured, y, np.nan), measured


WEIGHT_M_S2 = np.array([0.0, 0.0, 9.81])


@dataclass(frozen=True)
class Harmonics:
    """``x(t) = start + rate t + sum A sin(2 pi f t + phase)`` per axis, with exact derivatives."""

    start: np.ndarray
    rate: np.ndarray
    waves: tuple[tuple[float, np.ndarray, float], ...] = ()

    def at(self, t: np.ndarray, order: int = 0) -> np.ndarray:
        line = [self.start + np.outer(t, self.rate), np.tile(self.rate, (len(t), 1)), np.zeros((len(t), 3))]
        x = line[min(order, 2)].astype(float)
        for f, amplitude, phase in self.waves:
            w = 2 * np.pi * f
            x = x + np.outer(w**order * np.sin(w * t + phase + order * np.pi / 2), amplitude)
        return x


@dataclass(frozen=True)
class Motion:
    """CoM and angular momentum about it; the wrench follows from Newton and Euler, written out here once more."""

    com: Harmonics
    momentum: Harmonics = field(default_factory=lambda: Harmonics(np.zeros(3), np.zeros(3)))
    mass_kg: float = 70.0

    def force(self, t: np.ndarray) -> np.ndarray:
        return self.mass_kg * (self.com.at(t, 2) + WEIGHT_M_S2)

    def moment(self, t: np.ndarray) -> np.ndarray:
        return np.cross(self.com.at(t), self.force(t)) + self.momentum.at(t, 1)

    def wrench_track(self, t: np.ndarray, window: Window, late_s: float = 0.0, read_late_s: float = 0.0) -> WrenchTrack:
        """Wrench of plates whose clock is ``late_s`` late, read ``read_late_s`` later; NaN outside the window."""
        shifted = t - late_s + read_late_s
        complete = (t >= window.start_s) & (t <= window.end_s)
        hole = np.where(complete, 0.0, np.nan)[:, None]
        return WrenchTrack(
            time_s=t,
            force_n=self.force(shifted) + hole,
            moment_nm=self.moment(shifted) + hole,
            complete=complete,
            windows=(window,),
            latency_applied_s=read_late_s,
        )

    def geometric(
        self, t: np.ndarray, bias_m: np.ndarray | None = None, noise_m: np.ndarray | None = None
    ) -> GeometricCom:
        com = self.com.at(t) + (0 if bias_m is None else bias_m) + (0 if noise_m is None else noise_m)
        return GeometricCom(t, com, "truth", {}, {}, (0.02, 0.02, 0.02))


def uniform(velocity_m_s: tuple[float, float, float] = (1.2, -0.1, 0.05), mass_kg: float = 70.0) -> Motion:
    """A body that coasts."""
    return Motion(Harmonics(np.array([3.0, -2.0, 0.9]), np.array(velocity_m_s)), mass_kg=mass_kg)


def sinusoid(frequency_hz: float, amplitude_m: float = 1.0) -> Motion:
    """All three axes swing together around a fixed point; heavy gravity share keeps the axis defined."""
    wave = (frequency_hz, np.array([amplitude_m] * 3), 0.3)
    return Motion(Harmonics(np.array([1.0, 2.0, 1.0]), np.zeros(3), (wave,)))


def walk(speed_m_s: float = 1.2, step_hz: float = 1.8, mass_kg: float = 70.0) -> Motion:
    """Level walking along +x: steps in x and z, strides in y, with the angular momentum of an adult."""
    stride = step_hz / 2
    com = Harmonics(
        np.array([0.4, 0.1, 0.95]),
        np.array([speed_m_s, 0.0, 0.0]),
        (
            (step_hz, np.array([0.012, 0.0, 0.0]), 0.4),
            (step_hz, np.array([0.0, 0.0, 0.02]), 2.1),
            (2 * step_hz, np.array([0.001, 0.0, 0.0015]), 1.0),
            (stride, np.array([0.0, 0.025, 0.0]), 0.2),
            (3 * stride, np.array([0.0, 0.002, 0.0]), 1.2),
        ),
    )
    momentum = Harmonics(
        np.zeros(3),
        np.zeros(3),
        ((step_hz, np.array([0.0, 2.2, 0.0]), 0.9), (stride, np.array([1.5, 0.0, 0.6]), 2.5)),
    )
    return Motion(com, momentum, mass_kg)


HUMAN = Wheel(R_m=0.095, r_m=0.014, z0_m=0.93, x0_m=2.3)
PERIOD_S = 0.54


@dataclass(frozen=True)
class Walked:
    """A wheel that rolled: instants, angles and path; ``period_s`` is what a walker would take for the step period."""

    wheel: Wheel
    time_s: np.ndarray
    theta_rad: np.ndarray
    period_s: float
    omega_rad_s: float

    @property
    def path_m(self) -> np.ndarray:
        return self.wheel.position_m(self.theta_rad)


def rolled_wheel(wheel: Wheel = HUMAN, theta0_rad: float = -4.0, turns: float = 1.1, unevenness: float = 0.0) -> Walked:
    """At 100 Hz from ``theta0_rad`` on; the clock is uneven by that share of its speed."""
    omega = 2 * np.pi / PERIOD_S
    t = 7.0 + np.arange(round(100 * turns * PERIOD_S) + 1) / 100.0
    even = theta0_rad + omega * (t - t[0])
    return Walked(wheel, t, even + unevenness * np.sin(even + 0.3), PERIOD_S, omega)


@st.composite
def walks(draw: st.DrawFn, *, uneven: bool) -> Walked:
    """Any person, any place in the laboratory, any phase, either branch; a step period that is wrong by up to 15 %."""
    R = draw(st.floats(0.05, 0.2))
    branch: Branch = draw(st.sampled_from([1, -1]))
    wheel = Wheel(
        R_m=R,
        r_m=R * draw(st.floats(0.03, 0.6)),
        z0_m=draw(st.floats(0.4, 1.3)),
        x0_m=draw(st.floats(-20.0, 20.0)),
        branch=branch,
    )
    period = draw(st.floats(0.35, 0.8))
    omega = 2 * np.pi / period * draw(st.floats(0.87, 1.15))
    rate = draw(st.sampled_from([100.0, 200.0]))
    t = draw(st.floats(0.0, 100.0)) + np.arange(round(rate * period * draw(st.floats(0.98, 1.3)))) / rate
    even = draw(st.floats(-np.pi, np.pi)) + omega * (t - t[0])
    wobble = draw(st.floats(-0.25, 0.25)) * np.sin(even + draw(st.floats(0.0, 6.0))) if uneven else 0.0
    return Walked(wheel, t, even + wobble, period, omega)


def parameters(wheel: Wheel) -> np.ndarray:
    """x0, R, r, z0."""
    return np.array([wheel.x0_m, wheel.R_m, wheel.r_m, wheel.z0_m])


def central_differences(of, at: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Derivative of a vector-valued function, one column per argument."""
    columns = []
    for k in range(len(at)):
        h = np.zeros_like(at)
        h[k] = step * max(1.0, abs(at[k]))
        columns.append((of(at + h) - of(at - h)) / (2 * h[k]))
    return np.column_stack(columns)


TABLE_SD_M = (0.009, 0.009, 0.02)


def draw(
    seed: int,
    priors: ErrorPriors,
    window: Window,
    table_sd_m: tuple[float, float, float] = TABLE_SD_M,
    duration_s: float = 2.0,
) -> tuple[Motion, GeometricCom, WrenchTrack]:
    """One walk of 70 kg at 100 Hz whose errors and angular momentum are drawn from the priors, and its truth."""
    t = np.arange(round(100 * duration_s)) / 100.0
    rng = np.random.default_rng(seed)
    amplitude = np.sqrt(2) * 70 * np.array(priors.momentum_rate_nm_kg)
    lines = ((priors.step_hz / 2, np.array([1.0, 0, 0])), (priors.step_hz, np.array([0, 1.0, 0])))
    waves = tuple(
        (hz, a / (2 * np.pi * hz) * axis, rng.uniform(0, 2 * np.pi))
        for (hz, axis), a in zip(lines, amplitude, strict=True)
    )
    motion = Motion(walk().com, Harmonics(np.zeros(3), np.zeros(3), waves), 70.0)
    late_s = rng.normal(0, priors.clock_s)
    f_error = 70 * rng.normal(0, priors.acceleration_m_s2) + rng.normal(0, priors.force_n, (len(t), 3))
    nu_error = np.append(rng.normal(0, priors.moment_nm, 2), 0.0)
    f = motion.force(t - late_s) + f_error
    # the moment error is stated at the body: a force error comes with its lever arm
    nu = motion.moment(t - late_s) + np.cross(motion.com.at(t - late_s), f_error) + nu_error
    geometric = motion.geometric(t, rng.normal(0, table_sd_m), rng.normal(0, priors.marker_m, (len(t), 3)))
    complete = (window.start_s <= t) & (window.end_s >= t)
    return motion, replace(geometric, sd_m=table_sd_m), WrenchTrack(t, f, nu, complete, (window,))


def all_measured(simulated: SimulatedRecording) -> np.ndarray:
    """Markers and plate forces, one after the other."""
    recording = simulated.recording
    markers = np.column_stack(list(recording.markers_m.values())).ravel()
    return np.concatenate([markers, *(plate.force_n.ravel() for plate in recording.plates)])


RATE_HZ = 200.0
STEP_S, STEP_M, SWING_S = 0.5, 0.6, 0.4
HALF_WIDTH_M, HALF_BREADTH_M, FOOT_M = 0.08, 0.04, 0.25
HEIGHT_M, MASS_KG = 0.981, 70.0
SPEED_M_S = STEP_M / STEP_S
STEPS_IN_WALK = 20


def plain_steps(n: int = STEPS_IN_WALK) -> tuple[GaitStep, ...]:
    """Step k of the foot k % 2 (left first) strikes at (k + 1) STEP_S."""
    return tuple(
        GaitStep(
            side=side_of(k),
            lift_off_s=(k + 1) * STEP_S - SWING_S,
            strike_s=(k + 1) * STEP_S,
            next_lift_off_s=(k + 2) * STEP_S - SWING_S,
            period_s=STEP_S,
            length_m=STEP_M,
            speed_m_s=SPEED_M_S,
            measured=True,
            source="plates",
            prior_strike_s=k * STEP_S if k > 0 else None,
            stance_end_s=(k + 3) * STEP_S - SWING_S,
        )
        for k in range(n)
    )


def side_of(k: int) -> Side:
    """Foot that swings in step k."""
    return "left" if k % 2 == 0 else "right"


def plain_walk(com_m: Points | None = None, velocity_m_s: Points | None = None, **fields: object) -> WalkMotion:
    """The walk; by default the CoM moves straight ahead at constant speed, midway between the feet."""
    time_s = np.arange(round((STEPS_IN_WALK + 1) * STEP_S * RATE_HZ)) / RATE_HZ
    if com_m is None:
        com_m = np.column_stack([SPEED_M_S * time_s, np.zeros_like(time_s), np.full_like(time_s, HEIGHT_M)])
    if velocity_m_s is None:
        velocity_m_s = np.gradient(com_m, time_s, axis=0, edge_order=2)
    arguments: dict[str, object] = {
        "covariance": None,
        "varying_sd_m": 0.001,
        "feet": {side: plain_foot(side, time_s) for side in ("left", "right")},
        "momentum_per_kg": np.zeros_like(com_m),
        "mass_kg": MASS_KG,
        "stature_m": 1.8,
    }
    return WalkMotion(time_s=time_s, com_m=com_m, velocity_m_s=velocity_m_s, **(arguments | fields))  # type: ignore[arg-type]


def plain_foot(side: Side, time_s: np.ndarray) -> FootMotion:
    """Foot k stands from its strike on with the heel at ``(k + 1) STEP_M``; in its swing it moves at constant speed."""
    lane_m = HALF_WIDTH_M if side == "left" else -HALF_WIDTH_M
    own = [k for k in range(-2, STEPS_IN_WALK + 2) if side_of(k) == side]
    knots_s = [t for k in own for t in ((k + 1) * STEP_S - SWING_S, (k + 1) * STEP_S)]
    knots_m = [x for k in own for x in ((k - 1) * STEP_M, (k + 1) * STEP_M)]
    x = np.interp(time_s, knots_s, knots_m)
    heel = np.column_stack([x, np.full_like(x, lane_m), np.zeros_like(x)])
    corners = [(0.0, 1.0), (0.0, -1.0), (0.7, 1.0), (0.7, -1.0), (1.0, 0.0)]
    offsets = np.array([(FOOT_M * ahead, HALF_BREADTH_M * left, 0.0) for ahead, left in corners])
    return FootMotion(heel, heel[:, None] + offsets, np.zeros_like(heel))
