"""Equations of motion, contact forces and limits against inverse dynamics and plain formulas."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.sequence import Contact
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.control.tasks import force_jacobian, friction_pyramid


def at_random(robot: Robot, seed: int) -> tuple[RigidBody, np.random.Generator]:
    rng = np.random.default_rng(seed)
    body = RigidBody(robot)
    body.update(
        pin.integrate(robot.model, robot.q_reference, 0.4 * rng.normal(size=robot.model.nv)),
        rng.normal(size=robot.model.nv),
    )
    return body, rng


@pytest.mark.parametrize("seed", range(3))
def test_equations_of_motion_are_those_of_inverse_dynamics(talos: Robot, seed: int) -> None:
    """``M a + h - J' f`` against recursive Newton-Euler with the forces applied link by link. (2.1), (4.1)."""
    body, rng = at_random(talos, seed)
    a = rng.normal(size=talos.model.nv)
    model, data = talos.model, talos.model.createData()
    pin.forwardKinematics(model, data, body.q, body.v)
    external = [pin.Force.Zero() for _ in range(model.njoints)]
    generalised = body.M @ a + body.h
    for name in ("left_foot", "right_hand"):
        effector = talos.effectors[name]
        points = effector.points_m(0.01)
        f = rng.normal(size=(len(points), 3)) * 100.0
        generalised = generalised - force_jacobian(body.frame_state(name), points).T @ f.ravel()
        frame = model.frames[model.getFrameId(effector.frame)]
        link = data.oMi[frame.parentJoint] * frame.placement
        p = effector.T_frame_contact.act(points) @ link.rotation.T + link.translation
        wrench = pin.Force(f.sum(axis=0), np.cross(p, f).sum(axis=0))
        external[frame.parentJoint] += data.oMi[frame.parentJoint].actInv(wrench)
    assert np.allclose(generalised, pin.rnea(model, data, body.q, body.v, a, external), atol=1e-9)


def test_momentum_is_mass_times_velocity_of_the_com(talos: Robot) -> None:
    """(4.3)."""
    body, _ = at_random(talos, 5)
    momentum = body.A_g @ body.v
    assert np.allclose(momentum[:3], talos.mass_kg * body.com_v_m_s)
    assert np.allclose(momentum[3:], body.l_nms)


def test_without_forces_the_com_falls(talos: Robot) -> None:
    """Rows of the base alone, (2.2)."""
    body, rng = at_random(talos, 7)
    a = rng.normal(size=talos.model.nv)
    a[:6] = np.linalg.solve(body.M[:6, :6], -body.h[:6] - body.M[:6, 6:] @ a[6:])
    rate = body.A_g @ a + body.A_g_drift
    assert np.allclose(rate[:3] / talos.mass_kg, [0.0, 0.0, -GRAVITY_M_S2], atol=1e-9)
    assert np.allclose(rate[3:], 0.0, atol=1e-8)


@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_the_pyramid_lies_in_the_cone_and_touches_it(tilt: float) -> None:
    mu = 0.6
    place = Placement.from_wxyz([0.0, 0.0, 0.0], (np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0))
    cone = friction_pyramid(Contact("left_foot", place, "ground", mu), 1)
    rng = np.random.default_rng(0)
    n = place.rotation[:, 2]
    f = rng.normal(size=(4000, 3)) @ place.rotation.T + n
    allowed = np.all(f @ cone.G.T <= cone.upper, axis=1)
    normal = f @ n
    tangential = np.linalg.norm(f - normal[:, None] * n, axis=1)
    assert allowed.any()
    assert np.all(tangential[allowed] < mu * normal[allowed])
    diagonal = place.rotation @ np.array([mu / np.sqrt(2), mu / np.sqrt(2), 1.0])
    assert np.all(1000.0 * diagonal @ cone.G.T <= cone.upper + 2e-3)
    assert not np.all(1000.0 * diagonal * [1.01, 1.01, 1.0] @ cone.G.T <= cone.upper) or tilt


def test_points_of_a_surface_do_not_share_their_pyramids() -> None:
    cone = friction_pyramid(Contact("left_foot", Placement.identity(), "ground", 0.5), 4)
    assert cone.G.shape == (20, 12)
    assert np.count_nonzero(cone.G[:5, 3:]) == 0


def test_a_joint_brakes_before_its_limit() -> None:
    """Pushed towards its limit as hard as the bounds allow, a joint stays inside it, and so does its speed."""
    limits = JointLimits(np.array([-1.0]), np.array([1.0]), np.array([5.0]), np.array([1.0]), np.zeros(1))
    for side in (1.0, -1.0):
        q, v, dt = np.zeros(1), np.zeros(1), 0.004
        fastest = 0.0
        for _ in range(1000):
            lower, upper = limits.acceleration_bounds(q, v, 25.0, 50.0, 300.0)
            a = upper if side > 0 else lower
            q, v = q + dt * v + 0.5 * dt * dt * a, v + dt * a
            fastest = max(fastest, abs(float(v[0])))
            assert abs(q[0]) <= 1.0
        assert abs(q[0]) > 0.999
        assert 4.0 < fastest <= 5.0


def test_bounds_never_cross() -> None:
    rng = np.random.default_rng(1)
    n = 500
    limits = JointLimits(np.full(n, -1.0), np.full(n, 1.0), np.full(n, 2.0), np.ones(n), np.zeros(n))
    lower, upper = limits.acceleration_bounds(1.2 * rng.normal(size=n), 4.0 * rng.normal(size=n), 25.0, 50.0, 300.0)
    assert np.all(lower <= upper)


def test_limits_to_plan_with_lie_inside(talos: Robot) -> None:
    true = JointLimits.of_model(talos.model)
    inner = true.with_margins(0.02, 0.01, 0.9, 0.8)
    margin_rad = 0.02 * (true.upper_rad - true.lower_rad) + 0.01
    assert np.allclose(inner.upper_rad, true.upper_rad - margin_rad)
    assert np.allclose(inner.lower_rad, true.lower_rad + margin_rad)
    assert np.allclose(inner.velocity_rad_s, 0.9 * true.velocity_rad_s)
    assert np.allclose(inner.torque_nm, 0.8 * true.torque_nm - true.friction_nm)


def test_friction_takes_no_more_than_half_of_a_torque() -> None:
    """A joint weaker than its friction would have no torque at all that its bounds allow."""
    limits = JointLimits(np.zeros(3), np.ones(3), np.ones(3), np.array([10.0, 1.0, 1.0]), np.array([1.0, 0.7, 2.0]))
    assert np.allclose(limits.with_margins(0.0, 0.0, 1.0, 1.0).torque_nm, [9.0, 0.5, 0.5])


def test_a_motor_overcomes_the_friction_of_its_joint(talos: Robot) -> None:
    """TALOS' forearm has 1 N m of dry friction and 3 N m of torque; its legs' description states none."""
    true = JointLimits.of_model(talos.model)
    left = true.with_margins(0.0, 0.0, 1.0, 0.94)
    forearm, knee = (talos.joint_names.index(name) for name in ("arm_right_5_joint", "leg_left_4_joint"))
    assert left.torque_nm[forearm] == pytest.approx(0.94 * 3.0 - 1.0)
    assert left.torque_nm[knee] == pytest.approx(0.94 * true.torque_nm[knee])
