"""(4.11): states are sampled with a sole at rest and obey Newton and Euler; their log-densities along plans."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.centroidal.solver import solve
from stridelab.reachability.learning.com_sampling import configuration_stream
from stridelab.reproduction.studies.state_occupancy import (
    StateSamples,
    change_within_phases,
    nats_below_mode,
    position_log_density,
    rates_of_plan,
    sample_states,
)
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from support.robots.sequences import rest_to_rest, two_steps


@pytest.fixture(scope="module")
def talos() -> Robot:
    return load_robot("talos")


@pytest.fixture(scope="module")
def samples(talos: Robot) -> StateSamples:
    return sample_states(talos, "right_foot", 3, 5, "uniform")


def test_rates_are_those_of_the_equations_of_motion(talos: Robot, samples: StateSamples) -> None:
    """(4.11): joint rates drawn again give the CoM's velocity by differences; the sampled wrench leaves the sole."""
    rng = np.random.default_rng(5)
    model, frames = with_contact_frames(talos)
    data = model.createData()
    q = next(iter(configuration_stream(talos, "uniform", rng)))
    v = np.zeros(model.nv)
    v[6:] = rng.uniform(-1.0, 1.0, model.nv - 6) * model.velocityLimit[6:]
    tau = np.append(np.zeros(6), rng.uniform(-1.0, 1.0, model.nv - 6) * model.effortLimit[6:])
    J = pin.computeFrameJacobian(model, data, q, frames["right_foot"], pin.LOCAL_WORLD_ALIGNED)
    v[:6] = np.linalg.lstsq(J[:, :6], -J[:, 6:] @ v[6:], rcond=None)[0]
    assert np.abs(J @ v).max() < 1e-9
    pin.framesForwardKinematics(model, data, q)
    R = np.array(data.oMf[frames["right_foot"]].rotation)
    h = 1e-6
    com = [pin.centerOfMass(model, data, pin.integrate(model, q, s * h * v)) for s in (-1.0, 1.0)]
    assert samples.com_v_m_s[0] == pytest.approx((com[1] - com[0]) / (2 * h) @ R, abs=1e-5)
    # Torques, and a wrench at the sole that gives the sampled rates, leave the sole where it is.
    mass_kg = pin.computeTotalMass(model)
    f = mass_kg * (R @ samples.com_a_m_s2[0] + [0.0, 0.0, 9.81])
    c = pin.centerOfMass(model, data, q)
    n = R @ samples.l_rate_nm[0] - np.cross(data.oMf[frames["right_foot"]].translation - c, f)
    acceleration = pin.aba(model, data, q, v, tau + J.T @ np.append(f, n))
    pin.forwardKinematics(model, data, q, v, acceleration)
    pin.updateFramePlacements(model, data)
    moved = pin.getFrameClassicalAcceleration(model, data, frames["right_foot"], pin.LOCAL_WORLD_ALIGNED).vector
    assert np.abs(moved).max() < 1e-3 * np.abs(acceleration).max()


def test_nats_below_the_mode_are_those_of_the_normal_distribution() -> None:
    """(4.11): zero at the mean, half the squared distance in standard deviations elsewhere."""
    drawn = np.random.default_rng(0).normal(1.0, np.arange(1.0, 7.0), (20_000, 6))
    at = drawn.mean(axis=0) + np.array([[0.0] * 6, [2.0] + [0.0] * 5])
    assert nats_below_mode(drawn, at) == pytest.approx([0.0, 2.0], abs=0.06)


def test_a_change_counts_within_a_phase_only() -> None:
    assert change_within_phases(np.array([0.0, 1.0, 9.0, 9.5, 9.2]), np.array([0, 0, 1, 1, 1])) == 1.0


def test_rates_of_a_plan_lead_from_node_to_node() -> None:
    """(4.11): velocity and momentum, plus their rates times the interval, are those of the next node."""
    problem = rest_to_rest(two_steps())
    plan = solve(problem)
    velocities, rates = rates_of_plan(plan)
    step_s = np.diff(plan.time_s)[:, None]
    assert (velocities + step_s * rates)[:-1] == pytest.approx(velocities[1:], abs=1e-9)
    assert velocities[0] == pytest.approx(np.zeros(6), abs=1e-9)
    log_p = position_log_density(problem, plan)
    first, second = plan.sequence.phases[0].contacts.values()
    at, h = plan.com_m[:1], float(plan.sequence.headings_rad[0])
    alone = [problem.proxies[c.effector].log_density(at, c.placement, h)[0] for c in (first, second)]
    assert log_p[0] == pytest.approx(sum(alone))
