"""The choice of a step: hulls, predictions, reach and time."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.terrain import Box, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.robots.loader import load_robot
from stridelab.wholebody.recovery.footholds import Footholds
from stridelab.wholebody.recovery.leg_geometry import LegGeometry
from stridelab.wholebody.recovery.step_choice import (
    Step,
    StepChooser,
    StepSearch,
    Swinging,
    braking_pressure,
    nearest_in_hull,
)
from stridelab.wholebody.recovery.swing_aim import AimedSwing

RATE_PER_S = 3.4
HALF_M = np.array([0.1, 0.06])


def talos_legs() -> LegGeometry:
    legs = LegGeometry.of_robot(load_robot("talos"))
    assert legs is not None
    return legs


def chooser(x_m: tuple[float, float] = (-5.0, 5.0)) -> StepChooser:
    """On level ground between two edges."""
    middle, length = sum(x_m) / 2, x_m[1] - x_m[0]
    ground = Box("ground", Placement.from_wxyz([middle, 0.0, -0.5]), np.array([length, 10.0, 1.0]))
    return StepChooser(StepSearch(), talos_legs(), Footholds(Terrain((ground,))))


def chosen(capture_m: tuple[float, float], last: Step | None = None, **more: tuple[float, float]) -> Step | None:
    """A step of the left sole, 0.3 m behind and 5 cm above the ground, from a right one at the origin."""
    swing = Swinging(np.array([-0.3, 0.19, 0.05]), np.zeros(3), 1.0, None)
    return chooser(**more).choose_step(np.array(capture_m), RATE_PER_S, np.zeros(3), swing, np.eye(2), last)


@pytest.mark.parametrize(
    ("point", "distance"), [((0.3, 0.1), 0.0), ((0.0, 0.06), 0.0), ((0.75, 0.2), 0.05), ((-0.13, -0.1), 0.05)]
)
def test_distance_from_the_hull_of_two_soles(point: tuple[float, float], distance: float) -> None:
    nearest, off = nearest_in_hull(np.array(point), np.array([0.6, 0.2]), HALF_M)
    assert off == pytest.approx(distance)
    assert np.hypot(*(np.array(point) - nearest)) == pytest.approx(distance)


def test_the_pressure_that_brakes_brings_the_capture_point_to_the_sole_where_it_can() -> None:
    growth, T = float(np.exp(RATE_PER_S * 0.3)), 0.3
    for xi in (np.array([0.03, -0.02]), np.array([0.2, 0.1])):
        p = braking_pressure(xi, growth, HALF_M)
        at, dt = xi.copy(), 1e-5
        for _ in range(round(T / dt)):
            at = at + dt * RATE_PER_S * (at - p)
        reachable = (np.abs(xi * growth / (growth - 1.0)) <= HALF_M).all()
        assert (np.abs(at) < 1e-3).all() == reachable
        assert (np.abs(p) <= HALF_M + 1e-12).all()


@pytest.mark.parametrize("capture_m", [(0.15, 0.05), (-0.2, 0.05), (0.05, 0.25), (0.2, 0.2)])
def test_a_step_comes_where_the_capture_point_will_be(capture_m: tuple[float, float]) -> None:
    step = chosen(capture_m)
    assert step is not None
    growth, inner = float(np.exp(RATE_PER_S * step.in_s)), HALF_M - StepSearch().margin_m
    p = braking_pressure(np.array(capture_m), growth, inner)
    _, excess = nearest_in_hull(p + (np.array(capture_m) - p) * growth, step.place_m, inner)
    assert excess < 0.02
    assert step.place_m[1] > 0.14, "the legs do not cross"


def test_a_capture_point_that_runs_beyond_the_leg_is_followed_as_far_as_it_reaches() -> None:
    """0.25 m ahead of the standing sole, it is 0.77 m ahead when a sole 0.9 m behind that place can be there."""
    step = chosen((0.25, 0.05))
    assert step is not None
    assert step.place_m[0] == pytest.approx(StepSearch().ahead * talos_legs().leg_m)


def test_a_capture_point_beyond_the_standing_sole_is_met_by_a_quick_step_of_this_leg_and_one_of_the_other() -> None:
    inside, calm = chosen((0.0, -0.15)), chosen((0.0, 0.05))
    assert inside is not None
    assert calm is not None
    assert inside.place_m[1] < 0.2
    assert inside.cost > 10.0 * calm.cost


def test_steps_keep_their_time_once_chosen() -> None:
    step = chosen((0.2, 0.1))
    assert step is not None
    later = Step(step.place_m, 0.0, step.in_s - 0.1, 0.0)
    again = chosen((0.2, 0.1), last=later)
    assert again is not None
    assert again.in_s <= step.in_s


def test_a_step_stays_on_the_ground_and_none_is_chosen_without_any() -> None:
    step = chosen((0.5, 0.1), x_m=(-5.0, 0.3))
    assert step is not None
    assert step.place_m[0] < 0.3 - 0.1
    assert chosen((0.5, 0.1), x_m=(3.0, 4.0)) is None


def test_lengths_of_a_robot_are_those_of_its_legs() -> None:
    """TALOS: thigh 0.38 m, shank 0.325 m, soles 0.107 m below the ankles and 0.17 m apart."""
    legs = talos_legs()
    assert legs.leg_m == pytest.approx(0.705, abs=0.01)
    assert legs.ankle_m == pytest.approx(0.107, abs=0.005)
    assert legs.spacing_m == pytest.approx(0.17, abs=0.01)
    assert legs.side == {"left_foot": 1.0, "right_foot": -1.0}


def test_a_narrow_sole_takes_slower_steps() -> None:
    """The same step with soles of a third of the width: their reaction bears less acceleration, so it takes longer."""
    legs = talos_legs()
    ground = Box("ground", Placement.from_wxyz([0.0, 0.0, -0.5]), np.array([10.0, 10.0, 1.0]))
    swing = Swinging(np.array([-0.3, 0.19, 0.05]), np.zeros(3), 1.0, None)
    times_s = []
    for half_m in (legs.half_m, legs.half_m / [1.0, 3.0]):
        chooser = StepChooser(StepSearch(), replace(legs, half_m=half_m), Footholds(Terrain((ground,))))
        step = chooser.choose_step(np.array([0.3, 0.1]), RATE_PER_S, np.zeros(3), swing, np.eye(2), None)
        assert step is not None
        times_s.append(step.in_s)
    assert times_s[1] > times_s[0]


@pytest.mark.parametrize(("robot", "knee"), [("talos", "leg_left_4_joint"), ("g1", "left_knee_joint")])
def test_the_longest_leg_is_that_of_the_straightest_knee(robot: str, knee: str) -> None:
    loaded = load_robot(robot)
    legs = LegGeometry.of_robot(loaded)
    assert legs is not None
    model, data = loaded.model, loaded.model.createData()
    chain = list(model.supports[model.getJointId(knee)])[2:]
    q = loaded.q_reference.copy()
    k = model.joints[model.getJointId(knee)].idx_q
    q[k] = model.lowerPositionLimit[k]
    pin.forwardKinematics(model, data, q)
    hip, ankle = data.oMi[chain[0]], data.oMi[model.getJointId(knee) + 2]
    assert legs.leg_m == pytest.approx(np.linalg.norm(hip.translation - ankle.translation), abs=0.01)


def test_a_landing_on_a_lower_tread_is_not_postponed_by_each_new_choice() -> None:
    """Its robot was still waiting for that landing when it fell: the time stayed 0.27 s from choice to choice."""
    treads = [
        Box(name, Placement.from_wxyz([x, 0.0, z - 0.5]), np.array([0.3, 1.2, 1.0]))
        for name, x, z in (("upper", 0.0, 0.1), ("lower", -0.3, 0.0))
    ]
    choice = StepChooser(StepSearch(), talos_legs(), Footholds(Terrain(tuple(treads))))
    stance_m, capture_m = np.array([0.0, -0.09, 0.1]), np.array([-0.12, 0.0])
    swing, step, dt = AimedSwing(np.array([0.0, 0.09, 0.1]), np.zeros(3)), None, 0.016
    expected_s = []
    for k in range(40):
        top_m = 0.15 if swing.position_m[0] + 0.1 > -0.15 else 0.05
        now = Swinging(swing.position_m, swing.velocity_m_s, 1.0, dt * k if k < 5 else None, top_m, swing.landing)
        step = choice.choose_step(capture_m, RATE_PER_S, stance_m, now, np.eye(2), step)
        assert step is not None
        if step.in_s < 0.06:
            break
        expected_s.append(dt * k + step.in_s)
        swing.clear_m = top_m
        for _ in range(4):
            swing.advance(step.place_m, step.height_m, step.in_s, dt / 4)
            step = replace(step, in_s=step.in_s - dt / 4)
    assert step.height_m == 0.0
    assert dt * k < 0.5
    assert max(expected_s) - expected_s[0] < 0.08


@pytest.mark.parametrize(("was_up", "in_s"), [(True, (0.0, 0.06)), (False, (0.2, 0.3))])
def test_a_sole_that_is_about_to_land_comes_down_where_it_is(was_up: bool, in_s: tuple[float, float]) -> None:
    """It used to be lifted again for 0.22 s, in which the capture point left the hull that the landing would give."""
    swing = Swinging(np.array([0.25, 0.18, 0.006]), np.array([0.2, 0.0, -0.1]), 1.0, 0.0, 0.05, was_up=was_up)
    step = chooser().choose_step(np.array([0.2, 0.09]), RATE_PER_S, np.zeros(3), swing, np.eye(2), None)
    assert step is not None
    assert in_s[0] < step.in_s < in_s[1]
    if was_up:
        assert step.place_m == pytest.approx([0.25, 0.18])


def test_a_sole_beyond_the_capture_point_does_not_come_down_where_it_is() -> None:
    """A landing at once would leave the capture point 0.25 m ahead of both soles."""
    swing = Swinging(np.array([-0.1, 0.18, 0.03]), np.zeros(3), 1.0, None, 0.05, was_up=True)
    step = chooser().choose_step(np.array([0.2, 0.05]), RATE_PER_S, np.zeros(3), swing, np.eye(2), None)
    assert step is not None
    assert step.place_m[0] > 0.3


def test_margins_leave_most_of_a_narrow_sole() -> None:
    """2 cm inside the edges of a sole 5 cm wide, there is nearly no room aside."""
    legs = replace(talos_legs(), half_m=np.array([0.085, 0.025]))
    ground = Box("ground", Placement.from_wxyz([0.0, 0.0, -0.5]), np.array([10.0, 10.0, 1.0]))
    swing = Swinging(np.array([0.0, 0.18, 0.03]), np.zeros(3), 1.0, None, 0.05)
    costs = []
    for search in (StepSearch(), StepSearch(margin_share=1.0)):
        chooser = StepChooser(search, legs, Footholds(Terrain((ground,))))
        step = chooser.choose_step(np.array([0.0, -0.015]), RATE_PER_S, np.zeros(3), swing, np.eye(2), None)
        assert step is not None
        costs.append(step.cost)
    assert costs[0] < 0.1, "the capture point is inside the standing sole"
    assert costs[1] > 1.0
