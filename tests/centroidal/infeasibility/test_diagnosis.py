"""Diagnoses of problems that are infeasible for a known reason, and of proposals by solving what they propose."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.infeasibility.diagnosis import Diagnosis, diagnose
from stridelab.centroidal.infeasibility.nearest_feasible import nearest_feasible
from stridelab.centroidal.nlp.solvers import Limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.contacts.terrain import Box, Terrain
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from support.robots.sequences import COM_HEIGHT_M, foot, hand, phase, rest_to_rest, sequence, two_steps


def diagnosed(problem: CentroidalProblem) -> tuple[CentroidalPlan, Diagnosis]:
    plan = solve(problem)
    return plan, diagnose(problem, plan)


def over(problem: CentroidalProblem, walk: ContactSequence) -> CentroidalPlan:
    return solve(replace(problem, sequence=walk))


def on_slope(side: str, angle_rad: float, friction: float) -> Contact:
    place = Placement.from_wxyz(
        (0.0, 0.09 if side == "left" else -0.09, 0.0), (np.cos(angle_rad / 2), 0.0, np.sin(angle_rad / 2), 0.0)
    )
    return Contact(f"{side}_foot", place, "slope", friction)


def test_a_good_plan_has_no_findings(problem: CentroidalProblem, plan: CentroidalPlan) -> None:
    diagnosis = diagnose(problem, plan)
    assert (diagnosis.verdict, diagnosis.findings) == ("found", ())
    assert diagnosis.sentence == "The plan respects all limits."


def test_a_phase_of_a_twentieth_of_a_second_is_reported_with_its_missing_time() -> None:
    """Six centimetres need at least ``sqrt(2 d / (mu g))``, whatever the feet do."""
    standing = sequence(phase(0.05, foot("left", 0.0), foot("right", 0.0)))
    problem = replace(rest_to_rest(standing), com_end_m=np.array([0.06, 0.0, COM_HEIGHT_M]))
    plan, diagnosis = diagnosed(problem)
    assert not plan.converged
    assert diagnosis.verdict == "impossible"
    assert diagnosis.findings[-1].kind == "end"
    assert 0.05 < diagnosis.findings[-1].value <= 0.06 + 1e-9
    proposed = diagnosis.durations
    assert proposed is not None
    least_s = np.sqrt(2 * 0.06 / (0.3 * GRAVITY_M_S2))
    assert least_s - 0.05 < proposed.longer_s[0] < 5 * least_s
    assert f"phase 0 {proposed.longer_s[0]:.2f} s longer" in diagnosis.sentence
    assert over(problem, proposed.sequence).converged


def test_a_walk_too_fast_is_slowed_down_in_few_phases() -> None:
    walk = two_steps(0.5)
    hasty = replace(walk, phases=tuple(replace(p, duration_s=0.2 * p.duration_s) for p in walk.phases))
    problem = rest_to_rest(hasty)
    plan, diagnosis = diagnosed(problem)
    assert not plan.converged
    proposed = diagnosis.durations
    assert proposed is not None
    assert 0 < (np.abs(proposed.longer_s) > 1e-9).sum() < len(walk.phases)
    assert over(problem, proposed.sequence).converged


def test_on_a_slippery_slope_the_feet_are_named_and_the_friction_is_that_of_statics() -> None:
    a = 0.25
    problem = rest_to_rest(sequence(phase(1.0, on_slope("left", a, 0.05), on_slope("right", a, 0.05))))
    plan, diagnosis = diagnosed(problem)
    assert not plan.converged
    assert diagnosis.verdict == "impossible"
    assert {f.effector for f in diagnosis.findings if f.kind == "cone"} == {"left_foot", "right_foot"}
    assert diagnosis.durations is None
    assert diagnosis.friction == pytest.approx(np.tan(a) / np.cos(np.pi / 8), rel=0.01)
    assert f"friction of {diagnosis.friction:.2f}" in diagnosis.sentence


def test_a_step_too_long_is_out_of_reach_though_the_solver_is_content() -> None:
    plan, diagnosis = diagnosed(rest_to_rest(two_steps(1.3)))
    assert plan.converged
    assert diagnosis.verdict == "unbearable"
    worst = diagnosis.findings[0]
    assert worst.phase == 2
    assert worst.effector in {"left_foot", "right_foot"}
    unusual = [f for f in diagnosis.findings if f.kind == "unusual"]
    assert {f.effector for f in unusual} == {"left_foot", "right_foot"}
    assert max(f.value for f in unusual) < 0.001


def test_a_hand_alone_is_named() -> None:
    left, right = foot("left", 0.0), foot("right", 0.0)
    walk = sequence(phase(0.6, left, right), phase(0.8, hand(0.2, 0.9)), phase(0.6, left, right))
    _, diagnosis = diagnosed(rest_to_rest(walk))
    assert diagnosis.verdict == "unbearable"
    assert (1, "right_hand") in {(f.phase, f.effector) for f in diagnosis.findings}
    assert "phases[1].right_hand" in " ".join(f.location for f in diagnosis.findings)


def test_a_foothold_out_of_reach_is_moved_nearer() -> None:
    left, right = foot("left", 0.0), foot("right", 0.0)
    far = Contact("right_foot", Placement.from_wxyz((0.2, -1.3, 0.0)), "ground", 0.3)
    walk = sequence(
        phase(0.8, left, right), phase(0.6, left), phase(0.6, left, far), phase(0.6, left), phase(0.8, left, right)
    )
    repair = nearest_feasible(rest_to_rest(walk), "placements")
    assert repair is not None
    assert repair.is_feasible
    assert set(repair.shifts_m) == {(2, "right_foot")}
    assert repair.shifts_m[2, "right_foot"][1] > 0.1
    assert repair.longer_s == pytest.approx(np.zeros(5))
    moved = repair.sequence.phases[2].contacts["right_foot"].placement.position_m
    assert moved == pytest.approx(far.placement.position_m + repair.shifts_m[2, "right_foot"])
    assert over(rest_to_rest(walk), repair.sequence).converged


def test_a_solver_that_stopped_early_is_stuck(problem: CentroidalProblem) -> None:
    plan = solve(problem, limits=Limits(iterations=2))
    assert not plan.converged
    diagnosis = diagnose(problem, plan)
    assert diagnosis.verdict == "stuck"
    assert "the solver did not find one" in diagnosis.sentence
    assert diagnose(problem).verdict == "stuck", "without a plan too"


def test_a_foothold_stays_on_its_stone() -> None:
    """As far out as above, on a stone 10 cm longer and wider than the sole: it cannot come near enough."""
    left, right = foot("left", 0.0), foot("right", 0.0)
    far = Contact("right_foot", Placement.from_wxyz((0.2, -1.3, 0.0)), "stone", 0.3)
    stone = Box("stone", Placement.from_wxyz((0.2, -1.3, -0.05)), np.array([0.3, 0.22, 0.1]))
    alone = phase(0.6, left)
    walk = sequence(phase(0.8, left, right), alone, phase(0.6, left, far), alone, phase(0.8, left, right))
    repair = nearest_feasible(rest_to_rest(replace(walk, terrain=Terrain((stone,)))), "placements")
    assert repair is not None
    assert not repair.is_feasible
    corners = repair.sequence.phases[2].contacts["right_foot"].placement.position_m
    assert np.abs(corners - far.placement.position_m).max() <= 0.08


def test_a_cone_too_narrow_for_the_wrench_is_distinguished_from_contacts_that_hold_nothing() -> None:
    """With a hundredth of the thesis' outer cone there is no motion; by forces there is one."""
    problem = rest_to_rest(two_steps(0.3), control=ContactWrench("thesis", alpha=0.01))
    diagnosis = diagnose(problem, solve(problem, "ipopt", Limits(iterations=100)))
    assert diagnosis.verdict == "narrow"
    worst = diagnosis.findings[0]
    assert worst.kind == "wrench"
    assert worst.phase in (1, 3)  # on one foot
    assert worst.value > 10.0
    assert f"{worst.location}: the wrench of a motion by forces lies {worst.value:.1f} times" in diagnosis.sentence
    wide = replace(problem, control=ContactWrench())
    touches, upright = wide.contact_patches(1, wide.com_start_m), np.zeros((1, 6))
    upright[0, 2], upright[0, 3:] = 1.0, np.cross(np.mean(touches[0].points_m, axis=0), [0.0, 0.0, 1.0])
    assert wide.control.gauge(touches, upright)[0] < 0.1  # the middle of the sole is the middle of the cone
    assert problem.control.gauge(touches, upright)[0] < 1.0


def test_a_search_that_runs_out_of_time_is_reported() -> None:
    walk = two_steps(0.5)
    hasty = replace(walk, phases=tuple(replace(p, duration_s=0.2 * p.duration_s) for p in walk.phases))
    problem = rest_to_rest(hasty)
    diagnosis = diagnose(problem, solve(problem), search_s=0.0)
    assert diagnosis.verdict == "impossible"
    assert diagnosis.findings
    assert diagnosis.durations is diagnosis.placements is diagnosis.friction is None
    assert diagnosis.cut_short
    assert diagnosis.sentence.endswith("The search for a remedy reached its time limit without a result.")
