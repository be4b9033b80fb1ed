"""Legs along a plan: the base from CoM and feet, how much a stretched leg lacks, and plans that are low enough."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from experiments.execution import whole_body_problem
from experiments.terrains.flights import random_flights
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import Stairs, climb, descent, flat_walk
from stridelab.conventions import Angles, Vector3
from stridelab.pipelines.plan_motion import plan_motion, stage_shares
from stridelab.pipelines.progress import Stages
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.contact_frames import to_se3
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody import leg_stretch
from stridelab.wholebody.leg_stretch import (
    BEND_RAD,
    ENOUGH_M,
    RANGE_SHARE,
    LegModel,
    MissingHeights,
    _raised_for_lean_m,
    iterate_lower_plans,
    lower_for_legs,
)
from stridelab.wholebody.shank_lean import ShankLean

PITCHES = {
    "talos": ("leg_{}_3_joint", "leg_{}_4_joint", "leg_{}_5_joint"),
    "g1": ("{}_hip_pitch_joint", "{}_knee_joint", "{}_ankle_pitch_joint"),
}
"""Joints of hip, knee and ankle that bend a leg in its own plane. The first of a leg of G1 is the third of TALOS."""


def crouched(robot: Robot, crouch_rad: float) -> Angles:
    """The reference posture with knees bent by twice ``crouch_rad`` more; the soles stay level."""
    q = robot.q_reference.copy()
    for side in ("left", "right"):
        for joint, share in zip(PITCHES[robot.name], (-1.0, 2.0, -1.0), strict=True):
            q[robot.model.joints[robot.model.getJointId(joint.format(side))].idx_q] += share * crouch_rad
    return q


def hips_and_ankles(robot: Robot, legs: LegModel, q: Angles) -> dict[str, tuple[Vector3, Vector3]]:
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, q)
    places = {}
    for name, leg in legs.legs.items():
        contact = data.oMf[model.getFrameId(robot.effectors[name].frame)] * to_se3(
            robot.effectors[name].T_frame_contact
        )
        places[name] = q[:3] + leg.hip_m, contact.act(leg.ankle_m)
    return places


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_the_base_follows_from_the_com_and_the_feet(name: str) -> None:
    robot = load_robot(name)
    legs = LegModel.of_robot(robot)
    for crouch_rad in (0.0, 0.15):
        q = crouched(robot, crouch_rad)
        com = pin.centerOfMass(robot.model, robot.model.createData(), q)
        ankles = {foot: ankle[None] for foot, (_, ankle) in hips_and_ankles(robot, legs, q).items()}
        base, moved = legs._base_m(com[None], np.eye(3)[None], ankles)
        assert np.allclose(base[0], q[:3], atol=1e-9 if crouch_rad == 0.0 else 0.012)
        assert 1.0 < moved < 1.4


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_a_leg_is_as_long_as_its_knee_allows_and_as_short_as_its_ankle_allows(name: str) -> None:
    """Postures whose knee or ankle is at the end of its usable range, by forward kinematics alone."""
    robot = load_robot(name)
    legs, model = LegModel.of_robot(robot), robot.model
    _, knee, ankle = (model.joints[model.getJointId(joint.format("left"))].idx_q for joint in PITCHES[name])
    usable = {}
    for at, margin_rad in ((knee, BEND_RAD), (ankle, 0.0)):
        low, high = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
        usable[at] = low + RANGE_SHARE * (high - low) + margin_rad
    leg = legs.legs["left_foot"]
    straight = crouched(robot, 0.5 * (usable[knee] - robot.q_reference[knee]))
    hip, foot = hips_and_ankles(robot, legs, straight)["left_foot"]
    assert np.linalg.norm(hip - foot) == pytest.approx(leg.lengths_m[-1], abs=1e-6)
    deepest_rad = robot.q_reference[ankle] - usable[ankle]
    heights_m = []
    for crouch_rad in (deepest_rad - 0.02, deepest_rad, deepest_rad + 0.05):
        hip, foot = hips_and_ankles(robot, legs, crouched(robot, crouch_rad))["left_foot"]
        heights_m.append((hip - foot)[2])
        raised_m = _raised_for_lean_m(leg, (hip - foot)[None], np.eye(3)[None], np.array([leg.tilt_max_rad]))[0]
        if crouch_rad < deepest_rad:
            assert raised_m == 0.0
    assert raised_m == pytest.approx(heights_m[1] - heights_m[2], abs=0.004)


@pytest.fixture(scope="module")
def down(talos: Robot) -> tuple[CentroidalProblem, CentroidalPlan]:
    """Down two high stairs with a density of high CoMs: the foot that lands is too far below the body."""
    sequence = sequence_of(descent(Stairs(2, 0.17, 0.30), Timing(1.5, 1.4, 0.3)), effector_shapes("talos"))
    density = Mixture(np.ones(1), np.array([[0.0, 0.0, 0.88]]), np.diag([0.2, 0.15, 0.1])[None] ** 2)
    problem = whole_body_problem(talos, sequence, {name: Proxy(density) for name in ("left_foot", "right_foot")})
    return problem, solve(problem)


def missing_heights_m(talos: Robot, plan: CentroidalPlan) -> MissingHeights:
    times_s = np.linspace(0.0, plan.sequence.duration_s, 200)
    return LegModel.of_robot(talos).missing_heights_m(plan, times_s, ShankLean(talos, plan.sequence))


def missing_m(talos: Robot, plan: CentroidalPlan) -> float:
    return float(missing_heights_m(talos, plan).high_m.max())


def vertical_max_m_s2(plan: CentroidalPlan) -> float:
    times_s = np.linspace(0.0, plan.sequence.duration_s, 200)
    return max(abs(float(plan.reference_at(t).com_a_m_s2[2])) for t in times_s)


def test_a_plan_is_lowered_where_a_leg_is_too_short(
    talos: Robot, down: tuple[CentroidalProblem, CentroidalPlan]
) -> None:
    problem, plan = down
    assert missing_m(talos, plan) > 2.0 * ENOUGH_M
    lower, lowered = lower_for_legs(talos, problem, plan, solve)
    assert missing_m(talos, lowered) <= ENOUGH_M
    assert vertical_max_m_s2(lowered) < 0.5  # no drop
    between_m = lower.bounds.com_between_m
    assert between_m is not None
    assert between_m[:, 1].min() < np.inf
    assert (lowered.com_m[1:-1, 2] <= between_m[1:, 1] + 1e-6).all()
    assert (lowered.com_m[1:-1, 2] >= between_m[1:, 0] - 1e-6).all()
    assert np.allclose(lowered.com_m[[0, -1]], plan.com_m[[0, -1]], atol=1e-6)


def test_a_plan_is_lowered_in_parts_of_one_solution(
    talos: Robot, down: tuple[CentroidalProblem, CentroidalPlan], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An editor pauses between them."""
    monkeypatch.setattr(leg_stretch, "ENOUGH_M", -1.0)
    problem, plan = down
    solutions: list[CentroidalPlan] = []

    def record(changed: CentroidalProblem) -> CentroidalPlan:
        solutions.append(solve(changed))
        return solutions[-1]

    parts = [(best, len(solutions)) for best in iterate_lower_plans(talos, problem, plan, record)]
    counts = [number for _, number in parts]
    assert counts[0] == 0
    assert counts[-1] > 1
    assert np.diff(counts).max() == 1
    assert np.array_equal(parts[-1][0][1].com_m, lower_for_legs(talos, problem, plan, solve)[1].com_m)


def test_a_plan_for_short_legs_does_not_lean_a_shank_against_the_next_riser(
    talos: Robot, proxies: Mapping[str, Proxy]
) -> None:
    """Bounds that only lower the CoM leave it 30 mm too low for the shank over which it passes next."""
    stairs = climb(Stairs(4, 0.182, 0.316, toe_gap_m=0.06), Timing(1.5, 0.98, 0.2), "alternate")
    problem = whole_body_problem(talos, sequence_of(stairs, effector_shapes("talos")), proxies)
    plan = solve(problem)
    assert missing_heights_m(talos, plan).worst_m > 2.0 * ENOUGH_M
    _, lowered = lower_for_legs(talos, problem, plan, solve)
    assert missing_heights_m(talos, lowered).worst_m <= 1.5 * ENOUGH_M
    times_s = np.linspace(0.0, lowered.sequence.duration_s, 200)
    assert min(lowered.reference_at(t).com_v_m_s[2] for t in times_s if t > 1.5) > -0.1


def test_bounds_of_an_earlier_plan_are_kept(talos: Robot, down: tuple[CentroidalProblem, CentroidalPlan]) -> None:
    """A plan that is solved again for another reason is not raised where the one before had to be low."""
    problem, plan = down
    lower, _ = lower_for_legs(talos, problem, plan, solve)
    again, _ = lower_for_legs(talos, lower, plan, solve)
    kept_m, between_m = lower.bounds.com_between_m, again.bounds.com_between_m
    assert kept_m is not None
    assert between_m is not None
    assert (between_m[:, 1] <= kept_m[:, 1]).all()


def test_legs_reach_in_a_plan_for_the_momentum_of_the_limbs(talos: Robot) -> None:
    """Such a plan missed 11 mm of the trailing leg: the body swung its arms, and a gripper met a thigh."""
    scenario = Scenario.model_validate(random_flights(2, 20261201)[1].scenario)
    task = PlanMotionTask(scenario=scenario, input=PlanMotionInput(scenario=scenario))
    result = plan_motion(task, Stages(lambda _fraction, _message: None, stage_shares(task.input)))
    assert len(result.passes) > 1
    assert missing_m(talos, result.plan) <= ENOUGH_M
    assert result.certificate is not None
    assert result.certificate.passed


def test_a_plan_whose_legs_reach_is_not_solved_again(talos: Robot, proxies: Mapping[str, Proxy]) -> None:
    problem = whole_body_problem(talos, sequence_of(flat_walk(2), effector_shapes("talos")), proxies)
    plan = solve(problem)

    def refuse(_: CentroidalProblem) -> CentroidalPlan:
        raise AssertionError("solved again")

    assert lower_for_legs(talos, problem, plan, refuse) == (problem, plan)


def test_a_plan_that_does_not_converge_is_not_taken(
    talos: Robot, down: tuple[CentroidalProblem, CentroidalPlan]
) -> None:
    problem, plan = down
    taken = lower_for_legs(talos, problem, plan, lambda _: replace(plan, status="failed", converged=False))
    assert taken == (problem, plan)
