"""(4.11): states are sampled with a sole at rest and obey Newton and Euler; their log-densities along plans."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from stridelab.centroidal.free_variables import FreeDurations
from stridelab.centroidal.nlp.kkt import Point
from stridelab.centroidal.nlp.nlp import OBJECTIVE_SCALE
from stridelab.centroidal.nlp.transcription import transcribe
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.centroidal.state_density import StateDensity
from stridelab.errors import InvalidInput
from stridelab.reachability.learning.com_sampling import configuration_stream
from stridelab.reproduction.chapter4 import occupancy
from stridelab.reproduction.studies.state_occupancy import (
    StateSamples,
    change_within_phases,
    densities_of_soles,
    nats_below_mode,
    position_log_density,
    rates_of_plan,
    sample_states,
    state_log_density,
)
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from support.recorded_claims import assert_as_recorded
from support.reproduction_fixtures import RisingProgress
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


def test_the_density_of_a_state_is_the_normal_one_in_the_axes_of_its_contact() -> None:
    """Independently: scipy's normal density of the vectors turned into the contact's axes."""
    rng = np.random.default_rng(3)
    velocities, rates = rng.normal(0.5, np.arange(1.0, 7.0), (2, 400, 6))
    density = StateDensity.of_samples(velocities, rates)
    R = Rotation.from_rotvec([0.1, 0.2, 0.7]).as_matrix()
    at = rng.normal(0.0, 1.0, (2, 5, 6))
    turned = [np.hstack([z[:, :3] @ R, z[:, 3:] @ R]) for z in at]
    expected = [
        multivariate_normal(of.mean(axis=0), np.cov(of.T)).logpdf(z)
        for of, z in zip((velocities, rates), turned, strict=True)
    ]
    assert density.log_density(at[0], at[1], R) == pytest.approx(np.column_stack(expected))


def test_the_left_sole_has_the_mirrored_density(samples: StateSamples) -> None:
    """A motion of the left sole and its mirror image over the right one are as likely."""
    sampled = StateSamples(*np.random.default_rng(4).normal(0.3, 1.0, (4, 50, 3)))
    left, right = (densities_of_soles(sampled)[f"{side}_foot"] for side in ("left", "right"))
    v, r = np.array([[0.4, 0.1, 0.0, 1.0, 2.0, 3.0]]), np.array([[0.5, -0.2, 0.1, 4.0, 5.0, 6.0]])
    mirror = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    assert left.log_density(v, r, np.eye(3)) == pytest.approx(right.log_density(v * mirror, r * mirror, np.eye(3)))
    assert left.log_density(v, r, np.eye(3)) != pytest.approx(right.log_density(v, r, np.eye(3)))


@pytest.fixture(scope="module")
def dense() -> CentroidalProblem:
    """Two steps with a density whose mean sways to the left and whose momentum is narrow."""
    scale = np.array([0.3, 0.1, 0.3, 2.0, 2.0, 2.0])
    density = StateDensity(
        np.array([[0.0, 0.1, 0.0, 0.0, 0.0, 1.0], [0.0] * 6]), np.array([np.diag(scale**-2.0), np.diag(scale**-2.0)])
    )
    return replace(rest_to_rest(two_steps()), state_densities=dict.fromkeys(("left_foot", "right_foot"), density))


def test_the_term_in_the_program_is_that_of_the_plan(dense: CentroidalProblem) -> None:
    """Value of the compiled program against log-densities in NumPy, and its gradient against differences."""
    program, plain = transcribe(dense), transcribe(replace(dense, state_densities={}))
    rng = np.random.default_rng(2)
    w = program.guess + rng.normal(0.0, 0.02, len(program.guess))

    def term(x: np.ndarray) -> float:
        return float(program.compiled.nlp.value(x, program.p) - plain.compiled.nlp.value(x, plain.p)) / OBJECTIVE_SCALE

    direction = rng.normal(0.0, 1.0, len(w))
    slope = (term(w + 1e-5 * direction) - term(w - 1e-5 * direction)) / 2e-5
    gradients = [np.array(of.compiled.nlp.gradient(w, of.p)).ravel() for of in (program, plain)]
    assert (gradients[0] - gradients[1]) @ direction / OBJECTIVE_SCALE == pytest.approx(slope, rel=1e-6)
    plan = solve(dense, "ipopt")
    assert plan.converged
    step_s = np.diff(plan.time_s)
    by_hand = -float(step_s @ state_log_density(dense.state_densities, plan))
    in_cost = sum(value for name, value in plan.cost_terms.items() if name.startswith("log_density_rates"))
    assert in_cost == pytest.approx(by_hand, rel=1e-9)
    assert isinstance(plan.solution.point, Point)
    assert term(plan.solution.point.w) == pytest.approx(by_hand, rel=1e-6)


def test_a_density_of_the_state_moves_the_plan_towards_its_mean(dense: CentroidalProblem) -> None:
    """The mean of L is 1 N m s about the vertical; without the term nothing turns."""
    light = replace(dense, weights=replace(dense.weights, momentum_rate=0.01))
    without, within = solve(replace(light, state_densities={}), "ipopt"), solve(light, "ipopt")
    assert abs(without.l_nms[:, 2]).max() < 0.1
    assert within.l_nms[:, 2].max() > 0.3
    likelier = [float(np.mean(state_log_density(dense.state_densities, plan))) for plan in (without, within)]
    assert likelier[1] > likelier[0] + 0.05


def test_what_the_term_needs_is_refused_by_name(dense: CentroidalProblem) -> None:
    with pytest.raises(InvalidInput) as refused:
        replace(dense, durations=FreeDurations())
    assert refused.value.code == "densities-need-constant-forces"
    with pytest.raises(InvalidInput, match="densities of velocity and rates"):
        solve(replace(dense, control=CircularCones()), "native")


def test_claims_are_on_the_worst_motion_and_on_all_plans(monkeypatch: pytest.MonkeyPatch) -> None:
    """Invented changes of three motions in nats; of the two plans on stairs, one has not converged."""
    changes = iter([4.0, 0.2, 0.1, 2.0, 0.3, 0.06, 5.0, 0.05, 0.4])
    sampled: list[tuple[object, ...]] = []

    def sample(*of: object) -> SimpleNamespace:
        sampled.append(of)
        return SimpleNamespace(velocities=lambda: None, rates=lambda: None)

    def compared(experiment: int, _: object) -> dict[str, object]:
        numbers = {f"{what}_{case}": 1.0 for what in ("state_nats", "iterations") for case in ("with", "without")}
        return {"experiment": experiment, "converged": experiment == 2, "moved_m": 0.001 * experiment, **numbers}

    for name, thing in {
        "load_robot": lambda name: name,
        "sample_states": sample,
        "experiment_problem": lambda *_: None,
        "solve": lambda *_: SimpleNamespace(phase=None),
        "rates_of_plan": lambda _: (None, None),
        "position_log_density": lambda *_: None,
        "nats_below_mode": lambda *_: None,
        "change_within_phases": lambda *_: next(changes),
        "densities_of_soles": lambda _: {},
        "_compare_costs": compared,
    }.items():
        monkeypatch.setattr(occupancy, name, thing)
    result = occupancy.run.run(range(7, 8), RisingProgress())
    claims = {claim.key: claim for claim in result.claims}
    assert sampled == [("talos", "right_foot", 2000, 7, "conditioned")]
    assert claims["position"].ours == 2.0
    assert (claims["velocity"].ours, claims["rate"].ours) == pytest.approx((0.15, 0.08))
    assert (claims["converges"].ours, claims["converges"].verdict, claims["converges"].n) == (0.5, "not_met", 2)
    assert "moves by at most 3.0 mm" in claims["converges"].note
    assert result.n == 3
    assert_as_recorded("occupancy of invented motions", result.claims)
