"""Simulated running of TALOS: steps with a flight phase, in which only gravity acts on the robot.

Height. In stance, u from 0 to 1, z'' + g = A sin^2(pi u) + B sin^2(pi u) sin(2 pi u); in flight z'' = -g. A and B
follow from a constant touchdown height and from the vertical speeds required by the flights before and after.

Ground plane. The force points from the sole's middle p to the CoM, c'' = (z'' + g) / z (c - p); in flight c'' = 0. That
is linear, c_j+1 - p = Phi_j (c_j - p) between samples, and unstable: its bounded solution over the given footprints is
a boundary-value problem (the linear pendulum with an infinite preview; Kajita's cart has no flight).

Rotation. In flight the angular momentum about the CoM is constant, which determines the rotation of the base. In stance
the ground restores it, L' = (z'' + g) / g (-K theta - D L): as the moment vanishes with the force, the centre of
pressure moves by no more than |K theta + D L| / (m g), a few millimetres.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy.random import Generator
from scipy.sparse import csr_matrix, lil_matrix
from scipy.sparse.linalg import spsolve

from stridelab.conventions import GRAVITY_M_S2, Series, Vector3
from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.recording import Side
from stridelab.robots.loader import load_robot
from stridelab.simulation.ground_truth import motion_truth
from stridelab.simulation.human.body_proportions import SIDES, side_sign
from stridelab.simulation.human.gait_plan import GaitPlan, Stance, centred_draws
from stridelab.simulation.human.load_transfer import LoadPlan, Plane
from stridelab.simulation.robot.gait_plan import LEAD_S, ArmSwing, sole_middles
from stridelab.simulation.robot.trajectory_ik import PointPath, Task, WholeBody
from stridelab.simulation.robot.walker import RATE_HZ, RobotWalk, first_posture, sole_path, swing_arms

_K_NM_RAD: Final = np.array([110.0, 110.0, 20.0])
_D_PER_S: Final = 4.0
_ARMS: Final = ArmSwing(0.10, 0.15, 0.0)
"""Smaller than in walking: in flight, a full arm swing would rotate the base as much as the legs do."""
_SUBSTEPS: Final = 10
_MARGIN_STEPS: Final = 4
"""Additional steps at both ends for the CoM solution, which ends over a footprint."""
_VARIATION: Final = 0.02
Heights = tuple[Series, Series, Series]
"""``z``, ``z'`` and ``z''`` over time."""


@dataclass(frozen=True, kw_only=True)
class RunningGait:
    """Steps of ``step_time_s``, with ``stance_s`` on one foot and the rest in flight; no start and no stop."""

    step_length_m: float = 0.40
    step_time_s: float = 0.38
    stance_s: float = 0.27
    duration_s: float = 5.0
    width_m: float = 0.12
    com_height_m: float = 0.84
    arms: ArmSwing = _ARMS


RUNNING: Final = RunningGait()
SPEED_RANGE_M_S: Final = (0.3, 1.1)


def running_at(speed_m_s: float, duration_s: float) -> RunningGait:
    """A run at a speed. Raises ``InvalidInput`` (``walker-out-of-range``) outside ``SPEED_RANGE_M_S``."""
    low, high = SPEED_RANGE_M_S
    if not low <= speed_m_s <= high:
        message = f"TALOS runs at {low:g} to {high:g} m/s, not at {speed_m_s:g} m/s."
        raise InvalidInput("walker-out-of-range", message, [Fault("speed_m_s", message)])
    return RunningGait(step_length_m=speed_m_s * RUNNING.step_time_s, duration_s=duration_s)


@lru_cache(maxsize=4)
def simulate_run(gait: RunningGait, seed: int = 0, robot_name: str = "talos") -> RobotWalk:
    """Simulate a run. The result is deterministic, cached and shared: do not modify it.

    Raises ``NotEstimable`` (``robot-out-of-reach``) if the legs do not reach the footprints.
    """
    rngs = [np.random.default_rng([seed, part]) for part in range(2)]
    robot, plan = load_robot(robot_name), _plan_stances(gait, rngs[0])
    n = round((gait.duration_s + 2 * LEAD_S) * RATE_HZ)
    time_s = np.arange(n) / RATE_HZ - LEAD_S
    dense_s = np.arange(2 * n) / (2 * RATE_HZ) - LEAD_S
    height = _com_height(gait, plan, dense_s)
    feet = {side: sole_path(plan, side, dense_s) for side in SIDES}
    com = _over_footprints(gait, plan, dense_s, height)
    lift = (height[2] + GRAVITY_M_S2) / GRAVITY_M_S2

    def momentum_rate(k: int, theta: Vector3, L: Vector3) -> Vector3:
        return np.asarray(-lift[k] * (_K_NM_RAD * theta + _D_PER_S * L))

    body = WholeBody(robot)
    upper = swing_arms(robot, body.upper, gait.arms, plan, dense_s, rngs[1])
    start = first_posture(robot, feet, com.position_m[0])
    motion = body.solve_with_momentum(time_s, Task.from_paths(feet, com, upper), start, momentum_rate)
    truth = motion_truth(body.model, time_s, motion.q, motion.v, motion.a)
    return RobotWalk(robot, plan, motion, truth, _running_load(plan, time_s))


def _plan_stances(gait: RunningGait, rng: Generator) -> GaitPlan:
    """Stances from before the start of the simulation until after its end."""
    n = int((gait.duration_s + 2 * LEAD_S) / gait.step_time_s) + 2 * _MARGIN_STEPS + 4
    begins = (
        -LEAD_S
        - (_MARGIN_STEPS + 2) * gait.step_time_s
        + np.cumsum(gait.step_time_s * (1.0 + _VARIATION * centred_draws(rng, n)))
    )
    x_m = np.cumsum(gait.step_length_m * (1.0 + _VARIATION * centred_draws(rng, n)))
    first = int(rng.integers(2))
    stances = []
    for k in range(n):
        side, strike_s = SIDES[(first + k) % 2], float(begins[k])
        off_s = strike_s + gait.stance_s
        stances.append(
            Stance(side, float(x_m[k]), side_sign(side) * gait.width_m / 2, strike_s, strike_s, off_s, off_s)
        )
    speed_m_s, steady_s = gait.step_length_m / gait.step_time_s, (0.0, gait.duration_s)
    return GaitPlan(
        tuple(stances),
        gait.step_length_m,
        gait.step_time_s,
        speed_m_s,
        0.0,
        gait.duration_s,
        gait.duration_s,
        steady_s,
        0.0,
    )


def _com_height(gait: RunningGait, plan: GaitPlan, t: Series) -> Heights:
    """Height of the CoM; every stance begins and ends ``com_height_m`` above the ground."""
    G, T = GRAVITY_M_S2, gait.stance_s
    z, rate, second = np.full(len(t), gait.com_height_m), np.zeros(len(t)), np.full(len(t), -G)
    for before, after in pairwise(plan.stances):
        in_air = (t >= before.off_s) & (t < after.strike_s)
        since, flight_s = t[in_air] - before.off_s, after.strike_s - before.off_s
        z[in_air] += 0.5 * G * since * (flight_s - since)
        rate[in_air] = 0.5 * G * (flight_s - 2.0 * since)
    flights = [b.strike_s - a.off_s for a, b in pairwise(plan.stances)]
    for stance, before_s, after_s in zip(plan.stances[1:], flights, flights[1:], strict=False):
        on = (t >= stance.strike_s) & (t < stance.off_s)
        u, v_in, v_out = (t[on] - stance.strike_s) / T, -0.5 * G * before_s, 0.5 * G * after_s
        A = 2.0 * (v_out - v_in + G * T) / T
        B = (-v_in / T + 0.5 * G - 0.25 * A) * 16.0 * np.pi / 3.0
        s2, c2, s4, c4 = (f(2.0 * k * np.pi * u) for k in (1, 2) for f in (np.sin, np.cos))
        second[on] = -G + A * (1.0 - c2) / 2.0 + B * (s2 / 2.0 - s4 / 4.0)
        rate[on] = (
            v_in
            - G * T * u
            + T * A * (u / 2.0 - s2 / (4.0 * np.pi))
            + T * B * ((1.0 - c2) / (4.0 * np.pi) - (1.0 - c4) / (16.0 * np.pi))
        )
        z[on] += (
            v_in * T * u
            - 0.5 * G * (T * u) ** 2
            + T**2 * A * (u**2 / 4.0 + (c2 - 1.0) / (8.0 * np.pi**2))
            + T**2 * B * (3.0 * u / (16.0 * np.pi) - s2 / (8.0 * np.pi**2) + s4 / (64.0 * np.pi**2))
        )
    return z, rate, second


def _over_footprints(gait: RunningGait, plan: GaitPlan, t: Series, height: Heights) -> PointPath:
    """Bounded motion of the CoM over the footprints, exact at the samples."""
    h, n_samples = float(t[1] - t[0]), len(t)
    margin = round(_MARGIN_STEPS * gait.step_time_s / h)
    longer = t[0] + h * np.arange(-margin, n_samples + margin)
    n, p = len(longer), _loaded_footprint(plan, longer)
    Phi = _state_transitions(gait, plan, longer, h)
    system, right = lil_matrix((2 * n, 2 * n)), np.zeros((2 * n, 2))
    for j in range(n - 1):
        rows = slice(2 * j, 2 * j + 2)
        system[rows, 2 * j : 2 * j + 2] = -Phi[j]
        system[rows, 2 * j + 2 : 2 * j + 4] = np.eye(2)
        # the footprint changes in flight, where Phi is independent of p
        right[rows] = (np.eye(2) - Phi[j])[:, :1] * p[j]
    system[2 * n - 2, 0] = system[2 * n - 1, 2 * n - 2] = 1.0
    right[2 * n - 2], right[2 * n - 1] = p[0], p[-1]
    states = np.asarray(spsolve(csr_matrix(system), right)).reshape(n, 2, 2)[margin : margin + n_samples]
    c, v, p = states[:, 0], states[:, 1], p[margin : margin + n_samples]
    z, z_rate, z_second = height
    a = ((z_second + GRAVITY_M_S2) / z)[:, None] * (c - p)
    return PointPath(np.column_stack([c, z]), np.column_stack([v, z_rate]), np.column_stack([a, z_second]))


def _state_transitions(gait: RunningGait, plan: GaitPlan, t: Series, h: float) -> Float[np.ndarray, "n 2 2"]:
    """``Phi_j`` of (c, c') from ``t_j`` to ``t_j + h``, by ten classical Runge-Kutta steps each."""

    def state_derivative(at_s: Series, Phi: np.ndarray) -> np.ndarray:
        z, _, second = _com_height(gait, plan, at_s)
        return np.stack([Phi[:, 1], ((second + GRAVITY_M_S2) / z)[:, None] * Phi[:, 0]], axis=1)

    Phi, s = np.tile(np.eye(2), (len(t), 1, 1)), h / _SUBSTEPS
    for i in range(_SUBSTEPS):
        at_s = t + i * s
        k1 = state_derivative(at_s, Phi)
        k2 = state_derivative(at_s + s / 2, Phi + s / 2 * k1)
        k3 = state_derivative(at_s + s / 2, Phi + s / 2 * k2)
        k4 = state_derivative(at_s + s, Phi + s * k3)
        Phi = Phi + s / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return Phi


def _loaded_footprint(plan: GaitPlan, t: Series) -> Plane:
    """Middle of the loaded sole, changing in the middle of every flight."""
    places = np.array([(s.x_m, s.y_m) for s in plan.stances])
    return np.asarray(places[np.searchsorted(_middles_of_flight(plan), t)])


def _middles_of_flight(plan: GaitPlan) -> list[float]:
    return [(a.off_s + b.strike_s) / 2 for a, b in pairwise(plan.stances)]


def _running_load(plan: GaitPlan, t: Series) -> LoadPlan:
    sides = np.array([s.side == "left" for s in plan.stances])
    left = sides[np.searchsorted(_middles_of_flight(plan), t)].astype(float)
    share: Mapping[Side, Series] = {"left": left, "right": 1.0 - left}
    cop = {side: sole_middles(plan, side, t) for side in SIDES}
    return LoadPlan(share, cop, _loaded_footprint(plan, t))
