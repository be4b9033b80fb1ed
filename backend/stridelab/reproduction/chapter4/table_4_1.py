"""Table 4.1: how long the optimal control problem takes, the thesis' column beside ours.

All from the thesis' own cold start; processor time of one thread, solver with its function evaluations. Building the
programme is needed once per structure (number of phases, nodes and contacts) and stands in a column of its own.
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
from stridelab.reproduction.claims import Claim, Column, Item, Reproduction, aimed, judged
from stridelab.reproduction.report.svg_plots import Bars, svg
from stridelab.studies.thesis_experiments import Experiment, problem

ControlName = Literal["u_c", "u_f"]
REPEATS: Final = 3
AIMS: Final[Mapping[Experiment, float]] = {1: 0.5, 2: 1.5, 3: 4.0}
"""Seconds for u_f, by experiment."""


@dataclass(frozen=True)
class Printed:
    """One column of the thesis' table; NaN where it prints none."""

    robot: str
    experiment: Experiment
    control: ControlName
    duration_s: float = np.nan
    time_s: float = np.nan
    iterations: float = np.nan


COLUMNS: Final = (
    Printed("hrp2", 1, "u_c", 8.0, 1.23, 22.0),
    Printed("hrp2", 1, "u_f", 8.0, 3.89, 40.0),
    Printed("hrp2", 2, "u_c", 24.0, 8.0, 42.0),
    Printed("hrp2", 2, "u_f"),
    Printed("hrp2", 3, "u_c", 36.0, 10.0, 15.0),
    Printed("hrp2", 3, "u_f"),
    Printed("talos", 1, "u_c"),
    Printed("talos", 1, "u_f"),
    Printed("talos", 2, "u_c"),
    Printed("talos", 2, "u_f"),
    Printed("talos", 3, "u_c"),
    Printed("talos", 3, "u_f"),
)
"""Those of the thesis, and what it leaves out."""


@dataclass(frozen=True, eq=False)
class Timed:
    """A column with our plan, the least time of some repeats, and what building took the first time."""

    printed: Printed
    plan: CentroidalPlan
    time_s: float
    build_s: float


def run(seeds: int, tell: Progress) -> Reproduction:
    """The least of ``REPEATS`` times, whatever ``seeds``."""
    found = []
    with threadpool_limits(1):
        for number, column in enumerate(COLUMNS):
            tell(number / len(COLUMNS), f"{column.robot}, experiment {column.experiment}, {column.control}")
            found.append(timed(column))
    tell(1.0, "done")
    return Reproduction(
        claims=claims(found),
        note="Processor seconds of one thread of this machine, beside the thesis' on an i7 at 2.2 GHz with MUSCOD-II; "
        "ours is the least of three. Forces constant over tenths of a second; u_f in pyramids of eight rays, u_c in "
        "the largest Lorentz cone inside the soles' wrench cone. The table's last two rows, the shares of the QP and "
        "of the sensitivities, have no counterpart: an interior point method has no QP, its derivatives are formulas.",
        tables={"times": table(found)},
        drawing=svg([Bars("time of the solver", "ms", [(name(t.printed), 1e3 * t.time_s) for t in found])]),
    )


def timed(column: Printed) -> Timed:
    """Plan it a few times."""
    asked = problem(column.experiment, column.robot)
    if column.control == "u_c":
        asked = replace(asked, control=ContactWrench())
    plans = [solve(asked) for _ in range(REPEATS)]
    return Timed(column, plans[-1], min(plan.solve_time_s for plan in plans), max(plan.build_time_s for plan in plans))


def claims(found: list[Timed]) -> tuple[Claim, ...]:
    """The thesis' times, then our aims."""
    made: list[Claim] = []
    for t in found:
        column = t.printed
        if np.isfinite(column.time_s):
            key = f"time_{column.experiment}_{column.control}"
            says = f"experiment {column.experiment} with {column.control}: time of the solver"
            verdict = "beaten" if t.time_s < column.time_s else judged(t.time_s, at_most=column.time_s)
            made.append(Claim(key, says, column.time_s, t.time_s, "s", verdict))
            made += _iterations(t)
    gains = [t.printed.time_s / t.time_s for t in found if np.isfinite(t.printed.time_s) and t.printed.control == "u_c"]
    of = {(t.printed.robot, t.printed.experiment, t.printed.control): t for t in found}
    slower = [of[r, e, "u_f"].time_s / of[r, e, "u_c"].time_s for r, e, c in of if c == "u_c"]
    per_second = [1e3 * t.time_s / t.plan.iterations / t.plan.time_s[-1] for t in found]
    most = max(t.plan.verification.dynamics_gap for t in found)
    return (
        *made,
        Claim("u_c_faster", "for any investigated scenario the wrench is largely faster than the forces", "> 1",
              min(slower), "1", "met" if min(slower) > 1.0 else "not_met", "Least ratio of the times, u_f over u_c."),
        Claim("per_second", "one iteration for one second of motion takes 7 to 15 ms", 7e-3, max(per_second) / 1e3, "s",
              "beaten" if max(per_second) < 7.0 else "not_met", "Largest of all columns."),
        aimed("converged", "plans that converge", float(sum(t.plan.converged for t in found)), "1",
              at_least=float(len(found))),
        aimed("u_c_gain", "u_c: the thesis' time over ours, least of three experiments", min(gains), "1",
              at_least=10.0),
        *(
            aimed(f"u_f_{experiment}", f"u_f, experiment {experiment}: time of the solver, the slower robot",
                  max(of[robot, experiment, "u_f"].time_s for robot in ("hrp2", "talos")), "s", at_most=limit_s)
            for experiment, limit_s in AIMS.items()
        ),
        aimed("gap", "largest gap of the dynamics", most, "1", at_most=1e-8),
    )  # fmt: skip


def _iterations(t: Timed) -> tuple[Claim, Claim]:
    """How many there are, and how long one takes."""
    column, n = t.printed, t.plan.iterations
    of = f"experiment {column.experiment} with {column.control}"
    key, each_s, printed_s = f"{column.experiment}_{column.control}", t.time_s / n, column.time_s / column.iterations
    return (
        Claim(f"iterations_{key}", f"{of}: iterations", column.iterations, float(n), "1",
              "beaten" if n < column.iterations else judged(float(n), at_most=column.iterations)),
        Claim(f"iteration_{key}_s", f"{of}: time of an iteration", printed_s, each_s, "s",
              "beaten" if each_s < printed_s else "not_met", f"{column.time_s:g} s in {column.iterations:g}."),
    )  # fmt: skip


def name(column: Printed) -> str:
    """For bars and rows."""
    return f"{column.robot} {column.experiment}, {column.control}"


def table(found: list[Timed]) -> Mapping[str, Column]:
    """One row per column of the thesis' table."""
    return {
        "plan": np.array([name(t.printed) for t in found]),
        "thesis_motion_seconds": np.array([t.printed.duration_s for t in found]),
        "motion_seconds": np.array([t.plan.time_s[-1] for t in found]),
        "thesis_seconds": np.array([t.printed.time_s for t in found]),
        "seconds": np.array([t.time_s for t in found]),
        "build_seconds": np.array([t.build_s for t in found]),
        "thesis_iterations": np.array([t.printed.iterations for t in found]),
        "iterations": np.array([t.plan.iterations for t in found]),
        "ms_per_iteration": np.array([1e3 * t.time_s / t.plan.iterations for t in found]),
        "objective": np.array([t.plan.objective for t in found]),
        "cone_margin_n": np.array([t.plan.verification.cone_margin_n for t in found]),
    }


ITEM: Final = Item("table-4.1", "How long the optimal control problem takes", run, printed=("times",))
