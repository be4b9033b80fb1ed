"""TALOS' walks and run obey mechanics and kinematics: finite differences, recursive Newton-Euler, soles, limits."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from stridelab.conventions import GRAVITY_M_S2, g
from stridelab.dynamics.wrench import zmp_of_motion
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.simulation.robot.forward_kinematics import link_masses, link_poses
from stridelab.simulation.robot.gait_plan import WALKS, RobotGait, gait_for, plan_walk
from stridelab.simulation.robot.runner import RUNNING, running_at
from stridelab.simulation.robot.walker import RATE_HZ, RobotWalk, simulate_walk

DT = 1.0 / RATE_HZ
MOTIONS = ["robot_walk", "brisk_walk", "robot_run"]


@pytest.fixture(params=MOTIONS)
def motion(request: pytest.FixtureRequest) -> RobotWalk:
    walk: RobotWalk = request.getfixturevalue(request.param)
    return walk


def soles(moved: RobotWalk) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Place and rotation of both contact frames over time, by pinocchio."""
    model, frames = with_contact_frames(moved.robot)
    data = model.createData()
    tracks: dict[str, tuple[list, list]] = {"left": ([], []), "right": ([], [])}
    for q in moved.motion.q:
        pin.framesForwardKinematics(model, data, q)
        for side, (places, rotations) in tracks.items():
            pose = data.oMf[frames[f"{side}_foot"]]
            places.append(pose.translation.copy())
            rotations.append(pose.rotation.copy())
    return {side: (np.array(places), np.array(rotations)) for side, (places, rotations) in tracks.items()}


def richardson(track: np.ndarray) -> np.ndarray:
    """Fourth-order central differences, without the two samples at either end."""
    return np.asarray((8.0 * (track[3:-1] - track[1:-3]) - (track[4:] - track[:-4])) / (12.0 * DT))


@pytest.mark.parametrize(
    ("track", "rate"),
    [("com_m", "velocity_m_s"), ("velocity_m_s", "acceleration_m_s2"), ("momentum_nms", "momentum_rate_nm")],
)
def test_rates_are_derivatives(motion: RobotWalk, track: str, rate: str) -> None:
    """At 200 Hz, differences are good where jerk is smooth: nine samples in ten agree to 1 % of the largest rate."""
    exact = getattr(motion.truth, rate)[2:-2]
    error = np.abs(richardson(getattr(motion.truth, track)) - exact).max(axis=1)
    assert np.percentile(error, 90) < 0.01 * np.abs(exact).max()


def test_velocities_and_accelerations_are_those_of_the_configurations(motion: RobotWalk) -> None:
    model, m = motion.robot.model, motion.motion
    ends = [(1.0, 8.0), (2.0, -1.0)]
    velocity = np.zeros((len(m.q) - 4, model.nv))
    for k in range(len(velocity)):
        for step, weight in ends:
            i = int(step)
            ahead = pin.difference(model, m.q[k + 2], m.q[k + 2 + i])
            behind = pin.difference(model, m.q[k + 2], m.q[k + 2 - i])
            velocity[k] += weight * (ahead - behind) / (12.0 * DT)
    for computed, exact in ((velocity, m.v[2:-2]), (richardson(m.v), m.a[2:-2])):
        error = np.abs(computed - exact).max(axis=1)
        assert np.percentile(error, 90) < 0.01 * np.abs(exact).max()
        assert np.median(error) < 1e-3 * np.abs(exact).max()


def test_impulse_of_the_contact_wrench_is_the_change_of_momentum(motion: RobotWalk) -> None:
    """m (v(t) - v(0)) = integral of f + m g; the same for the angular momentum about the origin (trapezoid)."""
    t, m = motion.truth, motion.truth.mass_kg
    impulse = np.trapezoid(t.force_n + m * g, dx=DT, axis=0)
    change = m * (t.velocity_m_s[-1] - t.velocity_m_s[0])
    assert np.abs(impulse - change).max() < 1e-4 * m * GRAVITY_M_S2 * t.time_s[-1]
    about_origin = t.momentum_nms + m * np.cross(t.com_m, t.velocity_m_s)
    turning = np.trapezoid(t.moment_nm + np.cross(t.com_m, m * g), dx=DT, axis=0)
    assert np.abs(turning - (about_origin[-1] - about_origin[0])).max() < 3e-4 * np.abs(t.moment_nm).max()


def test_the_wrench_is_that_of_newton_euler_at_the_floating_base(motion: RobotWalk) -> None:
    """Recursive Newton-Euler over the tree, an algorithm that knows nothing of momenta."""
    model, t, m = motion.robot.model, motion.truth, motion.motion
    data = model.createData()
    for k in np.linspace(0, len(m.q) - 1, 60).astype(int):
        pin.rnea(model, data, m.q[k], m.v[k], m.a[k])
        pin.forwardKinematics(model, data, m.q[k])
        at_origin = data.oMi[1].act(data.f[1])
        np.testing.assert_allclose(at_origin.linear, t.force_n[k], atol=1e-8)
        np.testing.assert_allclose(at_origin.angular, t.moment_nm[k], atol=1e-7)


def test_standing_soles_neither_slide_nor_tilt(motion: RobotWalk) -> None:
    for side, (places, rotations) in soles(motion).items():
        assert np.abs(rotations - np.eye(3)).max() < 1e-9, "soles are level all the time"
        assert places[:, 2].min() > -1e-9
        for stance in (s for s in motion.plan.stances if s.side == side):
            on = (motion.motion.time_s >= stance.strike_s) & (motion.motion.time_s <= stance.off_s)
            expected = np.array([stance.x_m, stance.y_m, 0.0])
            assert np.abs(places[on] - expected).max(initial=0.0) < 1e-9


def test_swinging_soles_clear_the_ground(robot_walk: RobotWalk) -> None:
    t = robot_walk.motion.time_s
    for side, (places, _) in soles(robot_walk).items():
        stances = [s for s in robot_walk.plan.stances if s.side == side]
        for before, after in pairwise(stances):
            middle = (t > 0.6 * before.off_s + 0.4 * after.strike_s) & (t < 0.4 * before.off_s + 0.6 * after.strike_s)
            assert places[middle, 2].min() > 0.04


def test_joints_stay_within_their_limits(motion: RobotWalk) -> None:
    model, angles = motion.robot.model, motion.motion.q[:, 7:]
    assert (angles - model.lowerPositionLimit[7:]).min() > 0.01
    assert (model.upperPositionLimit[7:] - angles).min() > 0.01


def test_the_robots_own_cadence_is_within_its_joint_speeds(robot_walk: RobotWalk) -> None:
    """The person's cadence and running are not: kinematics only."""
    share = np.abs(robot_walk.motion.v[:, 6:]).max(axis=0) / robot_walk.robot.model.velocityLimit[6:]
    assert share.max() < 0.7


@pytest.mark.parametrize(("name", "x_mm", "y_mm"), [("robot_walk", 2.0, 1.0), ("brisk_walk", 10.0, 3.0)])
def test_zero_moment_point_stays_where_it_was_planned(
    name: str, x_mm: float, y_mm: float, request: pytest.FixtureRequest
) -> None:
    """The soles reach 97 mm forwards and 62 mm sideways: the walk needs no forces that the ground cannot give."""
    moved: RobotWalk = request.getfixturevalue(name)
    t = moved.truth
    zmp_m = zmp_of_motion(t.com_m, t.acceleration_m_s2, t.momentum_rate_nm, t.mass_kg)
    error_mm = 1e3 * np.abs(zmp_m - moved.load.zmp_m).max(axis=0)
    assert np.all(error_mm < [x_mm, y_mm])


def test_walks_start_and_end_at_rest(robot_walk: RobotWalk, brisk_walk: RobotWalk) -> None:
    for moved in (robot_walk, brisk_walk):
        t = moved.truth
        assert np.abs(t.velocity_m_s[[0, -1]]).max() < 5e-3
        assert np.ptp(t.com_m[:, 0]) == pytest.approx(moved.plan.stances[-1].x_m, abs=0.02)


def test_nothing_but_gravity_acts_in_flight(robot_run: RobotWalk) -> None:
    """c'' = g and the angular momentum does not change; checked on the motion itself by differences, too."""
    t, plan = robot_run.truth, robot_run.plan
    flight_s = RUNNING.step_time_s - RUNNING.stance_s
    in_flight = np.zeros(len(t.time_s), dtype=bool)
    for before, after in pairwise(plan.stances):
        inside = (t.time_s > before.off_s + 1e-9) & (t.time_s < after.strike_s - 1e-9)
        in_flight |= inside
        if inside.sum() > 12:
            at_s = t.time_s[inside]
            fall = np.polynomial.polynomial.polyfit(at_s - at_s.mean(), t.com_m[inside], 2)
            np.testing.assert_allclose(2.0 * fall[2], g, atol=2e-3)
            assert np.ptp(t.momentum_nms[inside], axis=0).max() < 1e-6
    assert in_flight.mean() == pytest.approx(flight_s / RUNNING.step_time_s, abs=0.03)
    assert np.abs(t.acceleration_m_s2[in_flight] - g).max() < 1e-6
    assert np.abs(t.force_n[in_flight]).max() < 1e-4
    assert np.abs(t.moment_nm[in_flight]).max() < 1e-3
    airborne = {side: places[in_flight, 2] for side, (places, _) in soles(robot_run).items()}
    assert min(height.min() for height in airborne.values()) >= -1e-9


def test_runner_pushes_the_ground_and_stays_upright(robot_run: RobotWalk) -> None:
    f = robot_run.truth.force_n
    weight = robot_run.truth.mass_kg * GRAVITY_M_S2
    assert f[:, 2].min() > -1e-3
    assert 2.0 < f[:, 2].max() / weight < 3.5
    assert f[:, 2].mean() == pytest.approx(weight, rel=0.02)
    loaded = f[:, 2] > 50.0
    assert (np.hypot(f[loaded, 0], f[loaded, 1]) / f[loaded, 2]).max() < 0.4
    upright = np.array([pin.Quaternion(*q[[6, 3, 4, 5]]).matrix()[2, 2] for q in robot_run.motion.q])
    assert np.degrees(np.arccos(upright.min())) < 20.0
    speed = np.ptp(robot_run.truth.com_m[:, 0]) / np.ptp(robot_run.truth.time_s)
    assert speed == pytest.approx(RUNNING.step_length_m / RUNNING.step_time_s, rel=0.03)


def test_link_poses_agree_with_pinocchio(robot_run: RobotWalk) -> None:
    model, q = robot_run.robot.model, robot_run.motion.q[::97]
    data, poses, masses = model.createData(), link_poses(model, q), link_masses(model)
    coms = np.tensordot(poses.coms_m(masses), masses.mass_kg / masses.mass_kg.sum(), axes=(1, 0))
    for k, configuration in enumerate(q):
        pin.forwardKinematics(model, data, configuration)
        for joint in range(1, model.njoints):
            np.testing.assert_allclose(poses.position_m[k, joint - 1], data.oMi[joint].translation, atol=1e-12)
            np.testing.assert_allclose(poses.rotation[k, joint - 1], data.oMi[joint].rotation, atol=1e-12)
        np.testing.assert_allclose(coms[k], pin.centerOfMass(model, data, configuration), atol=1e-12)


def test_wrong_masses_keep_the_total_and_have_the_stated_error(robot_walk: RobotWalk) -> None:
    exact, rng = link_masses(robot_walk.robot.model), np.random.default_rng(0)
    draws = [exact.perturb(0.2, rng) for _ in range(2000)]
    assert draws[0].mass_kg.sum() == pytest.approx(exact.mass_kg.sum())
    ratio = np.array([d.lever_m[0] / exact.lever_m[0] for d in draws])
    np.testing.assert_allclose(ratio.std(axis=0), 0.2, rtol=0.1)


def test_seeds_vary_the_walk_and_repeat_it() -> None:
    gait = WALKS["robot"]
    first, again, other = (plan_walk(gait, np.random.default_rng(seed)) for seed in (3, 3, 4))
    assert first == again
    assert len(first.stances) == len(other.stances) == gait.n_steps + 3
    lengths = np.array([[s.x_m for s in plan.stances] for plan in (first, other)])
    assert np.abs(lengths[0] - lengths[1]).max() > 1e-3
    times = [[s.strike_s for s in plan.stances[2:]] for plan in (first, other)]
    assert np.abs(np.subtract(times[0], times[1])).max() > 1e-3


def test_same_seed_same_walk_and_another_seed_another_one() -> None:
    gait = gait_for(0.0, 2.0)
    first, other = simulate_walk(gait, 0), simulate_walk(gait, 1)
    assert simulate_walk(gait, 0) is first, "cached for the next caller"
    again = simulate_walk.__wrapped__(gait, 0)
    np.testing.assert_array_equal(first.motion.q, again.motion.q)
    np.testing.assert_array_equal(first.truth.moment_nm, again.truth.moment_nm)
    assert np.abs(first.truth.force_n - other.truth.force_n).max() > 1.0


@pytest.mark.parametrize(
    ("speed_m_s", "duration_s", "where"), [(-0.1, 6.0, "speed_m_s"), (1.0, 6.0, "speed_m_s"), (0.4, 2.5, "duration_s")]
)
def test_walks_that_talos_cannot_do_are_refused(speed_m_s: float, duration_s: float, where: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        gait_for(speed_m_s, duration_s)
    assert refusal.value.code == "walker-out-of-range"
    assert refusal.value.faults[0].where == where


@pytest.mark.parametrize("speed_m_s", [0.2, 1.5])
def test_runs_that_talos_cannot_do_are_refused(speed_m_s: float) -> None:
    with pytest.raises(InvalidInput) as refusal:
        running_at(speed_m_s, 4.0)
    assert refusal.value.code == "walker-out-of-range"


def test_footprints_out_of_reach_are_named_with_their_instant() -> None:
    far = RobotGait(step_length_m=1.2, step_time_s=0.8, n_steps=3, rest_s=0.8)
    with pytest.raises(NotEstimable, match="do not reach") as refusal:
        simulate_walk(far)
    assert refusal.value.code == "robot-out-of-reach"


def test_speed_and_duration_are_those_requested() -> None:
    gait = gait_for(0.5, 8.0)
    assert gait.duration_s == pytest.approx(8.0)
    assert gait.step_length_m / gait.step_time_s == pytest.approx(0.5)
    still = gait_for(0.05, 5.0)
    assert still.n_steps == 0
    assert still.duration_s == pytest.approx(5.0)
