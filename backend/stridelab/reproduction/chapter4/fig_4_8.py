"""Figure 4.8: the same walk planned with forces (u_f) and with the wrench (u_c) as control.

Experiment 1 with HRP-2. "In theory, the optimum of both problems should be the same": this requires that the cone of
u_c equals that of the contacts. An inner cone restricts the problem and increases the cost; the thesis' cone is varied
from alpha = 0.2 to 1, where it contains nearly all wrenches and its optimum is not feasible for contact forces.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.solver import solve
from stridelab.conventions import Points, Progress
from stridelab.reproduction.claims import (
    Claim,
    Column,
    Measured,
    Reproduction,
    at_most,
    below,
    reproduces,
    target,
)
from stridelab.reproduction.report.svg_plots import Bars, Curve, Panel, render_svg
from stridelab.reproduction.studies.thesis_experiments import EXPERIMENTS, WALKERS, Experiment, experiment_problem

ROBOT: Final = "hrp2"
EXPERIMENT: Final[Experiment] = 1
SOLVER: Final = "ipopt"
"""One solver for all plans, which supports pyramids and all cones."""
ALPHAS: Final = (0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
OBJECTIVE_TOLERANCE: Final = 0.01
"""Relative difference up to which objectives are equal: ipopt leaves 0.003, the share of its barrier."""
NOISE_NMS: Final = 0.05
"""Angular momentum below which it counts as noise: the robot's weight displaced by 0.1 mm for one second."""


@dataclass(frozen=True)
class Row:
    """One plan compared with that of u_f."""

    robot: str
    experiment: int
    control: str
    solver: str
    objective: float
    iterations: int
    cone_margin_n: float
    com_distance_m: float


@reproduces("fig-4.8", "Forces or the wrench as control", printed=("controls", "alpha"))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Deterministic."""
    rows: list[Row] = []
    both: tuple[CentroidalPlan, CentroidalPlan] | None = None
    jobs = [(robot, experiment) for robot in WALKERS for experiment in EXPERIMENTS]
    for number, (robot, experiment) in enumerate(jobs):
        tell(0.1 + 0.7 * number / len(jobs), f"{robot}, experiment {experiment}")
        plans = {name: solve_with_control(robot, experiment, control) for name, control in controls_by_name().items()}
        rows += [plan_row(robot, experiment, name, plan, plans["u_f"]) for name, plan in plans.items()]
        if (robot, experiment) == (ROBOT, EXPERIMENT):
            both = plans["u_f"], plans["u_c"]
    assert both is not None
    tell(0.8, "the thesis' cone for six alphas")
    sweep = [
        plan_row(
            ROBOT,
            EXPERIMENT,
            f"alpha {alpha:g}",
            solve_with_control(ROBOT, EXPERIMENT, ContactWrench("thesis", alpha=alpha)),
            both[0],
        )
        for alpha in ALPHAS
    ]
    circular = solve_with_control(ROBOT, EXPERIMENT, CircularCones())
    return Reproduction(
        claims=figure_claims(rows, sweep, both, circular),
        note="Experiment 1 of HRP-2 (strides of 0.9 m in 8 s) unless stated otherwise: conditioned densities, forces "
        "constant over 0.1 s, (4.20a) without regularisation. u_f in pyramids of eight rays, u_c in the largest "
        "Lorentz cone inside the wrench cone of the soles, both cold-started from the thesis' initial guess. All plans "
        "are by ipopt.",
        tables={"controls": plan_table(rows), "alpha": plan_table(sweep), "trajectories": trajectory_columns(both)},
        drawing=render_svg(
            *trajectory_panels(both),
            Bars(
                "objective by the cone's size, experiment 1",
                "1",
                [
                    ("u_f", both[0].objective),
                    ("u_c, largest inside", both[1].objective),
                    *((f"thesis' cone, {r.control}", r.objective) for r in sweep),
                ],
            ),
        ),
    )


def controls_by_name() -> Mapping[str, Control]:
    """Both control parametrisations by the thesis' names."""
    return {"u_f": experiment_problem(EXPERIMENT, ROBOT).control, "u_c": ContactWrench()}


def solve_with_control(robot: str, experiment: Experiment, control: Control) -> CentroidalPlan:
    """One cold-started plan by ``SOLVER``."""
    return solve(replace(experiment_problem(experiment, robot), control=control), SOLVER)


def plan_row(robot: str, experiment: int, name: str, plan: CentroidalPlan, of_forces: CentroidalPlan) -> Row:
    """Compare a plan with that of u_f."""
    distance_m = float(np.linalg.norm(plan.com_m - of_forces.com_m, axis=1).max())
    margin_n = plan.verification.cone_margin_n
    return Row(robot, experiment, name, plan.solver, plan.objective, plan.iterations, margin_n, distance_m)


def figure_claims(
    rows: list[Row], sweep: list[Row], both: tuple[CentroidalPlan, CentroidalPlan], circular: CentroidalPlan
) -> tuple[Claim, ...]:
    """Claims of 4.6.2 on both controls."""
    forces, wrench = both
    pairs = list(zip(rows[::2], rows[1::2], strict=True))
    differences = [c.objective - f.objective for f, c in pairs]
    distance_m = rows[1].com_distance_m
    rough = [acceleration_roughness(plan) for plan in both]
    momenta = [float(np.abs(plan.l_nms).max()) for plan in both]
    falling = [a.objective - b.objective for a, b in pairwise(sweep)]
    return (
        Measured("same_optimum", 0.0, max(differences), "1", at_most(OBJECTIVE_TOLERANCE, "ours")).says(
            "in theory, the optimum of both problems should be the same",
            f"Largest excess of u_c's objective over u_f's, for three experiments and two robots (smallest "
            f"{min(differences):.2f}). The inner cone of u_c restricts the problem; the optima would be the same only "
            "with the exact cone of the contacts.",
            n=len(pairs),
            solver=SOLVER,
        ),
        target("restriction", min(differences), "1", at_least=0.0).says(
            "u_c in an inner cone is never better than u_f: smallest excess of its objective",
            n=len(pairs),
            solver=SOLVER,
        ),
        target("alpha_falls", min(falling), "1", at_least=0.0).says(
            "the larger alpha, the lower the optimum: smallest decrease between successive values",
            f"From {sweep[0].objective:.0f} ({sweep[0].control}) to {sweep[-1].objective:.1f} (alpha 1), where "
            f"forces leave their cones by {-sweep[-1].cone_margin_n:.0f} N; u_f: {forces.objective:.1f}.",
            n=len(sweep),
            solver=SOLVER,
        ),
        target(
            "u_f_between",
            min(wrench.objective - forces.objective, forces.objective - sweep[-1].objective),
            "1",
            at_least=0.0,
        ).says("u_f's optimum lies between those of the inner and outer cones", solver=SOLVER),
        target("pyramids", forces.objective - circular.objective, "1", at_most=0.5).says(
            "increase of u_f's objective by pyramids of eight rays instead of circular cones",
            solver=SOLVER,
        ),
        Measured("shape", "similar", distance_m, "m", below(0.05, "ours")).says(
            "the CoM trajectories have similar shape",
            "Largest distance of the CoM at the same time.",
            solver=SOLVER,
        ),
        Measured("smoother", "< 1", rough[1] / rough[0], "1", below(1.0, "words")).says(
            "the motion-based problem leads to marginally smoother trajectories",
            "Mean squared change of the acceleration between intervals of 0.1 s, u_c over u_f, with forces constant in "
            "an interval and our largest cone; the thesis has cubic controls and alpha = 0.3.",
            solver=SOLVER,
        ),
        target("noise", max(momenta), "Nms", at_most=NOISE_NMS).says(
            "the angular momentum has no numerical noise",
            f"Largest one, {momenta[0]:.2g} Nms with u_f and {momenta[1]:.2g} Nms with u_c. The thesis' u_f "
            "oscillates, mostly by numerical noise; exact integration causes none.",
            solver=SOLVER,
        ),
    )


def acceleration_roughness(plan: CentroidalPlan) -> float:
    """Mean squared change of the acceleration between intervals, (m/s²)²."""
    return float((np.diff(plan.com_a_m_s2, axis=0) ** 2).sum(axis=1).mean())


def plan_table(rows: list[Row]) -> Mapping[str, Column]:
    """One row per plan."""
    names = ("robot", "experiment", "control", "solver", "objective", "iterations", "cone_margin_n", "com_distance_m")
    return {name: np.array([getattr(row, name) for row in rows]) for name in names}


def trajectory_columns(both: tuple[CentroidalPlan, CentroidalPlan]) -> Mapping[str, Column]:
    """CoM, velocity and angular momentum of both plans at the nodes."""
    columns: dict[str, Column] = {"time_s": both[0].time_s}
    for name, plan in zip(("forces", "wrench"), both, strict=True):
        for what, values, unit in (
            ("com", plan.com_m, "m"),
            ("com_v", plan.com_v_m_s, "m_s"),
            ("l", plan.l_nms, "nms"),
        ):
            columns |= {f"{name}_{what}_{axis}_{unit}": values[:, k] for k, axis in enumerate("xyz")}
    return columns


def trajectory_panels(both: tuple[CentroidalPlan, CentroidalPlan]) -> list[Panel]:
    """Position relative to uniform motion, velocity and angular momentum; u_f solid, u_c dashed."""

    def panel_of(title: str, label: str, values: tuple[Points, Points]) -> Panel:
        curves = [
            Curve(both[0].time_s, track[:, k], f"{axis}, {name}", k, dashed=name == "u_c")
            for k, axis in enumerate("xyz")
            for name, track in zip(("u_f", "u_c"), values, strict=True)
        ]
        return Panel(title, "time (s)", label, curves)

    uniform = both[0].com_m[0] + np.outer(both[0].time_s / both[0].time_s[-1], both[0].com_m[-1] - both[0].com_m[0])
    return [
        panel_of("CoM minus uniform motion", "c (m)", (both[0].com_m - uniform, both[1].com_m - uniform)),
        panel_of("CoM velocity", "c' (m/s)", (both[0].com_v_m_s, both[1].com_v_m_s)),
        panel_of("angular momentum", "L (Nms)", (both[0].l_nms, both[1].l_nms)),
    ]
