"""The C++ solver against CasADi's on the same problems, and its refusals."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from experiments.centroidal_variations import problem_of, random_variations
from stridelab.centroidal.boundary_conditions import PathBounds, Start
from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.infeasibility.elastic_lp import is_feasible
from stridelab.centroidal.native.availability import NativeUnavailable, native_availability, unsupported_features
from stridelab.centroidal.native.problem_arrays import native_input
from stridelab.centroidal.nlp.kkt import NativePoint
from stridelab.centroidal.point_forces import CircularCones, Pyramids
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.receding_horizon import RecedingHorizon, State
from stridelab.centroidal.solver import solve
from stridelab.centroidal.warm_start import warm_start_point
from stridelab.errors import InvalidInput
from support.robots.sequences import assert_same, bundled, foot, hand, phase, rest_to_rest, sequence, total, two_steps

availability = native_availability()
if isinstance(availability, NativeUnavailable):
    pytest.skip(f"no native solver: {availability.reason}", allow_module_level=True)

CONES = CircularCones()

OF_EVERY_KIND: tuple[dict[str, Any], ...] = (
    {"terminal": "capturable"},
    {"terminal": "moving", "end": Start(np.array([0.1, 0.02, -0.01]), np.array([0.2, -1.0, 0.1]))},
    {"bounds": PathBounds(com_height_m=(0.80, 0.864))},
    {"bounds": PathBounds(normal_force_max_n={"right_hand": 15.0, "left_foot": 400.0})},
    {"start": Start(np.array([0.1, 0.02, 0.0]), np.array([0.0, 1.0, 0.0]))},
    {"node_rate_hz": 20.0},
)


@pytest.mark.parametrize("scenario", ["flat-walk", "long-stride", "six-stairs"])
def test_finds_the_optimum_of_the_experiments(scenario: str) -> None:
    plan = assert_same(bundled(scenario, control=CONES))
    assert plan.solver == "native"
    assert plan.iterations <= 20


@pytest.mark.parametrize("settings", OF_EVERY_KIND, ids=str)
def test_finds_the_optimum_with_a_hand_and_of_every_kind(problem: CentroidalProblem, settings: dict[str, Any]) -> None:
    assert_same(replace(problem, control=CONES, **settings))


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"terminal": "capturable"},
        {"bounds": PathBounds(com_height_m=(0.80, 0.864))},
        {"control": ContactWrench(cone="thesis", contacts="all")},
    ],
    ids=str,
)
def test_finds_the_optimum_of_the_wrench(problem: CentroidalProblem, settings: dict[str, Any]) -> None:
    assert_same(replace(problem, **{"control": ContactWrench(), **settings}))


@pytest.mark.parametrize("scenario", ["flat-walk", "stairs-with-rail"])
def test_finds_the_optimum_of_the_wrench_in_the_experiments(scenario: str) -> None:
    plan = solve(bundled(scenario, control=ContactWrench()), "native")
    assert plan.converged, plan.status
    assert plan.solution is not None
    # The wrench has no effort: what the forces that share it cost is not in the objective.
    assert plan.solution.attempts[-1].log.objective[-1] == pytest.approx(plan.objective, rel=1e-8)


def test_the_bounds_hold(problem: CentroidalProblem) -> None:
    plan = solve(replace(problem, control=CONES, bounds=PathBounds(None, {"left_foot": 300.0})), "native")
    assert plan.converged
    assert plan.forces_n["left_foot"][..., 2].max() <= 300.0 + 1e-3


def test_its_cost_is_that_of_the_plan() -> None:
    """Of which the log-densities are those of the mixtures, by another code."""
    problem = bundled("stairs-with-rail", control=CONES)
    plan = solve(problem, "native")
    assert plan.solution is not None
    assert plan.solution.attempts[-1].log.objective[-1] == pytest.approx(total(plan), rel=1e-10)


@pytest.mark.parametrize("number", range(12))
def test_random_variations_converge_cold(number: int) -> None:
    problem = replace(problem_of(random_variations(12, seed=5)[number]), control=CONES)
    plan = solve(problem, "native")
    assert plan.converged, plan.status
    assert plan.iterations <= 25


def test_a_hundred_metres_away_the_plan_is_the_same() -> None:
    walk = two_steps()
    shift = np.array([100.0, -100.0, 3.0])

    def moved(contact: Any) -> Any:
        return replace(contact, placement=replace(contact.placement, position_m=contact.placement.position_m + shift))

    phases = tuple(replace(p, contacts={n: moved(c) for n, c in p.contacts.items()}) for p in walk.phases)
    here = solve(rest_to_rest(walk, control=CONES), "native")
    there = solve(rest_to_rest(replace(walk, phases=phases), control=CONES), "native")
    assert there.com_m == pytest.approx(here.com_m + shift, abs=1e-7)


def test_repeated_solves_agree_to_the_last_bit(problem: CentroidalProblem) -> None:
    one, two = (solve(replace(problem, control=CONES), "native") for _ in range(2))
    assert np.array_equal(one.com_m, two.com_m)
    assert np.array_equal(one.forces_n["right_hand"], two.forces_n["right_hand"])


def test_flight_is_legal() -> None:
    left, right = foot("left", 0.0), foot("right", 0.0)
    hop = sequence(phase(0.7, left, right), phase(0.2), phase(1.0, left, right))
    assert_same(rest_to_rest(hop, control=CONES))


def test_an_infeasible_problem_is_reported_with_its_phase() -> None:
    near = phase(0.05, foot("left", 0.0), foot("right", 0.0))
    far = phase(0.05, foot("left", 1.0), foot("right", 1.0))
    plan = solve(rest_to_rest(sequence(near, far), control=CONES), "auto")
    assert not plan.converged
    assert plan.solver == "native"  # proved infeasible: no other solver is called
    assert "infeasible" in plan.status
    assert "phase 2" in plan.status


def captured_after(push_m_s: tuple[float, float, float], control: Control = CONES) -> CentroidalProblem:
    """Two steps' first 0.6 s, to be captured, from a push."""
    walk = RecedingHorizon(problem=rest_to_rest(two_steps(), control=control), horizon_s=0.6)
    state = State(walk.problem.com_start_m, np.array(push_m_s), np.zeros(3))
    return walk.horizon_problem(0.0, state)


@pytest.mark.parametrize("push_m_s", [(2.5, 0.0, 0.0), (-1.8, -1.8, 0.0)], ids=str)
@pytest.mark.parametrize("control", [CONES, ContactWrench()], ids=["forces", "wrench"])
def test_a_push_that_cannot_be_captured_is_proved_infeasible(
    push_m_s: tuple[float, float, float], control: Control
) -> None:
    pushed = captured_after(push_m_s, control)
    assert pushed.terminal == "capturable"
    plan = solve(pushed, "native")
    assert "infeasible" in plan.status
    assert not is_feasible(replace(pushed, control=Pyramids()))


def test_a_push_that_can_be_captured_is_not_called_infeasible() -> None:
    rng = np.random.default_rng(0)
    proved = agreed = 0
    for _ in range(20):
        x, y, z = rng.uniform(-1.5, 1.5, 3).tolist()
        pushed = captured_after((x, y, z))
        plan = solve(pushed, "native")
        possible = is_feasible(replace(pushed, control=Pyramids()))  # momentum aside, in smaller cones
        proved += "infeasible" in plan.status
        agreed += "infeasible" in plan.status and not possible
        assert possible or not plan.converged
        if "infeasible" in plan.status and possible:
            assert not solve(pushed, "ipopt").converged
    assert proved > 5
    assert agreed > 3


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"control": Pyramids()}, "pyramids"),
        ({"control": CONES, "placements": FreePlacements(), "shape": "cubic"}, "placements and continuous forces"),
        ({"control": CONES, "placements": FreePlacements(), "durations": FreeDurations()}, "placements and durations"),
    ],
    ids=str,
)
def test_unsupported_options_are_refused_by_name_and_left_to_casadi(
    problem: CentroidalProblem, settings: dict[str, Any], named: str
) -> None:
    changed = replace(problem, **settings)
    assert named in (unsupported_features(changed) or "")
    with pytest.raises(InvalidInput) as refused:
        solve(changed, "native")
    assert refused.value.code == "solver-lacks"
    assert named in refused.value.message


def test_auto_uses_casadi_for_unsupported_options(problem: CentroidalProblem) -> None:
    assert solve(problem).solver == "ipopt"
    assert solve(replace(problem, control=CONES)).solver == "native"


SPLINES: dict[str, Any] = {"control": CONES, "shape": "cubic"}


@pytest.mark.parametrize("scenario", ["flat-walk", "long-stride", "six-stairs"])
def test_finds_the_splines_of_the_experiments(scenario: str) -> None:
    plan = assert_same(bundled(scenario, **SPLINES))
    assert plan.iterations <= 25
    for curve in plan.curves_n.values():
        assert curve[1:, 0] == pytest.approx(curve[:-1, 3], abs=1e-9)  # no force jumps


@pytest.mark.parametrize("settings", OF_EVERY_KIND, ids=str)
def test_finds_splines_with_a_hand_and_of_every_kind(problem: CentroidalProblem, settings: dict[str, Any]) -> None:
    assert_same(replace(problem, **SPLINES, **settings))


def test_splines_of_intervals_of_different_lengths() -> None:
    left, right, ahead = foot("left", 0.0), foot("right", 0.0), foot("right", 0.25)
    uneven = sequence(phase(0.53, left, right), phase(0.77, left), phase(0.61, left, ahead))
    assert_same(rest_to_rest(uneven, **SPLINES))


def test_infeasible_splines_are_reported() -> None:
    near = phase(0.05, foot("left", 0.0), foot("right", 0.0))
    far = phase(0.05, foot("left", 1.0), foot("right", 1.0))
    plan = solve(rest_to_rest(sequence(near, far), **SPLINES), "native")
    assert not plan.converged
    assert "infeasible" in plan.status


def test_splines_start_from_other_plans(problem: CentroidalProblem) -> None:
    splines = replace(problem, **SPLINES)
    cold = solve(splines, "native")
    warm = solve(splines, "native", start=warm_start_point(cold, splines))
    assert warm.converged
    assert warm.iterations < cold.iterations
    steps = solve(replace(problem, control=CONES), "native")
    assert solve(splines, "native", start=warm_start_point(steps, splines)).converged
    stepped = replace(splines, shape="constant")
    assert solve(stepped, "native", start=warm_start_point(cold, stepped)).converged


def test_a_start_near_the_solution_is_worth_iterations(problem: CentroidalProblem) -> None:
    with_cones = replace(problem, control=CONES)
    cold = solve(with_cones, "native")
    start = warm_start_point(cold, with_cones)
    assert isinstance(start, NativePoint)
    warm = solve(with_cones, "native", start=start)
    assert warm.converged
    assert warm.iterations < cold.iterations
    assert total(warm) == pytest.approx(total(cold), rel=1e-6)
    with_wrench = replace(with_cones, control=ContactWrench())
    wrenches = solve(with_wrench, "native")
    again = solve(with_wrench, "native", start=warm_start_point(wrenches, with_wrench))
    assert again.converged
    assert again.iterations < wrenches.iterations
    finer = replace(with_cones, node_rate_hz=20.0)
    assert solve(finer, "native", start=start).converged  # it does not fit, and counts for nothing


def test_a_horizon_recovers_from_a_push() -> None:
    problem = rest_to_rest(two_steps(), control=CONES)

    def push(time_s: float, state: State) -> State:
        shove = np.array([0.05, 0.03, 0.0]) if abs(time_s - 1.0) < 1e-9 else np.zeros(3)
        return replace(state, com_v_m_s=state.com_v_m_s + shove)

    availability = RecedingHorizon(problem=problem, horizon_s=1.6).run(push)
    assert all(r.plan.solver == "native" and not r.carried_on for r in availability.replans)
    assert availability.com_m[-1] == pytest.approx(problem.com_end_m, abs=1e-6)


def test_iterations_are_reported(problem: CentroidalProblem) -> None:
    iterations: list[int] = []
    plan = solve(replace(problem, control=CONES), "native", on_iteration=lambda at: iterations.append(at.number))
    assert iterations == list(range(plan.iterations + 1))


@pytest.mark.parametrize(
    ("index", "worse", "says"),
    [
        (1, lambda start: np.full(9, np.nan), "start"),
        (1, lambda start: start[:5], "nine"),
        (4, lambda of: of + 100, "density"),
        (5, lambda place: place[:1], "place"),
        (7, lambda axes: axes + np.inf, "frames"),
        (9, lambda count: count * 0, "one to four"),
        (12, lambda layout: layout + 1000, "exist"),
        (12, lambda layout: -layout, "time"),
        (13, lambda step: step * np.nan, "intervals"),
        (16, lambda planes: np.zeros((2, 3)), "planes"),
    ],
)
def test_invalid_numbers_raise(problem: CentroidalProblem, index: int, worse: Any, says: str) -> None:
    assert not isinstance(availability, NativeUnavailable)
    arguments = native_input(replace(problem, control=CONES)).module_arguments()
    arguments[index] = np.ascontiguousarray(worse(arguments[index]))
    with pytest.raises(ValueError, match=says):
        availability.module.problem(*arguments)


def test_a_mixture_that_is_singular_raises(problem: CentroidalProblem) -> None:
    assert not isinstance(availability, NativeUnavailable)
    arguments = native_input(replace(problem, control=CONES)).module_arguments()
    mixtures: Any = arguments[3]
    constants, means, whitenings = mixtures[0]
    arguments[3] = [(constants, means, whitenings + np.inf), *mixtures[1:]]
    with pytest.raises(ValueError, match="whitenings"):
        availability.module.problem(*arguments)


def test_a_hand_alone_holds_what_it_can() -> None:
    """One point cannot turn the body: its wrenches have three dimensions."""
    left, right = foot("left", 0.0), foot("right", 0.0)
    swing = sequence(phase(0.7, left, right), phase(0.3, hand(0.1, 0.9)), phase(1.0, left, right))
    assert solve(rest_to_rest(swing, control=CONES), "native").converged
