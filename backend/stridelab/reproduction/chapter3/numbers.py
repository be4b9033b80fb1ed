"""Numbers that chapter 3 states in its text: deviations, p-values, how many parameters, and the moving hub.

What its figures show is in their own items, the coefficients with the height among them (3.7 to 3.9).
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Progress, Series
from stridelab.reproduction.claims import Claim, Item, Reproduction, judged
from stridelab.reproduction.common.simulated_people import THESIS_PEOPLE, SimulatedPeople, simulated_people, table_of
from stridelab.reproduction.common.simulated_steps import simulated_steps
from stridelab.reproduction.report.svg_plots import Bars, svg
from stridelab.walking.curtate_cycloid import parameter_rows
from stridelab.walking.population.correlations import p_of
from stridelab.walking.step_fit import StepFit

PRINTED: Final = (("R", 0.67, 0.01), ("r", 0.61, 0.01), ("z0", 0.87, 0.001))
"""Coefficient with the height, and the bound of its p (3.3.2)."""
MEASURED_MM: Final = 2.0
"""Accuracy of motion capture (3.4.1)."""
OVERESTIMATED_M: Final = 0.02
QUARTER: Final = 0.25
"""What "numerous" is at least."""
EVEN: Final = 1.0
"""The hub is "low-varying" where its speed varies no more than the walker's own."""


def run(seeds: int, tell: Progress) -> Reproduction:
    """As many people as ``seeds`` says, six at least."""
    found = simulated_people(seeds, lambda fraction, message: tell(0.8 * fraction, message))
    fits = simulated_steps().fits
    tell(0.9, "rolling")
    speeds = np.array([_speeds(fit) for fit in fits])
    claims = (*_deviations(found), *_p_values(), *_models(found, fits), *_hub(fits, speeds))
    tell(1.0, "done")
    return Reproduction(
        claims=claims,
        note=f"{len(found.population.subjects)} simulated people with exact centre of mass, and the steps of one walk. "
        "How much a person's steps vary is the simulation's own choice; people are in docs/theory/population.md. The "
        "p-values follow from the printed coefficients and the number of subjects alone.",
        tables={
            "people": table_of(found),
            "hub": {
                "step": np.arange(1.0, len(fits) + 1),
                "hub_variation": speeds[:, 0],
                "com_variation": speeds[:, 1],
            },
        },
        drawing=svg(
            [
                Bars("Standard deviation of the speed over its mean", "1",
                     [("hub", float(speeds[:, 0].mean())), ("centre of mass", float(speeds[:, 1].mean()))]),
                Bars("p of the printed coefficients among 16 subjects", "1",
                     [(f"{name}: r = {r:g}", p_of(r, THESIS_PEOPLE - 2)) for name, r, _ in PRINTED]),
            ]
        ),
    )  # fmt: skip


def freedom(theta_rad: Series, R_m: float, r_m: float) -> tuple[int, int]:
    """Numbers that a path can be given freely: with a free angle per sample, and with an even clock and an offset.

    Ranks of the derivatives of all x and z with respect to (R, r, z0) and the angles, or the offset, the first angle
    and the angular velocity.
    """
    ahead, up = parameter_rows(theta_rad, 1)
    moved, shape = np.vstack([ahead, up])[:, :1], np.vstack([ahead, up])[:, 1:]
    turned = np.concatenate([R_m - r_m * np.cos(theta_rad), r_m * np.sin(theta_rad)])
    each = np.vstack([np.diag(part) for part in np.split(turned, 2)])
    clock = turned[:, None] * np.column_stack([np.ones_like(turned), np.tile(theta_rad, 2)])
    free, even = (np.linalg.matrix_rank(np.hstack(parts)) for parts in ([shape, each], [shape, moved, clock]))
    return int(free), int(even)


def _deviations(found: SimulatedPeople) -> tuple[Claim, ...]:
    """3.3.1, and the captions of figures 3.7 and 3.8."""
    subjects = found.population.subjects
    mean, sd = (np.array([s.mean[key] for s in subjects]) for key in ("error_mean_mm", "error_sd_mm"))
    good = float(np.mean((mean < 1.0) & (sd < 0.5)))
    R_m, r_m, z0_m = (max(float(s.sd[key]) for s in subjects) for key in ("R_m", "r_m", "z0_m"))
    return (
        Claim(
            "error_sd_mm",
            "the distance has a standard deviation of 1 mm at most (3.3.1)",
            1.0,
            float(sd.max()),
            "mm",
            judged(float(sd.max()), at_most=1.0),
            "The text has 1 mm, the caption of figure 3.6 1.5 mm.",
        ),
        Claim(
            "below_1_mm",
            "for numerous subjects the mean is below 1 mm and the deviation below 0.5 mm (3.3.1)",
            "numerous",
            good,
            "1",
            judged(good, at_least=QUARTER),
            "Share of the people; a quarter counts as numerous. The distance goes with the speed, with which the path "
            "rises and falls more.",
        ),
        Claim(
            "radii_sd_m",
            "R and r vary by less than 5 mm from step to step (figure 3.7)",
            0.005,
            max(R_m, r_m),
            "m",
            judged(max(R_m, r_m), at_most=0.005),
            f"Largest standard deviation of a person, of R; {1e3 * r_m:.2f} mm of r.",
        ),
        Claim(
            "z0_sd_m",
            "z0 varies by less than 2 mm from step to step (figure 3.8)",
            0.002,
            z0_m,
            "m",
            judged(z0_m, at_most=0.002),
            "Largest standard deviation of a person.",
        ),
    )


def _p_values() -> tuple[Claim, ...]:
    """Two-sided p of the printed coefficients among the 16 subjects of 3.2.1."""
    found = []
    for name, r, bound in PRINTED:
        p = p_of(r, THESIS_PEOPLE - 2)
        holds: bool = p < bound
        found.append(
            Claim(f"{name}_p", f"{name}: a coefficient of {r:g} has p below {bound:g} (3.3.2)", bound, p, "1",
                  "met" if holds else "thesis_in_error",
                  f"Student's t, two-sided, among the {THESIS_PEOPLE} subjects of 3.2.1.")
        )  # fmt: skip
    return tuple(found)


def _models(found: SimulatedPeople, fits: tuple[StepFit, ...]) -> tuple[Claim, ...]:
    """3.4.1 and 3.4.2: against the measurement, against a pendulum, and what has to be known."""
    mean_mm = float(np.mean([s.mean["error_mean_mm"] for s in found.population.subjects]))
    over_m = float(np.mean([_pendulum_rise_m(fit) - np.ptp(fit.path_m[:, 1]) for fit in fits]))
    wheel, theta = fits[0].path.wheel, fits[0].path.theta_rad
    free, even = freedom(theta, wheel.R_m, wheel.r_m)
    return (
        Claim(
            "distance_mm",
            "the model is more precise than motion capture, which is accurate to 2 mm (3.4.1)",
            MEASURED_MM,
            mean_mm,
            "mm",
            judged(mean_mm, at_most=MEASURED_MM),
            "Mean distance of all people. Two harmonics are more precise still (figure 3.5).",
        ),
        Claim(
            "pendulum_over_m",
            "existing models overestimate the vertical position by up to 2 cm (3.4.1)",
            OVERESTIMATED_M,
            over_m,
            "m",
            "met" if 0.5 * OVERESTIMATED_M <= over_m <= 2.0 * OVERESTIMATED_M else "not_met",
            "What an inverted pendulum as long as the CoM is high rises in a step, less what the CoM rises.",
        ),
        Claim(
            "parameters",
            "only three parameters are necessary to describe all of the trajectory (3.4.2)",
            3.0,
            float(even),
            "1",
            "met" if even <= 3 else "thesis_in_error",
            "Rank of the derivative with an even clock: R, r, z0, and where, at which angle and how fast it rolls. "
            f"With a free angle per sample {free} of {2 * len(theta)} numbers are free.",
        ),
    )


def _pendulum_rise_m(fit: StepFit) -> float:
    """Height of an arc over a step's length, of a radius that is the mean height of the CoM."""
    length_m, half_m = float(fit.path_m[:, 1].mean()), 0.5 * float(fit.step.length_m or 0.0)
    return length_m - float(np.sqrt(length_m**2 - half_m**2))


def _speeds(fit: StepFit) -> tuple[float, float]:
    """Standard deviation over mean of the speed ahead in a step: of the hub R theta_k, and of the CoM."""
    hub, com = (np.gradient(x, fit.time_s) for x in (fit.path.wheel.hub_m(fit.path.theta_rad)[:, 0], fit.path_m[:, 0]))
    return float(hub.std() / hub.mean()), float(com.std() / com.mean())


def _hub(fits: tuple[StepFit, ...], speeds: Float[np.ndarray, "steps 2"]) -> tuple[Claim, ...]:
    """3.4.5: the frame that moves with the centre of the wheel."""
    ratio = float(speeds[:, 0].mean() / speeds[:, 1].mean())
    orbits = [np.hypot(*(f.path_m - f.path.wheel.hub_m(f.path.theta_rad)).T) for f in fits]
    uneven = float(np.mean([orbit.std() / orbit.mean() for orbit in orbits]))
    return (
        Claim(
            "orbit",
            "the CoM orbits the centre of the wheel at a constant distance (3.4.5)",
            0.0,
            uneven,
            "1",
            judged(uneven, at_most=0.1),
            "Standard deviation of the distance over its mean.",
        ),
        Claim(
            "hub_over_com",
            "the centre of the wheel hovers with a low-varying velocity (3.4.5)",
            "low-varying",
            ratio,
            "1",
            "met" if ratio <= EVEN else "thesis_in_error",
            f"Its speed varies by {speeds[:, 0].mean():.0%} in a step, that of the CoM by {speeds[:, 1].mean():.0%}: "
            "the walker is fastest where the wheel is slowest, and the hub has to make up for both.",
        ),
    )


ITEM: Final = Item("numbers-3", "Numbers in the text of chapter 3", run, default_seeds=THESIS_PEOPLE)
