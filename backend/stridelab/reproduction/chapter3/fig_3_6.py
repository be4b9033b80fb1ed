"""Figure 3.6: distance between path and cycloid for every subject."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Reproduction, reproduces, target
from stridelab.reproduction.common.simulated_people import (
    MIN_SEEDS,
    NOTE,
    PEOPLE_NOTE,
    PEOPLE_PER_SEED,
    THESIS_SUBJECTS,
    simulated_people,
)
from stridelab.reproduction.report.svg_plots import Bars, Curve, Panel, render_svg

MEAN_MM: Final = 3.5
SD_MM: Final = 1.5


@reproduces(
    "fig-3.6",
    "Distance between path and wheel, per person",
    draws="many",
    default_seeds=THESIS_SUBJECTS // PEOPLE_PER_SEED,
    min_seeds=MIN_SEEDS,
)
def run(seeds: range, tell: Progress) -> Reproduction:
    """Simulated subjects, ``PEOPLE_PER_SEED`` of each seed."""
    subjects = simulated_people(seeds, tell).population.subjects
    means = np.array([s.mean["error_mean_mm"] for s in subjects])
    sds = np.array([s.mean["error_sd_mm"] for s in subjects])
    claims = (
        target("error_mean_mm", float(means.max()), "mm", at_most=MEAN_MM).says(
            "the mean distance of all simulated subjects remains below 3.5 mm, as that of the thesis' subjects",
            f"The largest mean of a subject. {PEOPLE_NOTE}",
            cases_inside=int((means <= MEAN_MM).sum()),
        ),
        target("error_sd_mm", float(sds.max()), "mm", at_most=SD_MM).says(
            "with a maximal standard deviation of 1.5 mm",
            "The largest standard deviation of a subject. The text has 1 mm, the caption 1.5 mm.",
            cases_inside=int((sds <= SD_MM).sum()),
        ),
    )
    person = np.arange(1.0, len(means) + 1)
    gap = np.full_like(means, np.nan)
    spread = Curve(
        np.column_stack([person, person, gap]).ravel(),
        np.column_stack([np.maximum(means - sds, 0.0), means + sds, gap]).ravel(),
        "mean ± deviation",
    )
    bound = Curve(person[[0, -1]], np.full(2, MEAN_MM), "thesis: all below", 1, dashed=True)
    return Reproduction(
        claims=claims,
        note=NOTE,
        n=len(subjects),
        tables={"people": {"person": person, "error_mean_mm": means, "error_sd_mm": sds}},
        drawing=render_svg(
            Bars("Largest of all people", "mm", [("mean", float(means.max())), ("deviation", float(sds.max()))]),
            Panel("Distance between path and wheel", "person (number)", "distance (mm)", [spread, bound]),
        ),
    )
