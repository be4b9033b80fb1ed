"""What (4.11) adds to (4.13): log-densities of velocity and momentum, and of their rates, along the thesis' motions."""

from typing import Final

import numpy as np

from stridelab.centroidal.solver import solve
from stridelab.conventions import Progress
from stridelab.reachability.card import Measure
from stridelab.reproduction.claims import Measured, Reproduction, above, reproduces, target
from stridelab.reproduction.common.estimator_errors import as_columns
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.reproduction.studies.state_occupancy import (
    change_within_phases,
    nats_below_mode,
    position_log_density,
    rates_of_plan,
    sample_states,
)
from stridelab.reproduction.studies.thesis_experiments import EXPERIMENTS, experiment_problem
from stridelab.robots.loader import load_robot

ROBOT: Final = "talos"
SOLE: Final = "right_foot"
MEASURE: Final[Measure] = "conditioned"
SAMPLES: Final = 2000
SMALL: Final = 0.1
"""Share of the change of the position's log-density below which another one makes no difference."""
WHERE: Final = "4.3.1.3"


@reproduces("occupancy", "Occupancy of velocity and rate of momentum", draws="one", printed=("changes",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Sampled states of TALOS, and the plans of the three experiments."""
    tell(0.05, "sampling states")
    samples = sample_states(load_robot(ROBOT), SOLE, SAMPLES, seeds[0], MEASURE)
    rows = []
    for experiment in EXPERIMENTS:
        tell(0.5 + 0.15 * experiment, f"experiment {experiment}")
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
    position, velocity, rate = (np.array([row[key] for row in rows]) for key in list(rows[0])[1:])
    claims = (
        Measured("position", "pushes", float(position.min()), "1", above(0.0, "words")).says(
            "the solver is gently pushed away from the constraint by the log-density of the position (nats, smallest "
            "change within a phase of three motions)",
            where=WHERE,
        ),
        target("velocity", float((velocity / position).max()), "1", at_most=SMALL).says(
            "the log-density of (c', L) changes by less than a tenth of that of c (largest share of three motions)",
            f"At most {velocity.max():.3f} nats.",
        ),
        target("rate", float((rate / position).max()), "1", at_most=SMALL).says(
            "the log-density of (c'', L') changes by less than a tenth of that of c (largest share of three motions)",
            f"At most {rate.max():.3f} nats.",
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
        "further term could gain. Such a term is not part of the planner.",
        tables={"changes": as_columns(rows)},
        drawing=render_svg(Bars("Largest change of a log-density within a phase", "nats", labels)),
        n=len(rows),
    )
