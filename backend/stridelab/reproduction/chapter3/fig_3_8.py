"""Figure 3.8: z0 versus body height."""

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
    claims = (height_claim(people, "z0_m", "z0", 0.87),)
    tell(1.0, "done")
    return Reproduction(
        claims=claims,
        note=NOTE,
        tables={"people": people_table(people)},
        drawing=render_svg(
            [Panel("Height of the hub", "height (m)", "z0 (m)", [*height_plot_curves(people, "z0_m", 1.0, 0, "z0")])]
        ),
    )


ITEM: Final = Item("fig-3.8", "z0 against the height", run, default_seeds=THESIS_SUBJECTS)
