"""The plain check finds what is wrong with a plan."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.verification import Motion, is_verified, verify


@pytest.fixture
def motion(plan: CentroidalPlan) -> Motion:
    forces = {name: f.copy() for name, f in plan.forces_n.items()}
    return Motion(
        plan.time_s, plan.phase, plan.com_m.copy(), plan.com_v_m_s.copy(), plan.l_nms.copy(), forces, plan.points_m
    )


def check(problem: CentroidalProblem, motion: Motion) -> Verification:
    return verify(problem.sequence, problem.mass_kg, motion, problem.com_start_m, problem.com_end_m)


def test_a_good_plan_passes(problem: CentroidalProblem, motion: Motion) -> None:
    assert is_verified(check(problem, motion))


@pytest.mark.parametrize("field", ["com_m", "com_v_m_s", "l_nms"])
def test_a_shifted_node_is_a_gap(problem: CentroidalProblem, motion: Motion, field: str) -> None:
    getattr(motion, field)[20, 1] += 1e-3
    verification = check(problem, motion)
    assert verification.dynamics_gap > 0.9e-3
    assert not is_verified(verification)


def test_a_force_outside_its_cone_is_detected(problem: CentroidalProblem, motion: Motion) -> None:
    motion.forces_n["left_foot"][5, 0] = [30.0, 0.0, 10.0]
    verification = check(problem, motion)
    assert verification.cone_margin_n == pytest.approx(0.3 * 10.0 - 30.0)
    assert not is_verified(verification)


def test_a_pulling_force_is_detected(problem: CentroidalProblem, motion: Motion) -> None:
    motion.forces_n["left_foot"][5, 0] = [0.0, 0.0, -10.0]
    assert check(problem, motion).normal_force_min_n == pytest.approx(-10.0)


def test_a_force_without_contact_is_detected(problem: CentroidalProblem, motion: Motion) -> None:
    motion.forces_n["right_hand"][0] = [[0.0, 0.0, 40.0]]
    assert check(problem, motion).cone_margin_n == pytest.approx(-40.0)


def test_another_goal_is_a_terminal_gap(problem: CentroidalProblem, motion: Motion) -> None:
    verification = check(replace(problem, com_end_m=problem.com_end_m + np.array([0.0, 0.02, 0.0])), motion)
    assert verification.terminal_gap == pytest.approx(0.02, abs=1e-6)
    assert not is_verified(verification)


def test_a_plan_with_nan_fails(problem: CentroidalProblem, motion: Motion) -> None:
    motion.com_m[3] = np.nan
    assert not is_verified(check(problem, motion))
