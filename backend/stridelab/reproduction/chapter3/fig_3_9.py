"""Figure 3.9: omega versus body height."""

from typing import Final

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Claim, Item, Reproduction
from stridelab.reproduction.common.simulated_people import (
    NOTE,
    THESIS_SUBJECTS,
    correlation_with_height,
    height_plot_curves,
    people_table,
    simulated_people,
)
from stridelab.reproduction.report.svg_plots import Panel, render_svg

P: Final = 0.83


def run(seeds: int, tell: Progress) -> Reproduction:
    """``seeds`` simulated subjects, at least ``MIN_SUBJECTS``."""
    people = simulated_people(seeds, tell)
    pair = correlation_with_height(people, "omega_rad_s").pearson
    low, high = pair.ci95 or (-1.0, 1.0)
    claims = (
        Claim(
            "omega_height_p",
            "omega is hardly correlated with the height: p is 0.83 or more",
            P,
            pair.p,
            "1",
            "met" if low <= 0.0 <= high else "not_met",
            f"Met if the 95 % interval of r contains 0: r = {pair.r:.2f}, n = {pair.n}, from {low:.2f} to {high:.2f}. "
            "A p of 0.83 means that no correlation was detected, not that there is none.",
        ),
    )
    tell(1.0, "done")
    return Reproduction(
        claims=claims,
        note=NOTE,
        tables={"people": people_table(people)},
        drawing=render_svg(
            [
                Panel(
                    "Angular velocity",
                    "height (m)",
                    "omega (rad/s)",
                    height_plot_curves(people, "omega_rad_s", 1.0, 0, "omega"),
                )
            ]
        ),
    )


ITEM: Final = Item("fig-3.9", "Angular velocity against the height", run, default_seeds=THESIS_SUBJECTS)
