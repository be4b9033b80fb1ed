"""All items one after another, each computed unless it is kept, and the one that fails told instead of the result."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from stridelab.conventions import Progress
from stridelab.errors import StridelabError
from stridelab.reproduction.chapter2 import fig_2_8_people, table_real_walks
from stridelab.reproduction.claims import Reproduction
from stridelab.reproduction.registry import item_of, reproduce
from stridelab.reproduction.result_cache import Kept, digest_of

PEOPLE: Final = (fig_2_8_people.NAME, table_real_walks.NAME)
"""Items on recordings, which are computed where these are."""
FEW_SEEDS: Final = 3
"""Draws for a first look."""


@dataclass(frozen=True)
class Section:
    """One item: what was found, or the sentence that says why nothing was."""

    name: str
    title: str
    seeds: int
    printed: tuple[str, ...]
    found: Reproduction | None
    failure: str = ""


@dataclass(frozen=True)
class Recipe:
    """How one item is computed: the module that does it, and the call."""

    name: str
    title: str
    seeds: int
    printed: tuple[str, ...]
    module: str
    run: Callable[[Progress], Reproduction]


def recipes(names: Iterable[str], seeds: int | None, recordings: Path | None) -> list[Recipe]:
    """Of items by name; ``seeds`` None is each item's own number, ``recordings`` adds people, who are in its gait/.

    Raises ``NotFound`` (``item-not-found``) for a name that is none.
    """
    found = [recipe(name, seeds) for name in names]
    if recordings is not None:
        found += [
            Recipe(each.NAME, each.TITLE, 1, each.PRINTED, each.__name__, partial(each.run, recordings / "gait"))
            for each in (fig_2_8_people, table_real_walks)
        ]
    return found


def recipe(name: str, seeds: int | None) -> Recipe:
    """Of one item. Raises ``NotFound`` (``item-not-found``)."""
    item = item_of(name)
    repeats = item.default_seeds if seeds is None else seeds
    return Recipe(
        name, item.title, repeats, item.printed, item.run.__module__, lambda tell: reproduce(name, repeats, tell)
    )


def collect(wanted: Sequence[Recipe], kept: Kept, tell: Progress, *, anew: bool = False) -> Iterator[Section]:
    """Section by section; ``anew`` computes what is kept, too. Nothing is kept of an item that fails."""
    for number, each in enumerate(wanted):

        def told(fraction: float, message: str, number: int = number, name: str = each.name) -> None:
            tell((number + fraction) / len(wanted), f"{name}: {message}")

        yield _section(each, kept, told, anew=anew)


def _section(each: Recipe, kept: Kept, tell: Progress, *, anew: bool) -> Section:
    digest = digest_of(each.module)
    found = None if anew else kept.load(each.name, each.seeds, digest)
    failure = ""
    if found is None:
        tell(0.0, "starting")
        try:
            found = each.run(tell)
            kept.save(each.name, each.seeds, digest, found, each.printed)
        except StridelabError as error:
            failure = error.message
        except Exception as error:  # noqa: BLE001 (whatever an item does, the others are still computed)
            failure = f"{type(error).__name__}: {error}"
    return Section(each.name, each.title, each.seeds, each.printed, found, failure)
