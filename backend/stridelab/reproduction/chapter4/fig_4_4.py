"""Figure 4.4: density of the CoM over the right foot of TALOS: kernels, and mixtures of 4 and 7 components."""

from typing import Final

from stridelab.conventions import Progress
from stridelab.reproduction.chapter4.foot_density import reproduce_foot_density
from stridelab.reproduction.claims import Item, Reproduction

SIZES: Final = (4, 7)


def run(seeds: int, tell: Progress) -> Reproduction:
    """Computed from the bundled samples; ``seeds`` is ignored."""
    return reproduce_foot_density("talos", "TALOS", SIZES, 4, "4 components are enough for TALOS (figure)", tell)


ITEM: Final = Item("fig-4.4", "Where the CoM of TALOS is over its right foot", run, printed=("level_sets",))
