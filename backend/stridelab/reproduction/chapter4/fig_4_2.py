"""Figure 4.2: density of the CoM over the right foot of HRP-2: kernels, and mixtures of 5, 7 and 13 components."""

from typing import Final

from stridelab.conventions import Progress
from stridelab.reproduction.chapter4.foot_density import reproduce_foot_density
from stridelab.reproduction.claims import Item, Reproduction

SIZES: Final = (5, 7, 13)


def run(seeds: int, tell: Progress) -> Reproduction:
    """Computed from the bundled samples; ``seeds`` is ignored."""
    return reproduce_foot_density("hrp2", "HRP-2", SIZES, 7, "7 components are enough for a foot", tell)


ITEM: Final = Item("fig-4.2", "Where the CoM of HRP-2 is over its right foot", run, printed=("level_sets",))
