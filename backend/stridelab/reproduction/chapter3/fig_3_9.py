"""Figure 3.9: omega against the height."""

from typing import Final

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Claim, Item, Reproduction
from stridelab.reproduction.common.simulated_people import (
    NOTE,
    THESIS_PEOPLE,
    against_height,
    marks,
    simulated_people,
    table_of,
)
from stridelab.reproduction.report.svg_plots import Panel, svg

P: Final = 0.83


def run(seeds: int, tell: Progress) -> Reproduction:
    """As many people as ``seeds`` says, six at least."""
    found = simulated_people(seeds, tell)
    pair = against_height(found, "omega_rad_s").pearson
    low, high = pair.ci95 or (-1.0, 1.0)
    claims = (
        Claim(
            "omega_height_p",
            "omega hardly goes with the height: p is 0.83 or more",
            P,
            pair.p,
            "1",
            "met" if low <= 0.0 <= high else "not_met",
            f"Met where our interval of r holds 0: r = {pair.r:.2f}, n = {pair.n}, 95 % from {low:.2f} to {high:.2f}. "
            "A p of 0.83 says that no correlation was seen, not that there is none.",
        ),
    )
    tell(1.0, "done")
    return Reproduction(
        claims=claims,
        note=NOTE,
        tables={"people": table_of(found)},
        drawing=svg(
            [Panel("Angular velocity", "height (m)", "omega (rad/s)", marks(found, "omega_rad_s", 1.0, 0, "omega"))]
        ),
    )


ITEM: Final = Item("fig-3.9", "Angular velocity against the height", run, default_seeds=THESIS_PEOPLE)
