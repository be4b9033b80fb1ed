"""Table 4.1: solution times of the optimal control problem, the thesis' and ours.

All problems start cold from the thesis' initial guess; times are processor times of one thread including function
evaluations. The nonlinear program is built once per structure (number of phases, nodes and contacts), which has its own
column.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.solver import solve
from stridelab.conventions import Progress
from stridelab.reproduction.claims import Claim, Column, Measured, Reproduction, met_if, reproduces, target
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.studies.thesis_experiments import Experiment, experiment_problem

ControlName = Literal["u_c", "u_f"]
REPEATS: Final = 3
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
    """A column with our plan, the minimum solver time over some repeats, and the time of building the program."""

    printed: PrintedColumn
    plan: CentroidalPlan
    time_s: float
    build_s: float


@reproduces("table-4.1", "Solution times of the optimal control problem", printed=("times",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Minimum of ``REPEATS`` times."""
    times = []
    with threadpool_limits(1):
        for number, column in enumerate(COLUMNS):
            tell(number / len(COLUMNS), f"{column.robot}, experiment {column.experiment}, {column.control}")
            times.append(time_column(column))
    return Reproduction(
        claims=time_claims(times),
        note="Processor time of one thread of this machine, compared with the thesis' on an i7 at 2.2 GHz with "
        "MUSCOD-II; ours is the minimum of three. Forces constant over 0.1 s; u_f in pyramids of eight rays, u_c in "
        "the largest Lorentz cone inside the soles' wrench cone. The last two rows of the table, the shares of the QP "
        "and of the sensitivities, have no counterpart: an interior point method has no QP subproblem and uses "
        "analytical derivatives.",
        tables={"times": time_table(times)},
        drawing=render_svg(
            Bars("time of the solver", "ms", [(column_label(t.printed), 1e3 * t.time_s) for t in times])
        ),
    )


def time_column(column: PrintedColumn) -> TimedColumn:
    """Solve the problem of a column ``REPEATS`` times."""
    of_column = experiment_problem(column.experiment, column.robot)
    if column.control == "u_c":
        of_column = replace(of_column, control=ContactWrench())
    plans = [solve(of_column) for _ in range(REPEATS)]
    return TimedColumn(
        column, plans[-1], min(plan.solve_time_s for plan in plans), max(plan.build_time_s for plan in plans)
    )


def time_claims(times: list[TimedColumn]) -> tuple[Claim, ...]:
    """Claims on the thesis' times, then our targets."""
    made: list[Claim] = []
    for t in times:
        column = t.printed
        if np.isfinite(column.time_s):
            key = f"time_{column.experiment}_{column.control}"
            says = f"experiment {column.experiment} with {column.control}: time of the solver"
            verdict = "beaten" if t.time_s < column.time_s else met_if(t.time_s <= column.time_s)
            made.append(Measured(key, column.time_s, t.time_s, "s", verdict).says(says))
            made += _iteration_claims(t)
    gains = [t.printed.time_s / t.time_s for t in times if np.isfinite(t.printed.time_s) and t.printed.control == "u_c"]
    of = {(t.printed.robot, t.printed.experiment, t.printed.control): t for t in times}
    slower = [of[r, e, "u_f"].time_s / of[r, e, "u_c"].time_s for r, e, c in of if c == "u_c"]
    per_second = [1e3 * t.time_s / t.plan.iterations / t.plan.time_s[-1] for t in times]
    most = max(t.plan.verification.dynamics_gap for t in times)
    return (
        *made,
        Measured("u_c_faster", "> 1", min(slower), "1", met_if(min(slower) > 1.0)).says(
            "for any investigated scenario the wrench is much faster than the forces",
            "Smallest time ratio, u_f over u_c.",
        ),
        Measured("per_second", 7e-3, max(per_second) / 1e3, "s", "beaten" if max(per_second) < 7.0 else "not_met").says(
            "one iteration for one second of motion takes 7 to 15 ms", "Largest value of all columns."
        ),
        target("converged", float(sum(t.plan.converged for t in times)), "1", at_least=float(len(times))).says(
            "number of converged plans"
        ),
        target("u_c_gain", min(gains), "1", at_least=10.0).says(
            "u_c: the thesis' time over ours, minimum of three experiments"
        ),
        *(
            target(
                f"u_f_{experiment}",
                max(of[robot, experiment, "u_f"].time_s for robot in ("hrp2", "talos")),
                "s",
                at_most=limit_s,
            ).says(f"u_f, experiment {experiment}: time of the solver, the slower robot")
            for experiment, limit_s in TARGET_TIMES_S.items()
        ),
        target("gap", most, "1", at_most=1e-8).says("largest gap of the dynamics"),
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
            "beaten" if n < column.iterations else met_if(float(n) <= column.iterations),
        ).says(f"{of}: iterations"),
        Measured(f"iteration_{key}_s", printed_s, each_s, "s", "beaten" if each_s < printed_s else "not_met").says(
            f"{of}: time of an iteration", f"{column.time_s:g} s in {column.iterations:g}."
        ),
    )


def column_label(column: PrintedColumn) -> str:
    """Label of a column in the drawing and the table."""
    return f"{column.robot} {column.experiment}, {column.control}"


def time_table(times: list[TimedColumn]) -> Mapping[str, Column]:
    """One row per column of the thesis' table."""
    return {
        "plan": np.array([column_label(t.printed) for t in times]),
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
