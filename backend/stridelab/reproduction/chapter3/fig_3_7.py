"""Figure 3.7: R and r versus body height."""

from typing import Final

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Item, Reproduction
from stridelab.reproduction.common.simulated_people import (
    NOTE,
    THESIS_SUBJECTS,
    height_claim,
    height_plot_curves,
    people_table,
    simulated_people,
)
from stridelab.reproduction.report.svg_plots import Panel, render_svg


def run(seeds: int, tell: Progress) -> Reproduction:
    """``seeds`` simulated subjects, at least ``MIN_SUBJECTS``."""
    people = simulated_people(seeds, tell)
    claims = (height_claim(people, "R_m", "R", 0.67), height_claim(people, "r_m", "r", 0.61))
    tell(1.0, "done")
    return Reproduction(
        claims=claims,
        note=NOTE,
        tables={"people": people_table(people)},
        drawing=render_svg(
            [
                Panel("Radius of the wheel", "height (m)", "R (mm)", height_plot_curves(people, "R_m", 1e3, 0, "R")),
                Panel("Distance of the point", "height (m)", "r (mm)", height_plot_curves(people, "r_m", 1e3, 1, "r")),
            ]
        ),
    )


ITEM: Final = Item("fig-3.7", "R and r against the height", run, default_seeds=THESIS_SUBJECTS)
