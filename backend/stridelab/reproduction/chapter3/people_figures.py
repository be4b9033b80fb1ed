"""Figures 3.3 to 3.10 and the numbers of chapter 3 on people: one item each, from the same steps.

The simulated walker of the other items is no witness for these claims: its height is a cosine per step, and the
variation between its steps is a parameter. The thesis' people walk at their normal speed; the fast speed is reported
beside it. Intervals are over people, who are drawn with replacement.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.reproduction.chapter3.people_parameter_claims import (
    clock_claims,
    double_support_claims,
    few_people_text,
    hub_height_claims,
    missing_correlations_text,
    radius_claims,
    start_error_ms,
)
from stridelab.reproduction.chapter3.people_path_claims import (
    distance_claims,
    fitted_curve_claims,
    largest_error_m,
    segmentation_claims,
    shape_claims,
    text_claims,
)
from stridelab.reproduction.chapter3.people_walks import SOURCE, FittedWalk, Walks, fitted_walks
from stridelab.reproduction.claims import Claim, Column, PeopleItem, Reproduction
from stridelab.reproduction.common.own_aims import as_own_aim
from stridelab.reproduction.common.recorded_walks import left_out_text
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.walking.population.correlations import MIN_SUBJECTS

ClaimsOf = Callable[[Walks], Sequence[Claim]]
CORRELATED: Final[tuple[ClaimsOf, ...]] = (radius_claims, hub_height_claims, clock_claims)
"""Claims that include a correlation with the height."""


def _ours_if_fast(claim: Claim) -> Claim:
    """A claim at a fast speed is none of the thesis, whose people walk at their normal speed."""
    return as_own_aim(claim) if claim.key.startswith("fast_") else claim


def _people_item(
    number: str, title: str, claims_of: ClaimsOf, bars: Callable[[FittedWalk], float], label: str
) -> PeopleItem:
    """An item on all steps; the drawing shows one number per person and speed, the table its mean over people."""

    def run(gait: Path, tell: Progress) -> Reproduction:
        tell(0.1, "fitting the steps of all recordings")
        walks, left_out = fitted_walks(gait)
        tell(0.9, "comparing")
        values = {speed: [bars(walk) for walk in of] for speed, of in walks.items()}
        table: dict[str, Column] = {
            "speed": np.array(list(walks)),
            "people": np.array([len(of) for of in walks.values()]),
            "steps": np.array([sum(len(walk.fits) for walk in of) for of in walks.values()]),
            "mean": np.array([float(np.nanmean(of)) for of in values.values()]),
            "least": np.array([float(np.nanmin(of)) for of in values.values()]),
            "largest": np.array([float(np.nanmax(of)) for of in values.values()]),
        }
        people = len({walk.person for of in walks.values() for walk in of})
        claims = tuple(map(_ours_if_fast, claims_of(walks)))
        if people < MIN_SUBJECTS:
            claims = tuple(replace(claim, verdict="undecided") for claim in claims)
        name, unit = label.rsplit(",", 1)
        return Reproduction(
            claims=claims,
            note=f"{SOURCE}: {people} people, two steps each at a comfortable and at a fast speed; the smoother's "
            f"centre of mass with the latency corrected and the person's static trial, not the thesis' filter. The "
            f"thesis' people walk at their normal speed: what is said of a fast one is an aim of ours. Table: {name} "
            f"({unit.strip()}).{few_people_text(people)}"
            f"{missing_correlations_text(people) if claims_of in CORRELATED else ''}{left_out_text(left_out)}",
            tables={"people": table},
            drawing=render_svg(
                *(
                    Bars(f"{name}, {speed}", unit.strip(), [(f"adult {k + 1}", v) for k, v in enumerate(of)])
                    for speed, of in values.items()
                )
            ),
        ).with_basis("people", people)

    base = f"fig-{number}" if "." in number else f"numbers-{number}"
    return PeopleItem(f"{base}-people", f"{title}, real recordings", run, __name__, ("people",))


PEOPLE_ITEMS: Final = (
    _people_item("3.3", "The path and the curtate cycloid", shape_claims, FittedWalk.convex_share, "convex share, 1"),
    _people_item(
        "3.4", "Phases of the gait, and the height in a step", segmentation_claims,
        lambda walk: 1e3 * walk.height_variability_m(), "variability of the height between steps, mm",
    ),
    _people_item(
        "3.5", "One step and the wheel through it", fitted_curve_claims, lambda walk: 1e3 * largest_error_m(walk),
        "largest distance in a step, mm",
    ),
    _people_item(
        "3.6", "Distance between path and wheel, per person", distance_claims,
        lambda walk: walk.distance_mm(measured=False)[0], "mean distance, mm",
    ),
    _people_item(
        "3.7", "R and r against the height", radius_claims, lambda walk: 1e3 * walk.spread_m("R_m"),
        "deviation of R between two steps, mm",
    ),
    _people_item(
        "3.8", "z0 against the height", hub_height_claims, lambda walk: 1e3 * walk.spread_m("z0_m"),
        "deviation of z0 between two steps, mm",
    ),
    _people_item(
        "3.9", "Angular velocity against the height", clock_claims,
        lambda walk: 1e3 * walk.mean_of(lambda fit: float(fit.timed.distance_m.mean())),
        "distance with uniform rotation, mm",
    ),
    _people_item(
        "3.10", "Double support from the crossings of the hub's height", double_support_claims,
        start_error_ms, "predicted minus measured start, ms",
    ),
    _people_item(
        "3", "Numbers in the text of chapter 3", text_claims,
        lambda walk: 1e3 * walk.mean_of(lambda fit: float(fit.path.distance_m.mean())), "mean distance, mm",
    ),
)  # fmt: skip
"""Items of chapter 3 on people."""
