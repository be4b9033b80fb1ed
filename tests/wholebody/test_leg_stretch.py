"""Legs along a plan: the base from CoM and feet, how much a stretched leg lacks, and plans that are low enough."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from experiments.execution import whole_body_problem
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import Stairs, descent, flat_walk
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.contact_frames import to_se3
from stridelab.robots.robot import Robot
from stridelab.wholebody.leg_stretch import ENOUGH_M, MAX_VERTICAL_M_S2, LegModel, lower_for_legs


def test_the_base_follows_from_the_com_and_the_feet(talos: Robot) -> None:
    model, data, legs = talos.model, talos.model.createData(), LegModel.of_robot(talos)
    q = talos.q_reference.copy()
    for crouch_rad in (0.0, 0.15):
        for side in ("left", "right"):
            for joint, share in ((3, -1.0), (4, 2.0), (5, -1.0)):  # hip, knee and ankle: the sole stays level
                index = model.joints[model.getJointId(f"leg_{side}_{joint}_joint")].idx_q
                q[index] = talos.q_reference[index] + share * crouch_rad
        com = pin.centerOfMass(model, data, q)
        pin.updateFramePlacements(model, data)
        ankles = {}
        for name, leg in legs.legs.items():
            effector = talos.effectors[name]
            contact = data.oMf[model.getFrameId(effector.frame)] * to_se3(effector.T_frame_contact)
            ankles[name] = contact.act(leg.ankle_m)[None]
        base, moved = legs._base_m(com[None], np.eye(3)[None], ankles)
        assert np.allclose(base[0], q[:3], atol=1e-9 if crouch_rad == 0.0 else 0.012)
        assert 1.0 < moved < 1.4


@pytest.fixture(scope="module")
def down(talos: Robot) -> tuple[CentroidalProblem, CentroidalPlan]:
    """Down two high stairs with a density of high CoMs: the foot that lands is too far below the body."""
    sequence = sequence_of(descent(Stairs(2, 0.17, 0.30), Timing(1.5, 1.4, 0.3)), effector_shapes("talos"))
    density = Mixture(np.ones(1), np.array([[0.0, 0.0, 0.88]]), np.diag([0.2, 0.15, 0.1])[None] ** 2)
    problem = whole_body_problem(talos, sequence, {name: Proxy(density) for name in ("left_foot", "right_foot")})
    return problem, solve(problem)


def missing_m(talos: Robot, plan: CentroidalPlan) -> float:
    times_s = np.linspace(0.0, plan.sequence.duration_s, 200)
    return float(LegModel.of_robot(talos).missing_height_m(plan, times_s).max())


def test_a_plan_is_lowered_where_a_leg_is_too_short(
    talos: Robot, down: tuple[CentroidalProblem, CentroidalPlan]
) -> None:
    problem, plan = down
    assert missing_m(talos, plan) > 2.0 * ENOUGH_M
    lower, lowered = lower_for_legs(talos, problem, plan, solve)
    assert missing_m(talos, lowered) < 0.5 * missing_m(talos, plan)
    heights_m_s2 = [abs(lowered.reference_at(t).com_a_m_s2[2]) for t in np.linspace(0.0, plan.sequence.duration_s, 200)]
    assert max(heights_m_s2) < 1.02 * MAX_VERTICAL_M_S2  # other times than those that were looked at
    assert lower.reference_m_s2 is not None
    assert not lower.reference_m_s2[:, :2].any()
    assert np.allclose(lowered.com_m[[0, -1]], plan.com_m[[0, -1]], atol=1e-6)


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
