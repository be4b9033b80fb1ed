"""Task rows against motion: accelerations that satisfy them make the error obey its differential equation."""

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from stridelab.centroidal.plan import Reference
from stridelab.robots.robot import Robot
from stridelab.wholebody.control import tasks
from stridelab.wholebody.control.hierarchical_qp import Rows
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.control.tasks import Gain

GAIN = Gain(50.0, 11.0)
H = 1e-4


class State:
    """A body at a random state that moves with a given acceleration."""

    def __init__(self, robot: Robot, seed: int) -> None:
        self.robot, self.body = robot, RigidBody(robot)
        rng = self.rng = np.random.default_rng(seed)
        model = robot.model
        self.q = pin.integrate(model, robot.q_reference, 0.4 * rng.normal(size=model.nv))
        self.v = rng.normal(size=model.nv)
        self.body.update(self.q, self.v)

    def after(self, a: np.ndarray, t: float) -> RigidBody:
        """The body ``t`` later; to second order in t its acceleration is ``a``."""
        body = RigidBody(self.robot)
        body.update(pin.integrate(self.robot.model, self.q, t * self.v + 0.5 * t * t * a), self.v + t * a)
        return body

    def solution(self, rows: Rows) -> np.ndarray:
        """Any acceleration that satisfies the rows, with a random part in their null space."""
        free = self.rng.normal(size=rows.A.shape[1])
        return free + np.linalg.lstsq(rows.A, rows.b - rows.A @ free)[0]


def spring(error: Callable[[float], np.ndarray]) -> np.ndarray:
    """``e'' + kd e' + kp e`` by central differences."""
    before, now, after = error(-H), error(0.0), error(H)
    return (after - 2 * now + before) / H**2 + GAIN.kd * (after - before) / (2 * H) + GAIN.kp * now


@pytest.fixture(params=range(3))
def state(request: pytest.FixtureRequest, talos: Robot) -> State:
    return State(talos, request.param)


def test_centre_of_mass_follows_its_reference_as_a_spring_would(state: State) -> None:
    """(4.3)."""
    p, v, a = state.rng.normal(size=(3, 3))
    a_joint = state.solution(tasks.com_task(state.body, Reference(p, v, a, np.zeros(3), np.zeros(3), 0), GAIN))
    error = spring(lambda t: p + v * t + 0.5 * a * t * t - state.after(a_joint, t).com_m)
    assert np.abs(error).max() < 1e-4


def test_angular_momentum_decays_to_its_reference(state: State) -> None:
    l, l_rate = state.rng.normal(size=(2, 3))
    zero = np.zeros(3)
    a = state.solution(tasks.momentum_task(state.body, Reference(zero, zero, zero, l, l_rate, 0), 8.0))
    rate = (state.after(a, H).l_nms - state.after(a, -H).l_nms) / (2 * H)
    assert np.allclose(rate, l_rate + 8.0 * (l - state.body.l_nms), atol=1e-4)


@pytest.mark.parametrize("name", ["left_foot", "right_hand", "base"])
def test_position_follows_its_reference_as_a_spring_would(state: State, name: str) -> None:
    p, v, a = state.rng.normal(size=(3, 3))
    a_joint = state.solution(tasks.position_task(state.body.frame_state(name), p, v, a, GAIN))
    error = spring(lambda t: p + v * t + 0.5 * a * t * t - state.after(a_joint, t).frame_state(name).position_m)
    assert np.abs(error).max() < 1e-4


@pytest.mark.parametrize("name", ["left_foot", "right_hand", "base"])
def test_orientation_follows_its_reference_as_a_spring_would(state: State, name: str) -> None:
    """The relative rotation itself: its angular velocity and acceleration come from log maps at the two ends."""
    w, w_rate = state.rng.normal(size=(2, 3))
    here = state.body.frame_state(name)
    R = pin.exp3(0.3 * state.rng.normal(size=3)) @ here.rotation
    a = state.solution(tasks.orientation_task(here, R, w, w_rate, GAIN))
    before, after = (state.after(a, t).frame_state(name).rotation for t in (-H, H))
    ahead, back = pin.log3(after @ here.rotation.T), pin.log3(before @ here.rotation.T)
    assert np.allclose((ahead - back) / (2 * H), here.velocity[3:], atol=1e-4)
    requested = w_rate + GAIN.kp * pin.log3(R @ here.rotation.T) + GAIN.kd * (w - here.velocity[3:])
    assert np.allclose((ahead + back) / H**2, requested, atol=1e-3)


@pytest.mark.parametrize(("name", "surface"), [("left_foot", True), ("right_hand", False)])
def test_a_contact_is_drawn_to_its_place_and_a_surface_stops_turning(state: State, name: str, surface: bool) -> None:
    from stridelab.dynamics.spatial import Placement

    here = state.body.frame_state(name)
    place = Placement(here.position_m + 0.1 * state.rng.normal(size=3), here.rotation)
    rows = tasks.contact_task(here, place, surface, GAIN)
    assert len(rows.b) == (6 if surface else 3)
    a = state.solution(rows)
    error = spring(lambda t: place.position_m - state.after(a, t).frame_state(name).position_m)
    assert np.abs(error).max() < 1e-4
    if surface:
        before, after = (state.after(a, t).frame_state(name).rotation for t in (-H, H))
        bend = (pin.log3(after @ here.rotation.T) + pin.log3(before @ here.rotation.T)) / H**2
        assert np.allclose(bend, -GAIN.kd * here.velocity[3:], atol=1e-3)


def test_posture_is_a_spring_and_a_damper_in_every_joint(state: State) -> None:
    rest = state.rng.normal(size=state.robot.model.nv - 6)
    a = state.solution(tasks.posture_task(state.body, rest, GAIN))
    assert np.allclose(a[6:], GAIN.kp * (rest - state.q[7:]) - GAIN.kd * state.v[6:])


def test_stacked_rows_are_weighted_and_widened() -> None:
    one, two = Rows(np.ones((1, 2)), np.array([3.0])), Rows(np.eye(2), np.array([1.0, 2.0]))
    rows = tasks.stack_weighted([(2.0, one), (np.array([3.0, 4.0]), two)], 3)
    assert np.array_equal(rows.A, [[2.0, 2.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    assert np.array_equal(rows.b, [6.0, 3.0, 8.0])


def test_a_joint_near_the_end_of_its_range_is_pushed_away_and_others_are_left_alone(state: State) -> None:
    """The weight begins at zero with the distance at which the task acts, so that accelerations are continuous."""
    body, limits, acts_rad = state.body, JointLimits.of_model(state.body.model), 0.1
    at_rest = np.zeros(body.model.nv)
    lower, upper, free = 6 + np.array([3, 9, 4])

    def task_at(distance_rad: float, v: np.ndarray = at_rest) -> tuple[np.ndarray, Rows]:
        q = state.q.copy()
        q[lower + 1] = limits.lower_rad[lower - 6] + distance_rad
        q[upper + 1] = limits.upper_rad[upper - 6] - distance_rad
        q[free + 1] = 0.5 * (limits.lower_rad[free - 6] + limits.upper_rad[free - 6])
        body.update(q, v)
        return tasks.range_task(body, limits, (int(lower), int(upper), int(free)), GAIN, acts_rad)

    weights, rows = task_at(0.04)
    assert weights == pytest.approx([0.36, 0.36, 0.0])
    a = np.linalg.lstsq(rows.A[:2], rows.b[:2])[0]
    assert a[lower] == pytest.approx(GAIN.kp * 0.06)
    assert a[upper] == pytest.approx(-GAIN.kp * 0.06)
    assert np.count_nonzero(a) == 2
    assert task_at(acts_rad - 1e-6)[0].max() < 1e-9
    approaching = at_rest.copy()
    approaching[lower] = -0.5
    assert task_at(acts_rad + 0.01, approaching)[0][0] == pytest.approx(0.16)
    assert task_at(acts_rad + 0.01)[0].max() == 0.0
