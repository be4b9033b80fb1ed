"""Figure 4.4: density of the CoM over the right foot of TALOS, kernels above, mixtures of 4 and 7 below."""

from typing import Final

from stridelab.conventions import Progress
from stridelab.reproduction.chapter4.foot_density import reproduced
from stridelab.reproduction.claims import Item, Reproduction

SIZES: Final = (4, 7)


def run(seeds: int, tell: Progress) -> Reproduction:
    """From the bundled samples; ``seeds`` changes nothing."""
    return reproduced("talos", "TALOS", SIZES, 4, "4 components are enough for TALOS, as the figure has it", tell)


ITEM: Final = Item("fig-4.4", "Where the CoM of TALOS is over its right foot", run, printed=("level_sets",))
