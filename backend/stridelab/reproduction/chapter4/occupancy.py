"""What (4.11) adds to (4.13): log-densities of velocity and momentum, and of their rates, along the thesis' motions."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from stridelab.centroidal.solver import SolverChoice, solve
from stridelab.centroidal.state_density import StateDensity
from stridelab.conventions import Progress
from stridelab.reachability.card import Measure
from stridelab.reproduction.claims import Measured, Reproduction, above, at_least, reproduces, target
from stridelab.reproduction.common.estimator_errors import as_columns
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.reproduction.studies.state_occupancy import (
    change_within_phases,
    densities_of_soles,
    nats_below_mode,
    position_log_density,
    rates_of_plan,
    sample_states,
    state_log_density,
)
from stridelab.reproduction.studies.thesis_experiments import EXPERIMENTS, Experiment, experiment_problem
from stridelab.robots.loader import load_robot

ROBOT: Final = "talos"
SOLE: Final = "right_foot"
MEASURE: Final[Measure] = "conditioned"
SAMPLES: Final = 2000
SMALL: Final = 0.1
"""Share of the change of the position's log-density below which another one makes no difference."""
STAIRS: Final[tuple[Experiment, ...]] = (2, 3)
SOLVER: Final[SolverChoice] = "ipopt"
"""The C++ solver has no density of the state."""
WHERE: Final = "4.3.1.3"


@reproduces("occupancy", "Occupancy of velocity and rate of momentum", draws="one", printed=("changes", "in_cost"))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Sampled states of TALOS, and the plans of the three experiments."""
    tell(0.05, "sampling states")
    samples = sample_states(load_robot(ROBOT), SOLE, SAMPLES, seeds[0], MEASURE)
    rows = []
    for experiment in EXPERIMENTS:
        tell(0.5 + 0.1 * experiment, f"experiment {experiment}")
        problem = experiment_problem(experiment, ROBOT, MEASURE)
        plan = solve(problem)
        velocities, rates = rates_of_plan(plan)
        rows.append(
            {
                "experiment": experiment,
                "position_nats": change_within_phases(position_log_density(problem, plan), plan.phase),
                "velocity_nats": change_within_phases(nats_below_mode(samples.velocities(), velocities), plan.phase),
                "rate_nats": change_within_phases(nats_below_mode(samples.rates(), rates), plan.phase),
            }
        )
    densities = densities_of_soles(samples)
    compared = []
    for experiment in STAIRS:
        tell(0.85, f"experiment {experiment} with the density of the state in the cost")
        compared.append(_compare_costs(experiment, densities))
    converged = [bool(row.pop("converged")) for row in compared]
    gained = [row["state_nats_with"] - row["state_nats_without"] for row in compared]
    position, velocity, rate = (np.array([row[key] for row in rows]) for key in list(next(iter(rows)))[1:])
    claims = (
        Measured("position", "pushes", float(position.min()), "1", above(0.0, "words")).says(
            "the solver is gently pushed away from the constraint by the log-density of the position (nats, smallest "
            "change within a phase of three motions)",
            no_interval="deterministic",
            where=WHERE,
        ),
        target("velocity", float((velocity / position).max()), "1", at_most=SMALL).says(
            "the log-density of (c', L) changes by less than a tenth of that of c (largest share of three motions)",
            f"At most {velocity.max():.3f} nats.",
            no_interval="one_sample",
        ),
        target("rate", float((rate / position).max()), "1", at_most=SMALL).says(
            "the log-density of (c'', L') changes by less than a tenth of that of c (largest share of three motions)",
            f"At most {rate.max():.3f} nats.",
            no_interval="one_sample",
        ),
        Measured("converges", "robustly", float(np.mean(converged)), "1", at_least(1.0, "words")).says(
            "the solver robustly computes a good local minimum when optimizing over a cost penalizing the log-PDF "
            "of the state and its rate (share of the plans on stairs)",
            f"Iterations: {_join_values(compared, 'iterations_with')}; without it "
            f"{_join_values(compared, 'iterations_without')}. The centre of mass moves by at most "
            f"{1e3 * max(row['moved_m'] for row in compared):.1f} mm, and the mean "
            f"log-density of the state rises by at most {max(gained):.4f} nats.",
            n=len(compared),
            no_interval="one_sample",
            solver=SOLVER,
            comparator="cost without the term",
            where=WHERE,
        ),
    )
    labels = [(f"experiment {row['experiment']}, {key.partition('_')[0]}", float(row[key]))
              for row in rows for key in list(row)[1:]]  # fmt: skip
    return Reproduction(
        claims=claims,
        note=f"(4.11) has a density of the whole state and its rate, the thesis and the planner that of the position "
        f"alone, (4.13). {SAMPLES} states of TALOS on one sole: postures as for the densities of the CoM, joint rates "
        "and torques uniform in their limits. Normal distributions with the moments of the samples, and the largest "
        "change of their logarithm within one contact phase of the planned motions (u_f, default weights): what a "
        "further term could gain. The second table compares plans on stairs with and without -log p(c', L) - "
        "log p(c'', L') of the soles in the cost, by ipopt; nats are means over time and summed over contacts.",
        tables={"changes": as_columns(rows), "in_cost": as_columns(compared)},
        drawing=render_svg(Bars("Largest change of a log-density within a phase", "nats", labels)),
        n=len(rows),
    )


def _join_values(rows: Sequence[Mapping[str, Any]], key: str) -> str:
    return " and ".join(str(row[key]) for row in rows)


def _compare_costs(experiment: Experiment, densities: Mapping[str, StateDensity]) -> dict[str, Any]:
    """Plans of an experiment without and with the densities of the state in the cost."""
    without = experiment_problem(experiment, ROBOT, MEASURE)
    plans = {"without": solve(without, SOLVER), "with": solve(replace(without, state_densities=densities), SOLVER)}
    row: dict[str, Any] = {"experiment": experiment, "converged": plans["with"].converged}
    row["moved_m"] = float(np.linalg.norm(plans["with"].com_m - plans["without"].com_m, axis=1).max())
    for name, plan in plans.items():
        row[f"state_nats_{name}"] = float(np.diff(plan.time_s) @ state_log_density(densities, plan) / plan.time_s[-1])
        row[f"position_nats_{name}"] = float(position_log_density(without, plan).mean())
        row[f"momentum_nms_{name}"] = float(np.sqrt((plan.l_nms**2).sum(axis=1).mean()))
        row[f"iterations_{name}"] = plan.iterations
    return row
