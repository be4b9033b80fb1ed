"""The receding horizon: Bellman's principle, disturbances, solves that fail, and the windows that it cuts."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stridelab.centroidal import receding_horizon as module
from stridelab.centroidal.boundary_conditions import Start
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.receding_horizon import RecedingHorizon, State, cut_sequence
from stridelab.centroidal.solver import solve
from stridelab.centroidal.warm_start import warm_start_point
from stridelab.errors import InvalidInput, NotEstimable
from support.robots.sequences import foot, phase, rest_to_rest, sequence, two_steps

WALK = two_steps(0.25)


@pytest.fixture(scope="module")
def walk() -> CentroidalProblem:
    return rest_to_rest(WALK)


@pytest.fixture(scope="module")
def whole(walk: CentroidalProblem) -> CentroidalPlan:
    return solve(walk)


def rest_of(walk: CentroidalProblem, plan: CentroidalPlan, time_s: float) -> CentroidalProblem:
    there = plan.reference_at(time_s)
    return replace(
        walk,
        sequence=cut_sequence(walk.sequence, time_s, walk.sequence.duration_s),
        com_start_m=there.com_m,
        start=Start(there.com_v_m_s, there.l_nms),
    )


def test_the_rest_of_an_optimal_motion_is_optimal_and_converges_at_once_from_it(
    walk: CentroidalProblem, whole: CentroidalPlan
) -> None:
    for time_s in (0.3, 1.0, 1.5):
        problem = rest_of(walk, whole, time_s)
        start = warm_start_point(whole, problem, time_s)
        warm, cold = solve(problem, start=start), solve(problem)
        assert warm.converged
        assert warm.objective == pytest.approx(cold.objective, abs=1e-3 * abs(cold.objective))
        assert warm.iterations < cold.iterations / 1.5
        tail = np.array([whole.reference_at(time_s + t).com_m for t in warm.time_s])
        assert warm.com_m == pytest.approx(tail, abs=2e-4)


def test_a_solution_moved_by_nothing_is_itself(walk: CentroidalProblem, whole: CentroidalPlan) -> None:
    assert whole.solution is not None
    same = warm_start_point(whole, walk)
    assert same.w == pytest.approx(whole.solution.point.w, abs=1e-9)
    layout_free = np.flatnonzero(same.lambda_w)
    assert same.lambda_w[layout_free] == pytest.approx(whole.solution.point.lambda_w[layout_free])


def test_with_the_whole_motion_in_sight_the_plan_is_carried_out(walk: CentroidalProblem, whole: CentroidalPlan) -> None:
    run = RecedingHorizon(problem=walk, horizon_s=10.0, period_s=0.1).run()
    planned = np.array([whole.reference_at(t).com_m for t in run.time_s])
    assert run.com_m == pytest.approx(planned, abs=5e-4)
    assert not any(r.carried_on for r in run.replans)
    assert all(r.problem.terminal == "rest" for r in run.replans)


def test_a_short_horizon_walks_through_disturbances_to_the_goal(walk: CentroidalProblem) -> None:
    rng = np.random.default_rng(0)

    def pushed(time_s: float, state: State) -> State:
        return replace(state, com_v_m_s=state.com_v_m_s + 0.01 * rng.normal(size=3))

    run = RecedingHorizon(problem=walk, horizon_s=1.5).run(pushed)
    assert not any(r.carried_on for r in run.replans)
    assert all(r.warm for r in run.replans[1:])
    assert {r.problem.terminal for r in run.replans} == {"rest", "capturable"}
    assert run.time_s[-1] == pytest.approx(walk.sequence.duration_s)
    assert run.com_m[-1] == pytest.approx(walk.com_end_m, abs=1e-6)
    assert run.com_v_m_s[-1] == pytest.approx(np.zeros(3), abs=1e-6)
    assert np.diff(run.time_s[:-1]) == pytest.approx(0.1)


def failing(now: Callable[[], bool]) -> Callable[..., CentroidalPlan]:
    def stand_in(problem: CentroidalProblem, *rest: Any) -> CentroidalPlan:
        plan = solve(problem, *rest)
        return replace(plan, converged=not now(), status="made to fail")

    return stand_in


def test_if_a_solve_fails_the_last_plan_is_continued(walk: CentroidalProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [0.0]
    genuine = RecedingHorizon.horizon_problem

    def watched(self: RecedingHorizon, time_s: float, state: State) -> CentroidalProblem:
        now_s[0] = time_s
        return genuine(self, time_s, state)

    monkeypatch.setattr(RecedingHorizon, "horizon_problem", watched)
    monkeypatch.setattr(module, "solve", failing(lambda: 0.25 < now_s[0] < 0.45))
    run = RecedingHorizon(problem=walk, horizon_s=1.5).run()
    carried = [round(r.time_s, 1) for r in run.replans if r.carried_on]
    assert carried == [0.3, 0.4]
    third, fourth = run.replans[3], run.replans[4]
    assert (third.plan, fourth.plan) == (run.replans[2].plan, run.replans[2].plan)
    assert (third.since_s, fourth.since_s) == (pytest.approx(0.1), pytest.approx(0.2))
    assert run.com_m[-1] == pytest.approx(walk.com_end_m, abs=1e-6)


def test_without_any_plan_the_horizon_is_lost(walk: CentroidalProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "solve", failing(lambda: True))
    with pytest.raises(NotEstimable) as refusal:
        RecedingHorizon(problem=walk).run()
    assert refusal.value.code == "horizon-lost"
    assert refusal.value.faults[0].where == "phases[0]"


def test_windows_keep_contacts_and_times() -> None:
    cut = cut_sequence(WALK, 0.5, 2.0)
    assert [p.duration_s for p in cut.phases] == pytest.approx([0.1, 0.8, 0.3, 0.3])
    assert [set(p.contacts) for p in cut.phases] == [set(p.contacts) for p in WALK.phases[:4]]
    assert [p.duration_s for p in cut_sequence(WALK, 0.6, 1.4).phases] == pytest.approx([0.8])
    assert cut_sequence(WALK, 0.0, 99.0).duration_s == pytest.approx(WALK.duration_s)


def test_a_horizon_does_not_end_in_the_air() -> None:
    left, right = foot("left", 0.0), foot("right", 0.0)
    hop = rest_to_rest(sequence(phase(0.6, left, right), phase(0.1), phase(1.6, left, right)))
    state = State(hop.com_start_m, np.zeros(3), np.zeros(3))
    horizon = RecedingHorizon(problem=hop, horizon_s=0.65).horizon_problem(0.0, state)
    assert [p.duration_s for p in horizon.sequence.phases] == pytest.approx([0.6, 0.1, 0.2])
    assert horizon.terminal == "capturable"


@pytest.mark.parametrize("wrong", [{"period_s": 0.0}, {"period_s": 3.0}, {"horizon_s": float("nan")}])
def test_numbers_that_make_no_sense_are_refused(walk: CentroidalProblem, wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInput) as refusal:
        RecedingHorizon(problem=walk, **wrong)
    assert refusal.value.code == "horizon-invalid"


def test_splines_are_refused(walk: CentroidalProblem) -> None:
    with pytest.raises(InvalidInput) as refusal:
        RecedingHorizon(problem=replace(walk, shape="cubic"))
    assert refusal.value.code == "horizon-needs-constants"
