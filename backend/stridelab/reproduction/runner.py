"""Computation of items with a result cache; a failed item is reported and does not stop the others."""

import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from stridelab.conventions import Progress
from stridelab.errors import NotFound, StridelabError
from stridelab.machine.parallel import map_isolated
from stridelab.reproduction.chapter2 import fig_2_8_people, fig_2_9_people, table_real_walks
from stridelab.reproduction.chapter3 import height_people, people_figures
from stridelab.reproduction.chapter4 import people_weights
from stridelab.reproduction.claims import PeopleItem, Reproduction, Sampling, place_of, sampling_text
from stridelab.reproduction.registry import ITEMS, command_of, item_of, seeds_of
from stridelab.reproduction.result_cache import ResultCache, digest_of, digest_of_recordings

_MODULES: Final = (fig_2_8_people, fig_2_9_people, table_real_walks, people_weights, height_people)
PEOPLE: Final[Mapping[str, PeopleItem]] = {
    each.name: each
    for each in (
        *(PeopleItem(of.NAME, of.TITLE, of.run, of.__name__, of.PRINTED) for of in _MODULES),
        *people_figures.PEOPLE_ITEMS,
    )
}
SEEDED: Final = {of.NAME: of.run for of in (table_real_walks, people_weights, height_people)}
"""Items on people that draw one sample at random, by name: people, postures, errors of plates."""
"""Items on real recordings by name, computed only if the recordings are available."""
QUICK_SEEDS: Final = 3
"""Number of draws for a quick run."""
ONE_SEED: Final = range(1)
SHARING: Final = (
    ("errors", "fig-2.7", "lag", "coverage"),
    ("fig-3.6", "fig-3.7", "fig-3.8", "fig-3.9"),
)
"""Items that stand on the same draws, which a process computes once."""


@dataclass(frozen=True)
class Section:
    """Result of one item, or the error message if it failed.

    ``sampling`` says what it draws and how often, ``command`` is the command line that computes it again, ``code`` the
    digest of the code and models that computed it (``Recipe.code``).
    """

    name: str
    title: str
    sampling: str
    printed: tuple[str, ...]
    result: Reproduction | None
    failure: str = ""
    command: str = ""
    code: str = ""


@dataclass(frozen=True)
class Recipe:
    """Instructions to compute one item: the seeds of its draws, its module and the function to call.

    ``recordings`` is the ``digest_of_recordings`` of an item on people.
    """

    name: str
    title: str
    sampling: str
    seeds: range
    printed: tuple[str, ...]
    module: str
    run: Callable[[Progress], Reproduction]
    command: str = ""
    recordings: str = ""

    @property
    def code(self) -> str:
        """Digest of the code and of the models."""
        return digest_of(self.module)

    @property
    def source_digest(self) -> str:
        """Digest of the code, and of the recordings if the item is computed from some."""
        return self.code + self.recordings


def recipes_of(
    names: Iterable[str], seeds: int | None, recordings: Path | None, seed: int | None = None
) -> list[Recipe]:
    """Recipes of items by name; ``seeds`` None uses the default of each item, items that draw nothing take neither.

    ``recordings`` is a folder with real recordings in ``gait/``, which the items on people need. Raises ``NotFound``:
    ``item-not-found`` for an unknown name, ``recordings-missing`` for an item on people without the folder.
    """
    wanted = list(names)
    given = "" if recordings is None or PEOPLE.keys().isdisjoint(wanted) else digest_of_recordings(recordings / "gait")
    return [
        _recipe_on_people(PEOPLE[name], recordings, given, seed or 0)
        if name in PEOPLE
        else recipe_of(name, seeds, seed)
        for name in wanted
    ]


def _recipe_on_people(item: PeopleItem, recordings: Path | None, given: str, seed: int) -> Recipe:
    if recordings is None:
        raise NotFound("recordings-missing", f"{item.name} needs recordings of people: name their folder.")
    draws: Sampling = "one" if item.name in SEEDED else "nothing"
    seeds = range(seed, seed + 1) if item.name in SEEDED else ONE_SEED
    option = f" --seed {seed}" if item.name in SEEDED else ""
    return Recipe(
        item.name,
        item.title,
        sampling_text(draws, seeds),
        seeds,
        item.printed,
        item.module,
        partial(_run_on_people, item, recordings / "gait", seeds[0]),
        f"stridelab reproduce {item.name} --recordings FOLDER{option}",
        given,
    )


def _run_on_people(item: PeopleItem, gait: Path, seed: int, tell: Progress) -> Reproduction:
    seeded = SEEDED.get(item.name)
    result = item.run(gait, tell) if seeded is None else seeded(gait, tell, seed)
    return result.with_basis("people", 1, place_of(item.name))


def recipe_of(name: str, seeds: int | None, seed: int | None = None) -> Recipe:
    """Recipe of one item among many: without the options that it does not take, with as many draws as it needs.

    Raises ``NotFound`` (``item-not-found``).
    """
    item = item_of(name)
    count = None if seeds is None or item.draws != "many" else max(seeds, item.min_seeds)
    drawn = seeds_of(item, count, seed if item.draws != "nothing" else None)
    sampling = sampling_text(item.draws, drawn)
    run, command = partial(item, drawn), command_of(item, drawn)
    return Recipe(name, item.title, sampling, drawn, item.printed, item.run.__module__, run, command)


def collect_sections(
    recipes: Sequence[Recipe], cache: ResultCache, tell: Progress, *, recompute: bool = False, processes: int = 1
) -> Iterator[Section]:
    """Compute the items and yield their sections in order; ``recompute`` ignores cached results.

    With several ``processes``, each item has its own, on this machine or on a node of the cluster (``parallel``), but
    for items that share draws (``SHARING``), and the progress counts items. Failures are not cached.
    """
    results: dict[int, Reproduction | str] = {}
    digests = [each.source_digest for each in recipes]
    for number, each in enumerate(recipes):
        cached = None if recompute else cache.load_result(each.name, each.seeds, digests[number])
        if cached is not None:
            results[number] = cached
    missing = [number for number in range(len(recipes)) if number not in results]
    compute = _compute_in_processes(processes) if processes > 1 and len(missing) > 1 else _compute_here
    computed = compute([recipes[number] for number in missing], _share_of(tell, len(results), len(recipes)))
    for number, each in enumerate(recipes):
        while number not in results:
            index, result = next(computed)
            results[missing[index]] = result
            if isinstance(result, Reproduction):
                done = recipes[missing[index]]
                cache.save_result(done.name, done.seeds, digests[missing[index]], result, done.printed)
        result = results[number]
        found, failure = (None, result) if isinstance(result, str) else (result, "")
        yield Section(each.name, each.title, each.sampling, each.printed, found, failure, each.command, each.code)


def _share_of(tell: Progress, cached: int, total: int) -> Progress:
    """Progress of the items that are not cached, as part of all."""

    def tell_all(computed: float, message: str) -> None:
        tell((cached + computed) / total, message)

    return tell_all


def _compute_here(recipes: Sequence[Recipe], tell: Progress) -> Iterator[tuple[int, Reproduction | str]]:
    for number, each in enumerate(recipes):

        def tell_item(fraction: float, message: str, number: int = number, name: str = each.name) -> None:
            tell(number + fraction, f"{name}: {message}")

        tell_item(0.0, "starting")
        yield number, _result_or_failure(each.run, tell_item)


def _compute_in_processes(
    processes: int,
) -> Callable[[Sequence[Recipe], Progress], Iterator[tuple[int, Reproduction | str]]]:
    def compute(recipes: Sequence[Recipe], tell: Progress) -> Iterator[tuple[int, Reproduction | str]]:
        groups = group_sharing([each.name for each in recipes])
        orders = [
            [(recipes[k].name, recipes[k].seeds, None if recipes[k].name in ITEMS else recipes[k].run) for k in group]
            for group in groups
        ]
        preload = (item_of.__module__,)
        finished = map_isolated(_compute_orders, orders, preload=preload, processes=processes, codec=pickle)
        tell(0.0, f"{len(recipes)} items")
        count = 0
        for number, answers in finished:
            for place, index in enumerate(groups[number]):
                count += 1
                tell(float(count), f"{recipes[index].name}: done")
                yield index, answers.message if isinstance(answers, StridelabError) else answers[place]

    return compute


def group_sharing(names: Sequence[str]) -> list[list[int]]:
    """Indices of items that are computed in one process; the longest groups come first (``SHARING``)."""
    groups = [[k for k, name in enumerate(names) if name in sharing] for sharing in SHARING]
    alone = [[k] for k, name in enumerate(names) if not any(name in sharing for sharing in SHARING)]
    return [group for group in groups if group] + alone


_Order = tuple[str, range, Callable[[Progress], Reproduction] | None]


def _compute_orders(orders: Sequence[_Order]) -> list[Reproduction | str]:
    return [
        _result_or_failure(run or partial(item_of(name), seeds), lambda _fraction, _message: None)
        for name, seeds, run in orders
    ]


def _result_or_failure(run: Callable[[Progress], Reproduction], tell: Progress) -> Reproduction | str:
    """The result, or the message of the error."""
    try:
        return run(tell)
    except StridelabError as error:
        return error.message
    except Exception as error:  # noqa: BLE001 (a failed item does not stop the others)
        return f"{type(error).__name__}: {error}"
