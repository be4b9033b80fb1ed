"""Registry of the items that can be reproduced, by name."""

import re
from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Final

from stridelab.conventions import Progress
from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.reproduction.claims import Item, Reproduction

_MODULES: Final = {
    2: "fig_2_2 fig_2_5 fig_2_6 fig_2_7 fig_2_8 fig_2_9 numbers "
    "table_errors table_lag table_coverage table_partial_force table_flight",
    3: "fig_3_3 fig_3_4 fig_3_5 fig_3_6 height_figures fig_3_10 numbers",
    4: "fig_4_3 fig_4_5 fig_4_6 fig_4_7 fig_4_8 fig_4_9 foot_density numbers table_4_1",
}
"""Modules with items, by chapter."""
MAX_SEEDS: Final = 200


def _collect_items() -> Mapping[str, Item]:
    """Items by name: figures and tables with a number in their order, numbers in the text, then other tables."""
    modules = [
        import_module(f"stridelab.reproduction.chapter{chapter}.{name}")
        for chapter, names in _MODULES.items()
        for name in names.split()
    ]
    items = [value for module in modules for value in vars(module).values() if isinstance(value, Item)]
    kinds = ("fig", "table", "numbers")

    def position(item: Item) -> tuple[int, list[int]]:
        kind = item.name.partition("-")[0]
        return kinds.index(kind) if kind in kinds else len(kinds), [int(n) for n in re.findall(r"\d+", item.name)]

    return MappingProxyType({item.name: item for item in sorted(items, key=position)})


ITEMS: Final = _collect_items()


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
    return item(repeats, tell)
