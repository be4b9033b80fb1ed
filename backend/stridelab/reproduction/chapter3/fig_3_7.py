"""Figure 3.7: R and r against the height."""

from typing import Final

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Item, Reproduction
from stridelab.reproduction.common.simulated_people import (
    NOTE,
    THESIS_PEOPLE,
    height_claim,
    marks,
    simulated_people,
    table_of,
)
from stridelab.reproduction.report.svg_plots import Panel, svg


def run(seeds: int, tell: Progress) -> Reproduction:
    """As many people as ``seeds`` says, six at least."""
    found = simulated_people(seeds, tell)
    claims = (height_claim(found, "R_m", "R", 0.67), height_claim(found, "r_m", "r", 0.61))
    tell(1.0, "done")
    return Reproduction(
        claims=claims,
        note=NOTE,
        tables={"people": table_of(found)},
        drawing=svg(
            [
                Panel("Radius of the wheel", "height (m)", "R (mm)", marks(found, "R_m", 1e3, 0, "R")),
                Panel("Distance of the point", "height (m)", "r (mm)", marks(found, "r_m", 1e3, 1, "r")),
            ]
        ),
    )


ITEM: Final = Item("fig-3.7", "R and r against the height", run, default_seeds=THESIS_PEOPLE)
