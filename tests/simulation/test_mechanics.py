"""The truth obeys mechanics: checked by finite differences, by recursive Newton-Euler, and by the feet."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.conventions import Series, g
from stridelab.dynamics.wrench import zmp_of_motion
from stridelab.simulation.ground_truth import true_motion
from stridelab.simulation.human.walker import Walk

WALKS = ["steady_walk", "man_from_rest", "quiet_standing"]


@pytest.fixture(params=WALKS)
def walk(request: pytest.FixtureRequest) -> Walk:
    simulated: Walk = request.getfixturevalue(request.param)
    return simulated


def test_rates_are_derivatives_to_a_millionth(walk: Walk) -> None:
    """Central differences over 0.1 ms, at instants off the knots of the spline, relative to the largest rate."""
    h = 1e-4
    middle = np.linspace(0.1234, walk.duration_s - 0.1, 25)
    around = [true_motion(walk.body, walk.posture, middle + k * h) for k in range(-2, 3)]
    for track, rate in (
        ("com_m", "velocity_m_s"),
        ("velocity_m_s", "acceleration_m_s2"),
        ("momentum_nms", "momentum_rate_nm"),
    ):
        values = np.stack([getattr(motion, track) for motion in around])
        derivative = (8 * (values[3] - values[1]) - (values[4] - values[0])) / (12 * h)
        exact = getattr(around[2], rate)
        np.testing.assert_allclose(derivative, exact, atol=1e-6 * max(float(np.abs(exact).max()), 0.1))


def test_impulse_of_the_contact_force_is_the_change_of_momentum(walk: Walk) -> None:
    """m (v(t) - v(0)) = integral of f + m g; the same for the angular momentum about the origin (trapezoid)."""
    t, m = walk.truth, walk.truth.mass_kg
    impulse = np.trapezoid(t.force_n + m * g, dx=1e-3, axis=0)
    np.testing.assert_allclose(impulse, m * (t.velocity_m_s[-1] - t.velocity_m_s[0]), atol=1e-4 * m)
    about_origin = t.momentum_nms + m * np.cross(t.com_m, t.velocity_m_s)
    turning = np.trapezoid(t.moment_nm + np.cross(t.com_m, m * g), dx=1e-3, axis=0)
    np.testing.assert_allclose(turning, about_origin[-1] - about_origin[0], atol=5e-3 * m)


def test_the_wrench_is_that_of_newton_euler_at_the_floating_base(walk: Walk) -> None:
    """The force that joint 1 (the free base) must transmit is the contact wrench; no centroidal formula is involved."""
    model, data = walk.body.model, walk.body.model.createData()
    t = walk.truth
    chosen = np.linspace(0, len(t.time_s) - 1, 40).astype(int)
    for k in chosen:
        q, v, a = (np.ascontiguousarray(walk.posture(t.time_s[k], nu=order)) for order in range(3))
        pin.rnea(model, data, q, v, a)
        pin.forwardKinematics(model, data, q)
        at_origin = data.oMi[1].act(data.f[1])
        np.testing.assert_allclose(at_origin.linear, t.force_n[k], atol=1e-8)
        np.testing.assert_allclose(at_origin.angular, t.moment_nm[k], atol=1e-7)


def test_feet_together_carry_the_wrench(walk: Walk) -> None:
    force = sum((foot.force_n for foot in walk.feet.values()), np.zeros_like(walk.force_n))
    moment = sum((foot.moment_nm for foot in walk.feet.values()), np.zeros_like(walk.moment_nm))
    np.testing.assert_allclose(force, walk.force_n, atol=1e-9)
    np.testing.assert_allclose(moment, walk.moment_nm, atol=1e-8)


def test_feet_push_within_the_friction_cone(walk: Walk) -> None:
    for foot in walk.feet.values():
        normal, sideways = foot.force_n[:, 2], np.linalg.norm(foot.force_n[:, :2], axis=1)
        assert normal.min() >= -1e-9
        assert np.all(sideways <= 0.6 * normal + 1e-6)
        assert np.all(np.abs(foot.free_moment_nm) <= 0.06 * normal + 1e-6), "more torsion than a sole can take"


def test_centre_of_pressure_stays_on_the_sole_that_touches_the_ground(walk: Walk) -> None:
    p, plan = walk.body.proportions, walk.plan
    for side, foot in walk.feet.items():
        for stance in (s for s in plan.stances if s.side == side):
            t: Series = walk.truth.time_s + plan.record_from_s
            on = (t >= stance.strike_s) & (t <= stance.off_s) & (foot.force_n[:, 2] > 20.0)
            yaw = 0.12 if side == "left" else -0.12
            offset = foot.cop_m[on, :2] - [stance.x_m, stance.y_m]
            along = offset @ [np.cos(yaw), np.sin(yaw)]
            across = offset @ [-np.sin(yaw), np.cos(yaw)]
            assert np.all(along > -p.heel_m - 0.01)
            assert np.all(along < p.toe_m)
            assert np.all(np.abs(across) < p.sole_breadth_m / 2)
            assert np.all(along[t[on] > stance.heel_off_s] > p.ball_m - 0.03), "the heel is up"


def test_a_foot_in_the_air_carries_nothing(steady_walk: Walk) -> None:
    plan = steady_walk.plan
    t = steady_walk.truth.time_s + plan.record_from_s
    for side, foot in steady_walk.feet.items():
        down = np.zeros(len(t), dtype=bool)
        for stance in (s for s in plan.stances if s.side == side):
            down |= (t >= stance.strike_s - 0.005) & (t <= stance.off_s + 0.005)
        assert not down.all()
        assert np.abs(foot.force_n[~down]).max() < 1e-9


def test_load_passes_smoothly(steady_walk: Walk) -> None:
    """No foot gains or loses more than 2 % of body weight in a millisecond."""
    weight = steady_walk.body.mass_kg * 9.81
    for foot in steady_walk.feet.values():
        assert np.abs(np.diff(foot.force_n[:, 2])).max() < 0.02 * weight


def test_zmp_is_the_weighted_mean_of_the_feet(steady_walk: Walk) -> None:
    """Against the ZMP of the dynamics package, which knows nothing of feet."""
    total = steady_walk.force_n[:, 2]
    mean = sum(
        (foot.force_n[:, 2:] / total[:, None] * foot.cop_m for foot in steady_walk.feet.values()),
        np.zeros_like(steady_walk.force_n),
    )
    t = steady_walk.truth
    zmp_m = zmp_of_motion(t.com_m, t.acceleration_m_s2, t.momentum_rate_nm, t.mass_kg)
    np.testing.assert_allclose(zmp_m, mean[:, :2], atol=1e-9)
