"""Sequential computation of items with a result cache; a failed item is reported and does not stop the others."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from stridelab.conventions import Progress
from stridelab.errors import StridelabError
from stridelab.reproduction.chapter2 import fig_2_8_people, table_real_walks
from stridelab.reproduction.chapter3 import wheel_people
from stridelab.reproduction.claims import Reproduction, sampling_text
from stridelab.reproduction.registry import item_of, seeds_of
from stridelab.reproduction.result_cache import ResultCache, digest_of

_PEOPLE_MODULES: Final = (fig_2_8_people, table_real_walks, wheel_people)
PEOPLE: Final = tuple(module.NAME for module in _PEOPLE_MODULES)
"""Items on real recordings, computed only if the recordings are available."""
QUICK_SEEDS: Final = 3
"""Number of draws for a quick run."""
ONE_SEED: Final = range(1)


@dataclass(frozen=True)
class Section:
    """Result of one item, or the error message if it failed; ``sampling`` says what it draws and how often."""

    name: str
    title: str
    sampling: str
    printed: tuple[str, ...]
    result: Reproduction | None
    failure: str = ""


@dataclass(frozen=True)
class Recipe:
    """Instructions to compute one item: the seeds of its draws, its module and the function to call."""

    name: str
    title: str
    sampling: str
    seeds: range
    printed: tuple[str, ...]
    module: str
    run: Callable[[Progress], Reproduction]


def recipes_of(
    names: Iterable[str], seeds: int | None, recordings: Path | None, seed: int | None = None
) -> list[Recipe]:
    """Recipes of items by name; ``seeds`` None uses the default of each item, items that draw nothing take neither.

    ``recordings`` is a folder with real recordings in ``gait/`` and adds the items on them. Raises ``NotFound``
    (``item-not-found``) for an unknown name.
    """
    selected = [recipe_of(name, seeds, seed) for name in names]
    if recordings is not None:
        selected += [
            Recipe(
                each.NAME,
                each.TITLE,
                sampling_text("nothing", ONE_SEED),
                ONE_SEED,
                each.PRINTED,
                each.__name__,
                partial(each.run, recordings / "gait"),
            )
            for each in _PEOPLE_MODULES
        ]
    return selected


def recipe_of(name: str, seeds: int | None, seed: int | None = None) -> Recipe:
    """Recipe of one item, without the options that it does not take. Raises ``NotFound`` (``item-not-found``)."""
    item = item_of(name)
    drawn = seeds_of(item, seeds if item.draws == "many" else None, seed if item.draws != "nothing" else None)
    sampling = sampling_text(item.draws, drawn)
    return Recipe(name, item.title, sampling, drawn, item.printed, item.run.__module__, partial(item, drawn))


def collect_sections(
    recipes: Sequence[Recipe], cache: ResultCache, tell: Progress, *, recompute: bool = False
) -> Iterator[Section]:
    """Compute the items and yield their sections; ``recompute`` ignores cached results. Failures are not cached."""
    for number, each in enumerate(recipes):

        def tell_item(fraction: float, message: str, number: int = number, name: str = each.name) -> None:
            tell((number + fraction) / len(recipes), f"{name}: {message}")

        yield _compute_section(each, cache, tell_item, recompute=recompute)


def _compute_section(recipe: Recipe, cache: ResultCache, tell: Progress, *, recompute: bool) -> Section:
    digest = digest_of(recipe.module)
    result = None if recompute else cache.load_result(recipe.name, recipe.seeds, digest)
    failure = ""
    if result is None:
        tell(0.0, "starting")
        try:
            result = recipe.run(tell)
            cache.save_result(recipe.name, recipe.seeds, digest, result, recipe.printed)
        except StridelabError as error:
            failure = error.message
        except Exception as error:  # noqa: BLE001 (a failed item does not stop the others)
            failure = f"{type(error).__name__}: {error}"
    return Section(recipe.name, recipe.title, recipe.sampling, recipe.printed, result, failure)
