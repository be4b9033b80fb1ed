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
    4: "fig_4_3 fig_4_5 fig_4_6 fig_4_7 fig_4_8 fig_4_9 foot_density numbers occupancy table_4_1",
}
"""Modules with items, by chapter."""
MAX_SEEDS: Final = 200
MAX_SEED: Final = 1_000_000


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


def seeds_of(item: Item, seeds: int | None, seed: int | None) -> range:
    """Seeds of the random draws of an item: ``seeds`` of them from ``seed`` (0), by default as many as take a minute.

    Raises ``InvalidInput``: ``seeds-out-of-range``; ``nothing-drawn`` if the item draws nothing, or one sample of fixed
    size where ``seeds`` is above 1.
    """
    count, first = item.default_seeds if seeds is None else seeds, seed or 0
    for field, value, low, high in (("seeds", count, item.min_seeds, MAX_SEEDS), ("seed", first, 0, MAX_SEED)):
        if not low <= value <= high:
            message = f"{field} must lie between {low} and {high}, not {value}."
            raise InvalidInput("seeds-out-of-range", message, [Fault(field, message)])
    if item.draws == "nothing" and (seeds is not None or seed is not None):
        message = f"{item.name} draws nothing at random: leave seeds and seed out."
        raise InvalidInput("nothing-drawn", message, [Fault("seed" if seeds is None else "seeds", message)])
    if item.draws == "one" and count > 1:
        message = f"{item.name} draws one sample of fixed size: only its seed can be chosen, not {count} draws."
        raise InvalidInput("nothing-drawn", message, [Fault("seeds", message)])
    return range(first, first + count)


def command_of(item: Item, seeds: range) -> str:
    """The command line that computes an item with the same draws."""
    words = ["stridelab", "reproduce", item.name]
    words += ["--seeds", f"{len(seeds)}"] if item.draws == "many" else []
    words += ["--seed", f"{seeds[0]}"] if item.draws != "nothing" else []
    return " ".join(words)


def reproduce_item(name: str, seeds: int | None, tell: Progress, seed: int | None = None) -> Reproduction:
    """Compute one item with the draws of ``seeds_of``.

    Raises ``NotFound`` (``item-not-found``) and what ``seeds_of`` raises.
    """
    item = item_of(name)
    return item(seeds_of(item, seeds, seed), tell)
