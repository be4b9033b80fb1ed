"""Table 4.1: solution times of the optimal control problem, the thesis' and ours.

All problems start cold from the thesis' initial guess, and both controls are compared by the same solver: ipopt, a
general interior point method, and the C++ solver, which uses the structure of the problem and needs circular friction
cones. Times are processor times of one thread including function evaluations. The nonlinear program is built once per
structure (number of phases, nodes and contacts), which has its own column.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.native.availability import native_can_solve
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.conventions import Progress
from stridelab.reproduction.claims import Claim, Column, Measured, Reproduction, above, at_most, reproduces, target
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.reproduction.studies.thesis_experiments import Experiment, experiment_problem

ControlName = Literal["u_c", "u_f"]
TableSolver = Literal["ipopt", "native"]
REPEATS: Final = 3
THESIS_SOLVER: Final = "MUSCOD-II on an i7 at 2.2 GHz"
"""With what, and on what, the thesis' times were measured."""
ITERATIONS_NOTE: Final = "Of an interior point method; the thesis' are those of sequential quadratic programming."
SOLVERS: Final[tuple[TableSolver, ...]] = ("ipopt", "native")
TARGET_TIMES_S: Final[Mapping[Experiment, float]] = {1: 0.5, 2: 1.5, 3: 4.0}
"""Target times in seconds for u_f, by experiment."""


@dataclass(frozen=True)
class PrintedColumn:
    """One column of the thesis' table; NaN for values that are not printed."""

    robot: str
    experiment: Experiment
    control: ControlName
    duration_s: float = np.nan
    time_s: float = np.nan
    iterations: float = np.nan


COLUMNS: Final = (
    PrintedColumn("hrp2", 1, "u_c", 8.0, 1.23, 22.0),
    PrintedColumn("hrp2", 1, "u_f", 8.0, 3.89, 40.0),
    PrintedColumn("hrp2", 2, "u_c", 24.0, 8.0, 42.0),
    PrintedColumn("hrp2", 2, "u_f"),
    PrintedColumn("hrp2", 3, "u_c", 36.0, 10.0, 15.0),
    PrintedColumn("hrp2", 3, "u_f"),
    PrintedColumn("talos", 1, "u_c"),
    PrintedColumn("talos", 1, "u_f"),
    PrintedColumn("talos", 2, "u_c"),
    PrintedColumn("talos", 2, "u_f"),
    PrintedColumn("talos", 3, "u_c"),
    PrintedColumn("talos", 3, "u_f"),
)
"""Columns of the thesis' table, and the combinations that it omits."""


@dataclass(frozen=True, eq=False)
class TimedColumn:
    """A column with our plan by one solver, its minimum time over some repeats, and the time to build the program."""

    printed: PrintedColumn
    solver: TableSolver
    plan: CentroidalPlan
    time_s: float
    build_s: float


@reproduces("table-4.1", "Solution times of the optimal control problem", printed=("times",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Minimum of ``REPEATS`` times."""
    times = []
    cases = [(column, solver) for column in COLUMNS for solver in SOLVERS]
    with threadpool_limits(1):
        for number, (column, solver) in enumerate(cases):
            tell(number / len(cases), f"{column_label(column)}, {solver}")
            if solver == "ipopt" or native_can_solve(problem_of_column(column, solver)):
                times.append(time_column(column, solver))
    return Reproduction(
        claims=time_claims(times),
        note="Processor time of one thread of this machine, compared with the thesis' on an i7 at 2.2 GHz with "
        "MUSCOD-II; ours is the minimum of three. Times are those of the solver alone (the table has the time "
        "to build the program). Iterations of an interior point method are none of sequential quadratic programming. "
        "Forces constant over 0.1 s; u_f in pyramids of eight rays (ipopt) or "
        "circular cones (native, the C++ solver), u_c in the largest Lorentz cone inside the soles' wrench cone. Both "
        "controls are compared by the same solver, which every row names. The last two rows of the table, the shares "
        "of the QP and of the sensitivities, have no counterpart: an interior point method has no QP subproblem and "
        "uses analytical derivatives.",
        tables={"times": time_table(times)},
        drawing=render_svg(
            Bars(
                "time of the solver",
                "ms",
                [
                    (f"{column_label(t.printed)}, {t.solver}", 1e3 * t.time_s)
                    for t in times
                    if t.printed.robot == "hrp2"
                ],
            )
        ),
    )


def problem_of_column(column: PrintedColumn, solver: TableSolver) -> CentroidalProblem:
    """The problem of a column in the form that the solver takes: the C++ solver has no pyramids."""
    problem = experiment_problem(column.experiment, column.robot)
    if column.control == "u_c":
        return replace(problem, control=ContactWrench())
    return replace(problem, control=CircularCones()) if solver == "native" else problem


def time_column(column: PrintedColumn, solver: TableSolver = "ipopt") -> TimedColumn:
    """Solve the problem of a column ``REPEATS`` times."""
    plans = [solve(problem_of_column(column, solver), solver) for _ in range(REPEATS)]
    return TimedColumn(
        column, solver, plans[-1], min(plan.solve_time_s for plan in plans), max(plan.build_time_s for plan in plans)
    )


def time_claims(times: list[TimedColumn]) -> tuple[Claim, ...]:
    """Claims on the thesis' times, which are those of another solver on another machine, then our targets."""
    made: list[Claim] = []
    every = times
    times = [t for t in every if t.solver == "ipopt"]
    for t in times:
        column = t.printed
        if np.isfinite(column.time_s):
            key = f"time_{column.experiment}_{column.control}"
            says = f"experiment {column.experiment} with {column.control}: time of the solver"
            holds = at_most(column.time_s, "thesis", better_than=column.time_s)
            made.append(
                Measured(key, column.time_s, t.time_s, "s", holds).says(
                    says, solver="ipopt", comparator=THESIS_SOLVER, no_interval="machine_time"
                )
            )
            made += _iteration_claims(t)
    gains = [t.printed.time_s / t.time_s for t in times if np.isfinite(t.printed.time_s) and t.printed.control == "u_c"]
    of = {(t.printed.robot, t.printed.experiment, t.printed.control): t for t in times}
    per_second = [1e3 * t.time_s / t.plan.iterations / t.plan.time_s[-1] for t in times]
    most = max(t.plan.verification.dynamics_gap for t in every)
    return (
        *made,
        *(_faster_claim(s, of_solver) for s in SOLVERS if (of_solver := [t for t in every if t.solver == s])),
        Measured("per_second", 7e-3, max(per_second) / 1e3, "s", at_most(15e-3, "thesis", better_than=7e-3)).says(
            "one iteration for one second of motion takes 7 to 15 ms",
            "Largest value of all columns.",
            solver="ipopt",
            comparator=THESIS_SOLVER,
            no_interval="machine_time",
        ),
        target("converged", float(sum(t.plan.converged for t in every)), "1", at_least=float(len(every))).says(
            "number of converged plans", n=len(every)
        ),
        target("u_c_gain", min(gains), "1", at_least=10.0).says(
            "u_c: the thesis' time over ours, minimum of three experiments",
            n=len(gains),
            solver="ipopt",
            comparator=THESIS_SOLVER,
            no_interval="machine_time",
        ),
        *(
            target(
                f"u_f_{experiment}",
                max(of[robot, experiment, "u_f"].time_s for robot in ("hrp2", "talos")),
                "s",
                at_most=limit_s,
            ).says(
                f"u_f, experiment {experiment}: time of the solver, the slower robot",
                n=2,
                solver="ipopt",
                no_interval="machine_time",
            )
            for experiment, limit_s in TARGET_TIMES_S.items()
        ),
        target("gap", most, "1", at_most=1e-8).says("largest gap of the dynamics", n=len(every)),
    )


def _faster_claim(solver: TableSolver, times: list[TimedColumn]) -> Claim:
    """Claim that u_c is faster than u_f, both by the same solver."""
    of = {(t.printed.robot, t.printed.experiment, t.printed.control): t.time_s for t in times}
    ratios = [time_s / of[robot, number, "u_c"] for (robot, number, name), time_s in of.items() if name == "u_f"]
    least = min(ratios)
    numbers = Measured(f"u_c_faster_{solver}", "> 1", least, "1", above(1.0, "words"))
    if solver == "native":  # the thesis has no such solver
        numbers = target(f"u_c_faster_{solver}", least, "1", at_least=1.0)
    return numbers.says(
        f"for any investigated scenario the wrench is much faster than the forces ({solver})",
        f"Smallest time ratio, u_f over u_c; the largest is {max(ratios):.2f}."
        + ("" if solver == "ipopt" else " A solver that uses the structure has little to save with u_c."),
        n=len(ratios),
        solver=solver,
        comparator="u_f by the same solver",
        no_interval="machine_time",
    )


def _iteration_claims(t: TimedColumn) -> tuple[Claim, Claim]:
    """Claims on the number of iterations and on the time per iteration."""
    column, n = t.printed, t.plan.iterations
    of = f"experiment {column.experiment} with {column.control}"
    key, each_s, printed_s = f"{column.experiment}_{column.control}", t.time_s / n, column.time_s / column.iterations
    return (
        Measured(
            f"iterations_{key}",
            column.iterations,
            float(n),
            "1",
            at_most(column.iterations, "thesis", better_than=column.iterations),
        ).says(f"{of}: iterations", ITERATIONS_NOTE, solver=t.solver, comparator=THESIS_SOLVER),
        Measured(
            f"iteration_{key}_s", printed_s, each_s, "s", at_most(printed_s, "thesis", better_than=printed_s)
        ).says(
            f"{of}: time of an iteration",
            f"{column.time_s:g} s in {column.iterations:g}.",
            solver=t.solver,
            comparator=THESIS_SOLVER,
            no_interval="machine_time",
        ),
    )


def column_label(column: PrintedColumn) -> str:
    """Label of a column in the drawing and the table."""
    return f"{column.robot} {column.experiment}, {column.control}"


def time_table(times: list[TimedColumn]) -> Mapping[str, Column]:
    """One row per column of the thesis' table."""
    return {
        "plan": np.array([column_label(t.printed) for t in times]),
        "solver": np.array([t.plan.solver for t in times]),
        "thesis_motion_seconds": np.array([t.printed.duration_s for t in times]),
        "motion_seconds": np.array([t.plan.time_s[-1] for t in times]),
        "thesis_seconds": np.array([t.printed.time_s for t in times]),
        "seconds": np.array([t.time_s for t in times]),
        "build_seconds": np.array([t.build_s for t in times]),
        "thesis_iterations": np.array([t.printed.iterations for t in times]),
        "iterations": np.array([t.plan.iterations for t in times]),
        "ms_per_iteration": np.array([1e3 * t.time_s / t.plan.iterations for t in times]),
        "objective": np.array([t.plan.objective for t in times]),
        "cone_margin_n": np.array([t.plan.verification.cone_margin_n for t in times]),
    }
