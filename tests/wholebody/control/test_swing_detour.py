"""Detours of a swinging sole: derivatives against differences, closed at its landing, pushed off joint limits."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.swing import SwingCurve
from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.control.swing_detour import MAX_DETOUR_M, MAX_TILT_RAD, AnkleRelief, SwingDetour

CURVE = SwingCurve(Placement.from_wxyz([0.0, 0.1, 0.0]), Placement.from_wxyz([0.3, 0.1, 0.05]), 1.0, "surface", 2.0)
DT = 1e-3
PUSH = np.array([0.5, -1.0, 0.3, 0.8, -2.0, 0.4])


def targets(push: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Positions, velocities, rotations and angular velocities of the target over the whole swing."""
    detour = SwingDetour(CURVE, DT)
    states = [detour.next_state(2.0 + i * DT, push.copy) for i in range(1001)]
    return [(s.placement.position_m, s.velocity_m_s, s.placement.rotation, s.angular_velocity_rad_s) for s in states]


def test_without_a_push_the_curve_is_unchanged() -> None:
    for i, (p, v, R, w) in enumerate(targets(np.zeros(6))):
        state = CURVE.state_at(2.0 + i * DT - CURVE.starts_s)  # rounded as the detour does
        assert np.array_equal(p, state.placement.position_m)
        assert np.array_equal(R, state.placement.rotation)
        assert np.array_equal(v, state.velocity_m_s)
        assert np.array_equal(w, state.angular_velocity_rad_s)


def test_velocities_are_the_rates_of_the_placements() -> None:
    states = targets(PUSH)
    for i in range(1, 1000):
        (before, _, R_before, _), (_, v, R, w), (after, _, R_after, _) = states[i - 1 : i + 2]
        assert np.allclose((after - before) / (2 * DT), v, atol=2e-3)
        turned = np.asarray(pin.log3(R_after @ R_before.T)) / (2 * DT)
        # the rate of a rotation vector is the angular velocity up to terms of second order in the tilt
        assert np.allclose(turned, w, atol=5e-3)
        assert R.shape == (3, 3)


def test_a_detour_goes_where_it_is_pushed_and_closes_before_the_sole_lands() -> None:
    states = targets(PUSH)
    middle, plain = states[500][0], CURVE.state_at(0.5).placement.position_m
    assert (middle - plain) @ PUSH[:3] > 0.01 * np.linalg.norm(PUSH[:3])
    tilt = np.asarray(pin.log3(states[500][2]))
    assert tilt @ PUSH[3:] > 0.02 * np.linalg.norm(PUSH[3:])
    for i in range(965, 1001):
        end = CURVE.state_at(i * DT)
        assert np.allclose(states[i][0], end.placement.position_m, atol=1e-9)
        assert np.allclose(states[i][2], end.placement.rotation, atol=1e-9)


def test_a_detour_has_an_end() -> None:
    states = targets(40.0 * PUSH)  # 50 m/s^2, as of a pair that touches with the firmest stiffness
    for i, (p, _, R, _) in enumerate(states):
        assert np.linalg.norm(p - CURVE.state_at(i * DT).placement.position_m) < 1.1 * MAX_DETOUR_M
        assert np.linalg.norm(pin.log3(R)) < 1.1 * MAX_TILT_RAD


def test_a_hand_is_not_pushed_into_the_surface_that_it_leaves() -> None:
    start = Placement.from_wxyz([0.0, 0.0, 0.9], [np.cos(0.2), np.sin(0.2), 0.0, 0.0])
    curve = SwingCurve(start, Placement.from_wxyz([0.4, 0.0, 1.0]), 1.0, "point")
    inward, outward, normal = SwingDetour(curve, DT), SwingDetour(curve, DT), start.rotation[:, 2]
    push = np.array([0.3, -8.0, -9.0, 0.0, 0.0, 0.0])
    for i in range(1, 500):
        plain_m = curve.state_at(i * DT).placement.position_m
        moved_m = inward.next_state(i * DT, push.copy).placement.position_m - plain_m
        assert abs(moved_m @ normal) < 1e-12
        assert i < 100 or moved_m[1] < -1e-3, "along the surface it is pushed as before"
        out_m = outward.next_state(i * DT, lambda: -push).placement.position_m - plain_m
        assert i == 1 or out_m @ normal > 0.0


@pytest.mark.parametrize("joint", ["leg_left_5_joint", "leg_left_6_joint"])
@pytest.mark.parametrize("end", ["lower", "upper"])
def test_an_ankle_near_an_end_of_its_range_is_turned_away_from_it(talos: Robot, joint: str, end: str) -> None:
    limits, column = JointLimits.of_model(talos.model), 6 + talos.joint_names.index(joint)
    relief = AnkleRelief.of_sole(talos, "left_foot", limits)
    body, q = RigidBody(talos), talos.q_reference.copy()
    body.update(q, np.zeros(talos.model.nv))
    assert not relief.push(body, "left_foot").any()
    at = limits.lower_rad[column - 6] + 0.05 if end == "lower" else limits.upper_rad[column - 6] - 0.05
    q[column + 1] = at
    body.update(q, np.zeros(talos.model.nv))
    push = relief.push(body, "left_foot")
    step = np.zeros(talos.model.nv)
    step[column] = 1e-4 if end == "lower" else -1e-4  # away from the end
    before = body.frame_state("left_foot").rotation.copy()
    body.update(pin.integrate(talos.model, q, step), np.zeros(talos.model.nv))
    turned = np.asarray(pin.log3(body.frame_state("left_foot").rotation @ before.T))
    assert turned @ push[3:] > 0.99 * np.linalg.norm(turned) * np.linalg.norm(push[3:])
    assert push[2] > 0.0
    assert not push[:2].any()


def test_an_ankle_that_approaches_its_end_fast_is_turned_earlier(talos: Robot) -> None:
    limits, column = JointLimits.of_model(talos.model), 6 + talos.joint_names.index("leg_left_5_joint")
    relief, body, q = AnkleRelief.of_sole(talos, "left_foot", limits), RigidBody(talos), talos.q_reference.copy()
    q[column + 1] = limits.lower_rad[column - 6] + 0.3
    v = np.zeros(talos.model.nv)
    body.update(q, v)
    assert not relief.push(body, "left_foot").any()
    v[column] = -2.0
    body.update(q, v)
    assert relief.push(body, "left_foot").any()
