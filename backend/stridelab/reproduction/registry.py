"""Registry of the items that can be reproduced, by name."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from stridelab.conventions import Progress
from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.reproduction.chapter2 import (
    fig_2_2,
    fig_2_5,
    fig_2_6,
    fig_2_7,
    fig_2_8,
    fig_2_9,
    numbers,
    table_coverage,
    table_errors,
    table_flight,
    table_lag,
    table_partial_force,
)
from stridelab.reproduction.chapter3 import fig_3_3, fig_3_4, fig_3_5, fig_3_6, fig_3_7, fig_3_8, fig_3_9, fig_3_10
from stridelab.reproduction.chapter3 import numbers as numbers_3
from stridelab.reproduction.chapter4 import (
    fig_4_2,
    fig_4_3,
    fig_4_4,
    fig_4_5,
    fig_4_6,
    fig_4_7,
    fig_4_8,
    fig_4_9,
    table_4_1,
)
from stridelab.reproduction.chapter4 import numbers as numbers_4
from stridelab.reproduction.claims import Item, Reproduction

_FIGURES: Final = (
    fig_2_2,
    fig_2_5,
    fig_2_6,
    fig_2_7,
    fig_2_8,
    fig_2_9,
    fig_3_3,
    fig_3_4,
    fig_3_5,
    fig_3_6,
    fig_3_7,
    fig_3_8,
    fig_3_9,
    fig_3_10,
    fig_4_2,
    fig_4_3,
    fig_4_4,
    fig_4_5,
    fig_4_6,
    fig_4_7,
    fig_4_8,
    fig_4_9,
    table_4_1,
)
_NUMBERS: Final = (numbers, numbers_3, numbers_4)
_TABLES: Final = (table_errors, table_lag, table_coverage, table_partial_force, table_flight)
ITEMS: Final[Mapping[str, Item]] = MappingProxyType({m.ITEM.name: m.ITEM for m in (*_FIGURES, *_NUMBERS, *_TABLES)})
MAX_SEEDS: Final = 200


def item_of(name: str) -> Item:
    """The item with this name. Raises ``NotFound`` (``item-not-found``)."""
    item = ITEMS.get(name)
    if item is None:
        raise NotFound("item-not-found", f"There is no item {name!r}; available items: {', '.join(ITEMS)}.")
    return item


def reproduce_item(name: str, seeds: int | None, tell: Progress) -> Reproduction:
    """Compute one item; ``seeds`` None uses the default number of draws, which takes less than a minute.

    Raises ``NotFound`` (``item-not-found``) and ``InvalidInput`` (``seeds-out-of-range``).
    """
    item = item_of(name)
    repeats = item.default_seeds if seeds is None else seeds
    if not 1 <= repeats <= MAX_SEEDS:
        message = f"seeds must lie between 1 and {MAX_SEEDS}, not {repeats}."
        raise InvalidInput("seeds-out-of-range", message, [Fault("seeds", message)])
    return item.run(repeats, tell)
