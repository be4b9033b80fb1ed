"""Numbers in the text of chapter 3: deviations, p-values, number of parameters, and the moving hub.

The figures have their own items, including the correlations with height (3.7 to 3.9).
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Progress, Series
from stridelab.reproduction.claims import (
    DETERMINISTIC,
    Claim,
    Measured,
    Reproduction,
    at_most,
    below,
    reproduces,
    target,
)
from stridelab.reproduction.common.intervals import interval_of
from stridelab.reproduction.common.simulated_people import THESIS_SUBJECTS
from stridelab.reproduction.common.simulated_steps import simulated_steps
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.walking.curtate_cycloid import parameter_rows
from stridelab.walking.population.correlations import two_sided_p
from stridelab.walking.step_fit import StepFit

PRINTED: Final = (("R", 0.67, 0.01), ("r", 0.61, 0.01), ("z0", 0.87, 0.001))
"""Printed correlation with the height, and the bound of its p (3.3.2)."""
MEASURED_MM: Final = 2.0
"""Accuracy of motion capture (3.4.1), for the item on people."""
MIN_SUBJECT_SHARE: Final = 0.25
"""Minimum share that counts as "numerous"."""


@reproduces("numbers-3", "Numbers in the text of chapter 3", draws="one")
def run(seeds: range, tell: Progress) -> Reproduction:
    """The printed coefficients, the model itself, and the steps of one simulated walk."""
    tell(0.1, "simulating a walk")
    fits = simulated_steps(seeds[0]).fits
    tell(0.9, "analysing the hub")
    speeds = np.array([speed_variations(fit) for fit in fits])
    return Reproduction(
        claims=(*_p_value_claims(), *_model_claims(fits), *_hub_targets(fits, speeds)),
        note="What the thesis says of subjects and their steps is in the item numbers-3-people, on people: of a "
        "simulated walker the height is a cosine, and the variation between steps a parameter. The p-values "
        "follow from the printed coefficients and the number of subjects.",
        tables={
            "hub": {
                "step": np.arange(1.0, len(fits) + 1),
                "hub_variation": speeds[:, 0],
                "com_variation": speeds[:, 1],
            },
        },
        drawing=render_svg(
            Bars(
                "Standard deviation of the speed over its mean",
                "1",
                [("hub", float(speeds[:, 0].mean())), ("centre of mass", float(speeds[:, 1].mean()))],
            ),
            Bars(
                "p of the printed coefficients among 16 subjects",
                "1",
                [(f"{name}: r = {r:g}", two_sided_p(r, THESIS_SUBJECTS - 2)) for name, r, _ in PRINTED],
            ),
        ),
    )


def free_parameter_counts(theta_rad: Series, R_m: float, r_m: float) -> tuple[int, int]:
    """Numbers of free parameters of a path: with a free angle per sample, and with uniform rotation and an offset.

    Computed as ranks of the derivatives of all x and z with respect to (R, r, z0) and the angles, or the offset, the
    initial angle and the angular velocity.
    """
    ahead, up = parameter_rows(theta_rad, 1)
    moved, shape = np.vstack([ahead, up])[:, :1], np.vstack([ahead, up])[:, 1:]
    turned = np.concatenate([R_m - r_m * np.cos(theta_rad), r_m * np.sin(theta_rad)])
    each = np.vstack([np.diag(part) for part in np.split(turned, 2)])
    clock = turned[:, None] * np.column_stack([np.ones_like(turned), np.tile(theta_rad, 2)])
    free, even = (np.linalg.matrix_rank(np.hstack(parts)) for parts in ([shape, each], [shape, moved, clock]))
    return int(free), int(even)


def _p_value_claims() -> tuple[Claim, ...]:
    """Two-sided p of the printed coefficients among the 16 subjects of 3.2.1."""
    claims = []
    for name, r, bound in PRINTED:
        p = two_sided_p(r, THESIS_SUBJECTS - 2)
        claims.append(
            Measured(f"{name}_p", bound, p, "1", below(bound, "thesis")).says(
                f"{name}: a coefficient of {r:g} has p below {bound:g} (3.3.2)",
                f"Student's t, two-sided, among the {THESIS_SUBJECTS} subjects of 3.2.1; one-sided {0.5 * p:.2g}.",
                n=THESIS_SUBJECTS,
                no_interval="deterministic",
                evidence="external",
                where="3.3.2",
            )
        )
    return tuple(claims)


def _model_claims(fits: tuple[StepFit, ...]) -> tuple[Claim, ...]:
    """3.4.2: number of parameters."""
    path = next(iter(fits)).path
    theta = path.theta_rad
    free, even = free_parameter_counts(theta, path.wheel.R_m, path.wheel.r_m)
    return (
        Measured("parameters", 3.0, float(free - len(theta)), "1", at_most(3.0, "thesis")).says(
            "with our model, only three parameters are necessary to describe all the CoM trajectories (3.4.2)",
            "Rank of the derivative, less one variable theta per sample, which the thesis does not count: R, r and z0 "
            "(and the place where a step begins, a fourth). "
            f"With uniform rotation (3.4) in its place {even} numbers are needed: also the initial position, "
            "the initial angle and the angular velocity. A property of (3.1), (3.2) and (3.4).",
            **DETERMINISTIC,
            where="3.4.2",
        ),
    )


def pendulum_rise_m(fit: StepFit) -> float:
    """Height of a circular arc over the step length; its radius is the mean height of the CoM."""
    length_m, half_m = float(fit.path_m[:, 1].mean()), 0.5 * float(fit.step.length_m or 0.0)
    return length_m - float(np.sqrt(length_m**2 - half_m**2))


def speed_variations(fit: StepFit) -> tuple[float, float]:
    """Coefficients of variation of the forward speed in a step: of the hub R theta_k and of the CoM."""
    hub, com = (np.gradient(x, fit.time_s) for x in (fit.path.wheel.hub_m(fit.path.theta_rad)[:, 0], fit.path_m[:, 0]))
    return float(hub.std() / hub.mean()), float(com.std() / com.mean())


def _hub_targets(fits: tuple[StepFit, ...], speeds: Float[np.ndarray, "steps 2"]) -> tuple[Claim, ...]:
    """3.4.5 on the simulated walker, which is no verdict on the thesis."""
    orbits = [np.hypot(*(f.path_m - f.path.wheel.hub_m(f.path.theta_rad)).T) for f in fits]
    uneven = [float(orbit.std() / orbit.mean()) for orbit in orbits]
    return (
        target("orbit", float(np.mean(uneven)), "1", at_most=0.1).says(
            "simulated walker: deviation of the CoM's distance from the hub over its mean",
            f"The hub's speed varies by {speeds[:, 0].mean():.0%} in a step, that of the CoM by "
            f"{speeds[:, 1].mean():.0%}. No verdict on the thesis: people are in the item numbers-3-people.",
            n=len(fits),
            interval=interval_of(uneven),
        ),
    )
