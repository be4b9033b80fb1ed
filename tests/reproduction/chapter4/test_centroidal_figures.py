"""Figures 4.8 and 4.9 and table 4.1, from fewer plans than they take."""

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest.mock import Mock

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.reachability.card import Measure
from stridelab.reproduction.chapter4 import fig_4_8, fig_4_9, numbers, table_4_1
from stridelab.reproduction.studies.thesis_experiments import EXPERIMENTS, WALKERS, experiment_problem
from stridelab.robots.loader import load_robot
from support.recorded_claims import assert_as_recorded


@pytest.fixture(scope="module")
def both() -> tuple[CentroidalPlan, CentroidalPlan]:
    forces, wrench = (fig_4_8.solve_with_control("hrp2", 1, control) for control in fig_4_8.controls_by_name().values())
    return forces, wrench


def test_the_motions_are_as_long_as_the_thesis_says() -> None:
    for robot in WALKERS:
        lengths = [experiment_problem(experiment, robot).sequence.duration_s for experiment in EXPERIMENTS]
        assert lengths == pytest.approx([8.0, 24.0, 36.0], abs=0.5)
        assert {experiment_problem(experiment, robot).rail_friction_share for experiment in EXPERIMENTS} == {1.0}


def test_why_both_controls_have_not_the_same_optimum(both: tuple[CentroidalPlan, CentroidalPlan]) -> None:
    assert both[0].converged
    assert both[1].converged
    rows = [fig_4_8.plan_row("hrp2", 1, name, plan, both[0]) for name, plan in zip(("u_f", "u_c"), both, strict=True)]
    sweep = [
        fig_4_8.plan_row(
            "hrp2",
            1,
            f"alpha {alpha}",
            fig_4_8.solve_with_control("hrp2", 1, ContactWrench("thesis", alpha=alpha)),
            both[0],
        )
        for alpha in (0.3, 1.0)
    ]
    circular = fig_4_8.solve_with_control("hrp2", 1, CircularCones())
    result = {claim.key: claim for claim in fig_4_8.figure_claims(rows, sweep, both, circular)}
    assert result["same_optimum"].verdict == "not_met", "with another cone than the exact one, which is no error"
    assert result["same_optimum"].ours == pytest.approx(both[1].objective - both[0].objective)
    assert result["restriction"].verdict == result["alpha_falls"].verdict == result["u_f_between"].verdict == "beaten"
    assert result["pyramids"].ours == pytest.approx(0.0, abs=0.01)
    assert (result["shape"].outcome, result["noise"].outcome) == ("met", "aim_reached")
    assert result["smoother"].verdict == "not_met"
    assert sweep[0].cone_margin_n > -1e-6 > sweep[1].cone_margin_n
    assert fig_4_8.acceleration_roughness(both[1]) > fig_4_8.acceleration_roughness(both[0])
    columns = fig_4_8.trajectory_columns(both)
    assert columns["wrench_com_x_m"] == pytest.approx(both[1].com_m[:, 0])
    assert {len(column) for column in columns.values()} == {len(both[0].time_s)}


def test_the_cells_of_a_projected_density_add_up_to_one() -> None:
    mixture = experiment_problem(1, "hrp2").proxies["right_foot"].mixture
    flat = fig_4_9.project_mixture(mixture, (0, 2))
    x, y, density = fig_4_9.density_on_grid(flat, mixture.means_m[:, [0, 2]])
    assert density.sum() * (x[1] - x[0]) * (y[1] - y[0]) / (2.0 * np.pi) == pytest.approx(1.0, abs=0.02)


def test_the_density_is_judged_over_the_contact_alone() -> None:
    """Invented paths of four nodes, the last in the air: the gain is a mean, the rare share a share of contact."""

    def path(measure: Measure, case: str, share: list[float], log_density: list[float]) -> fig_4_9.ComPath:
        com_m = np.array([[0.1, 0.0, 0.8]] * 3 + [[np.nan] * 3])
        shares, densities = (np.array([*values, np.nan]) for values in (share, log_density))
        return fig_4_9.ComPath(measure, case, np.arange(4.0), com_m, shares, densities, "native")

    paths = [
        path("uniform", "with", [0.5, 0.2, 0.9], [2.0, 3.0, 4.0]),
        path("uniform", "without", [0.01, 0.04, 0.9], [1.0, 1.0, 4.0]),
        path("conditioned", "with", [0.3, 0.02, 0.03], [1.0, 1.0, 1.0]),
        path("conditioned", "without", [0.3, 0.3, 0.06], [1.5, 1.0, 1.0]),
    ]
    claims = {claim.key: claim for claim in fig_4_9.figure_claims(paths)}
    assert claims["nearer_uniform"].ours == pytest.approx(3.0 - 2.0)
    assert claims["nearer_conditioned"].ours == pytest.approx(-1.0 / 6.0)
    assert (claims["nearer_uniform"].verdict, claims["nearer_conditioned"].verdict) == ("met", "not_met")
    assert claims["infeasible_uniform"].ours == pytest.approx(2.0 / 3.0), "0.05 is rare, the air is no contact"
    assert claims["infeasible_uniform"].verdict == "met"
    assert claims["infeasible_conditioned"].ours == 0.0
    assert claims["infeasible_conditioned"].holds_from == pytest.approx(2.0 / 3.0), "not less than with the density"
    assert claims["usual"].ours == 0.02
    table = fig_4_9.path_table(paths)
    assert table["least_share"].tolist() == [0.2, 0.01, 0.02, 0.06]
    assert_as_recorded("figure 4.9 of invented paths", claims.values())


def test_the_table_has_the_thesis_numbers_beside_ours() -> None:
    printed = {(c.experiment, c.control): (c.time_s, c.iterations) for c in table_4_1.COLUMNS if np.isfinite(c.time_s)}
    assert printed == {(1, "u_c"): (1.23, 22), (1, "u_f"): (3.89, 40), (2, "u_c"): (8.0, 42), (3, "u_c"): (10.0, 15)}
    result = [table_4_1.time_column(column) for column in table_4_1.COLUMNS[:2]]
    assert all(t.plan.converged for t in result)
    columns = table_4_1.time_table(result)
    assert list(columns["plan"]) == ["hrp2 1, u_c", "hrp2 1, u_f"]
    assert set(columns["solver"]) == {"ipopt"}, "like with like"
    assert (columns["seconds"] > 0.0).all()
    assert columns["ms_per_iteration"] == pytest.approx(1e3 * columns["seconds"] / columns["iterations"])


def test_both_controls_are_compared_by_one_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Made-up times: u_c is four times faster by ipopt and slower by the C++ solver, whose rows are its own.

    With forces HRP-2 takes a tenth longer in the first and the third experiment, TALOS in the second.
    """
    monkeypatch.setattr(table_4_1, "REPEATS", 1)
    one, other = (table_4_1.time_column(column) for column in table_4_1.COLUMNS[:2])
    seconds = {("ipopt", "u_c"): 0.05, ("ipopt", "u_f"): 0.2, ("native", "u_c"): 0.003, ("native", "u_f"): 0.002}
    longer = {("hrp2", 1, "u_f"), ("talos", 2, "u_f"), ("hrp2", 3, "u_f")}
    times = [
        replace(one if column.control == "u_c" else other, printed=column, solver=solver,
                time_s=(1.1 if (column.robot, column.experiment, column.control) in longer else 1.0)
                * seconds[solver, column.control])
        for column in table_4_1.COLUMNS for solver in table_4_1.SOLVERS
    ]  # fmt: skip
    claims = {claim.key: claim for claim in table_4_1.time_claims(times)}
    assert claims["u_c_faster_ipopt"].ours == pytest.approx(4.0)
    assert claims["u_c_faster_native"].ours == pytest.approx(2.0 / 3.0)
    assert [claims[f"u_f_{k}"].ours for k in (1, 2, 3)] == pytest.approx([0.22] * 3), "the slower robot"
    assert (claims["u_c_faster_ipopt"].outcome, claims["u_c_faster_native"].outcome) == ("met", "aim_missed"), (
        "the thesis has no solver like the second"
    )
    timed = [claim for key, claim in claims.items() if key.startswith(("time_", "iteration", "u_", "per_second"))]
    assert all(claim.solver in table_4_1.SOLVERS for claim in timed)
    assert_as_recorded("table 4.1 of invented times", [replace(c, n=c.n or 1) for c in claims.values()], timed=True)


def test_times_in_the_text_are_those_of_an_iteration_for_so_many_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Made-up plans: 10 iterations for 20 s of motion in 1 s with the wrench, in 2 s and then 3 s with forces."""
    times_s = iter([1.0, 1.5, 1.2, 3.0, 2.0, 2.5])
    problems: list[CentroidalProblem] = []

    def solve(problem: CentroidalProblem, solver: str) -> SimpleNamespace:
        problems.append(problem)
        assert solver == numbers.SOLVER
        return SimpleNamespace(solve_time_s=next(times_s), iterations=10, time_s=np.array([0.0, 4.0, 20.0]))

    class Horizon:
        def __init__(self, problem: CentroidalProblem, horizon_s: float) -> None:
            assert 2.0 <= horizon_s <= 3.0, "seconds that the thesis names"
            assert problem.sequence.duration_s == pytest.approx(8.0, abs=0.1), "the first experiment"
            assert problem.mass_kg == load_robot("hrp2").mass_kg

        def iterate_replans(self, _: None) -> Iterator[SimpleNamespace]:
            plan = SimpleNamespace(solver="ipopt")
            yield from (SimpleNamespace(plan=plan, took_s=0.1 * k * each, iterations=k)
                        for k, each in enumerate((3.0, 1.0, 0.5, 1.2, 0.8, 1.0), 1))  # fmt: skip

    monkeypatch.setattr(numbers, "solve", solve)
    monkeypatch.setattr(numbers, "RecedingHorizon", Horizon)
    claims = {claim.key: claim for claim in numbers._solve_time_claims()}
    assert [isinstance(problem.control, ContactWrench) for problem in problems] == [True] * 3 + [False] * 3
    assert {problem.mass_kg for problem in problems} == {load_robot("hrp2").mass_kg}
    assert [problem.sequence.duration_s for problem in problems] == pytest.approx([24.0] * 6, abs=0.1), "stairs"
    assert claims["wrench_25_s"].ours == pytest.approx(25.0 * 1.0 / 10 / 20.0), "least of three"
    assert claims["forces_17_s"].ours == pytest.approx(17.0 * 2.0 / 10 / 20.0)
    assert claims["horizon_hz"].ours == pytest.approx(10.0)
    assert_as_recorded("times in the text, invented", claims.values(), timed=True)


def invented_plan(objective: float, com_a_m_s2: list[list[float]], l_nms: list[list[float]], **others: Any) -> Mock:
    """A plan of few numbers."""
    arrays = {"com_a_m_s2": np.array(com_a_m_s2), "l_nms": np.array(l_nms)}
    return Mock(spec=CentroidalPlan, objective=objective, **arrays, **others)


def test_claims_on_controls_take_the_worst_robot_and_the_last_cone() -> None:
    """Three invented pairs: u_c costs 1, 3 and 2 more; the second costs most, the first has the distance."""

    def row(control: str, objective: float, distance_m: float = 0.0, margin_n: float = 0.0) -> fig_4_8.Row:
        return fig_4_8.Row("hrp2", 1, control, "ipopt", objective, 9, margin_n, distance_m)

    rows = [row("u_f", 100.0), row("u_c", 101.0, 0.03), row("u_f", -10.0), row("u_c", -7.0, 0.2),
            row("u_f", 50.0), row("u_c", 52.0, 0.1)]  # fmt: skip
    sweep = [row("alpha 0.2", 140.0), row("alpha 0.3", 120.0), row("alpha 1", 97.0, margin_n=-60.0)]
    forces = invented_plan(100.0, [[0, 0, 0], [1, 2, 0], [1, 2, 3]], [[0, 0.01, 0], [-0.04, 0, 0.02]])
    wrench = invented_plan(101.0, [[0, 0, 0], [0, 1, 0], [0, 1, 1]], [[0, 0, 0], [0, 0, 0.001]])
    circular = invented_plan(99.4, [[0, 0, 0], [0, 0, 0]], [[0, 0, 0]])
    claims = {claim.key: claim for claim in fig_4_8.figure_claims(rows, sweep, (forces, wrench), circular)}
    ours = {key: claim.ours for key, claim in claims.items()}
    assert ours["same_optimum"] == pytest.approx(3.0)
    assert "smallest 1.00" in claims["same_optimum"].note
    assert ours["restriction"] == pytest.approx(1.0)
    assert ours["alpha_falls"] == pytest.approx(20.0), "then 23"
    assert ours["u_f_between"] == pytest.approx(1.0), "not 3"
    assert ours["pyramids"] == pytest.approx(0.6)
    assert (ours["shape"], claims["shape"].holds_to) == (0.03, 0.05)
    assert ours["smoother"] == pytest.approx(((1.0 + 1.0) / 2.0) / ((5.0 + 9.0) / 2.0))
    assert (ours["noise"], claims["noise"].outcome, claims["noise"].holds_to) == (0.04, "aim_reached", 0.05)
    assert "0.001 Nms with u_c" in claims["noise"].note
    assert claims["same_optimum"].holds_to == 0.01
    assert claims["pyramids"].holds_to == 0.5
    assert (claims["same_optimum"].n, claims["restriction"].n, claims["alpha_falls"].n) == (3, 3, 3)
    above = invented_plan(98.0, [[0, 0, 0], [1, 0, 0]], [[0, 0, 0]])
    between = fig_4_8.figure_claims(rows, sweep, (above, wrench), circular)
    assert {claim.key: claim.ours for claim in between}["u_f_between"] == pytest.approx(1.0), "of the outer cone"


class Solved(NamedTuple):
    """What a plan would be solved for."""

    robot: str
    experiment: int
    control: Any
    objective: float = 0.0


def test_the_figure_is_that_of_the_first_experiment_and_six_alphas(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which plans are compared, without solving any: u_f and u_c of both robots, then HRP-2 with the thesis' cone."""
    compared: list[Any] = []

    def plan_row(robot: str, experiment: int, name: str, plan: Solved, of_forces: Solved) -> SimpleNamespace:
        assert (robot, experiment) == plan[:2] == of_forces[:2]
        return SimpleNamespace(case=(robot, experiment, name), plan=plan, of=of_forces, control=name, objective=0.0)

    def figure_claims(*of: object) -> tuple[()]:
        compared.extend(of)
        return ()

    for name, thing in {"solve_with_control": Solved, "plan_row": plan_row, "figure_claims": figure_claims}.items():
        monkeypatch.setattr(fig_4_8, name, thing)
    for name in ("plan_table", "trajectory_columns", "trajectory_panels"):
        monkeypatch.setattr(fig_4_8, name, lambda _: {})
    monkeypatch.setattr(fig_4_8, "render_svg", lambda *_: "")
    fig_4_8.run.run(range(1), lambda _share, _text: None)
    rows, sweep, both, circular = compared
    robots, names = ("hrp2", "talos"), ("u_f", "u_c")
    assert [row.case for row in rows] == [(r, k, name) for r in robots for k in (1, 2, 3) for name in names]
    assert [isinstance(row.plan.control, ContactWrench) for row in rows] == [False, True] * 6
    assert all(not isinstance(row.of.control, ContactWrench) for row in rows)
    assert [row.plan.control.alpha for row in sweep] == [0.2, 0.3, 0.45, 0.6, 0.8, 1.0]
    assert {row.case[:2] for row in sweep} == {("hrp2", 1)}
    assert all(row.of is both[0] for row in sweep)
    assert [plan[:2] for plan in both] == [("hrp2", 1)] * 2
    assert [isinstance(plan.control, ContactWrench) for plan in both] == [False, True]
    assert circular == Solved("hrp2", 1, CircularCones())


def test_times_are_the_least_of_some_plans_in_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Invented times: 3, 1 and 2 s; the longest construction counts, and the last plan."""
    times_s = [(3.0, 0.1), (1.0, 0.3), (2.0, 0.2)]
    plans = [Mock(spec=CentroidalPlan, solve_time_s=solve_s, build_time_s=build_s) for solve_s, build_s in times_s]
    solved: list[tuple[CentroidalProblem, str]] = []

    def solve(problem: CentroidalProblem, solver: str) -> CentroidalPlan:
        solved.append((problem, solver))
        return plans[len(solved) - 1]

    monkeypatch.setattr(table_4_1, "solve", solve)
    timed = table_4_1.time_column(table_4_1.COLUMNS[1], "ipopt")
    assert (timed.time_s, timed.build_s, timed.solver) == (1.0, 0.3, "ipopt")
    assert timed.plan is plans[2]
    assert {solver for _, solver in solved} == {"ipopt"}
    threads: list[int] = []

    def time_column(column: table_4_1.PrintedColumn, solver: str) -> tuple[str, int, str, str]:
        threads.extend(pool["num_threads"] for pool in threadpool_info())
        return column.robot, column.experiment, column.control, solver

    monkeypatch.setattr(table_4_1, "time_column", time_column)
    monkeypatch.setattr(table_4_1, "native_can_solve", lambda problem: isinstance(problem.control, CircularCones))
    monkeypatch.setattr(table_4_1, "time_claims", Mock(side_effect=RuntimeError))
    with pytest.raises(RuntimeError):
        table_4_1.run(range(1), lambda _share, _text: None)
    ((times,), _) = table_4_1.time_claims.call_args  # type: ignore[attr-defined]
    assert threads
    assert set(threads) == {1}, "of one thread"
    expected = [
        (robot, experiment, control, solver)
        for robot in ("hrp2", "talos") for experiment in (1, 2, 3) for control in ("u_c", "u_f")
        for solver in ("ipopt", "native") if solver == "ipopt" or control == "u_f"
    ]  # fmt: skip
    assert times == expected


def test_the_native_solver_has_circular_cones_and_ipopt_pyramids() -> None:
    for solver in table_4_1.SOLVERS:
        for column in table_4_1.COLUMNS[:2]:
            control = table_4_1.problem_of_column(column, solver).control
            assert isinstance(control, ContactWrench) == (column.control == "u_c")
            assert isinstance(control, CircularCones) == (column.control == "u_f" and solver == "native")


def test_a_grid_holds_the_density_and_the_path() -> None:
    """To three standard deviations where the density is alone, 15 cm beyond the path where that goes farther."""
    flat = np.ones(1), np.array([[1.0, 2.0]]), np.array([np.diag([0.1**2, 0.2**2])])
    x, y, density = fig_4_9.density_on_grid(flat, np.array([[1.0, 1.2], [2.0, 2.1]]))
    assert (x[0], x[-1]) == pytest.approx((1.0 - 3.0 * 0.1, 2.0 + 0.15))
    assert (y[0], y[-1]) == pytest.approx((1.2 - 0.15, 2.0 + 3.0 * 0.2))
    assert density.shape == (len(y), len(x))
    assert len(x) % 2 == 1, "the middle is one of the points"
    x, y, _ = fig_4_9.density_on_grid(flat, np.array([[0.0, 2.0], [0.5, 3.0]]))
    assert (x[0], x[-1], y[-1]) == pytest.approx((-0.15, 1.3, 3.15))


def test_all_plans_count_for_gaps_and_convergence() -> None:
    """Invented plans of both solvers: the last but one has the largest gap, another one has not converged."""
    columns = [(column, solver) for column in table_4_1.COLUMNS for solver in table_4_1.SOLVERS]
    gaps = [1e-12] * (len(columns) - 2) + [3e-9, 1e-13]
    times = [
        table_4_1.TimedColumn(
            column, solver,
            Mock(spec=CentroidalPlan, iterations=10, time_s=np.array([0.0, 8.0]), converged=k != 5,
                 verification=SimpleNamespace(dynamics_gap=gap)),
            0.5, 0.1,
        )
        for k, ((column, solver), gap) in enumerate(zip(columns, gaps, strict=True))
    ]  # fmt: skip
    claims = {claim.key: claim for claim in table_4_1.time_claims(times)}
    assert (claims["gap"].ours, claims["gap"].n) == (3e-9, 24)
    assert (claims["converged"].ours, claims["converged"].holds_from) == (23.0, 24.0)
    assert claims["converged"].outcome == "aim_missed"
