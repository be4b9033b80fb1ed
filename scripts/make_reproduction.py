"""Compute every figure and table of the reproduction and write docs/reproduction.md.

    make_reproduction.py                     50 draws of the noise; the page says how long the last run took
    make_reproduction.py --quick             3 draws, for a first look
    make_reproduction.py --only errors       computes that item and keeps it, without writing the page
    make_reproduction.py --update errors     computes that item and replaces its section; the others stay as they are
    make_reproduction.py --real FOLDER       with the items on real recordings in FOLDER/gait (or STRIDELAB_TEST_DATA)
    make_reproduction.py --other-seeds 1000  computes what draws at random with these seeds too, and says on the page
                                             which verdicts are others
    make_reproduction.py --tables            writes the tables of other pages that repeat numbers of the page, no more
    make_reproduction.py --stale             names the sections whose code or models have changed since

What is computed is kept in .data/reproduction, under a digest of the code and data that computed it: a run that was
interrupted goes on where it stopped, and what a change of the code can have moved is computed anew.
"""

import argparse
import contextlib
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

from arrange_recordings import digest_of_contents
from experiments.reproduction_blocks import BLOCKS
from experiments.reproduction_page import (
    codes_of,
    insert_block,
    other_seeds_block,
    render_markdown,
    replace_sections,
)
from stridelab.machine.cluster import has_cluster
from stridelab.machine.parallel import PROCESSES_MAX, available_processes
from stridelab.reproduction.claims import WORDS
from stridelab.reproduction.registry import ITEMS
from stridelab.reproduction.report.formatting import count_outcomes
from stridelab.reproduction.result_cache import ResultCache, digest_of
from stridelab.reproduction.runner import PEOPLE, QUICK_SEEDS, Recipe, Section, collect_sections, recipes_of

ROOT = Path(__file__).parents[1]
PAGE, KEPT = ROOT / "docs" / "reproduction.md", ROOT / ".data" / "reproduction"
SEEDS = 50
OTHER_SEEDS = "other-seeds"


def main() -> None:
    """Read the command line, compute, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--quick", action="store_const", const=QUICK_SEEDS, dest="seeds", help=f"{QUICK_SEEDS} draws")
    parser.add_argument("--only", nargs="+", choices=[*ITEMS, *PEOPLE], help="compute these, write no page")
    parser.add_argument("--real", type=Path, default=os.environ.get("STRIDELAB_TEST_DATA"), metavar="FOLDER")
    parser.add_argument("--update", nargs="+", default=[], choices=[*ITEMS, *PEOPLE], help="compute and replace these")
    parser.add_argument("--seed", type=int, default=0, help="first seed of the draws")
    parser.add_argument("--other-seeds", type=int, metavar="SEED", help="compare with the verdicts of other seeds")
    parser.add_argument("--stale", action="store_true", help="name the sections whose code has changed")
    parser.add_argument("--tables", action="store_true", help="write the tables of other pages from the page as it is")
    arguments = parser.parse_args()
    if arguments.tables:
        renew_blocks()
        return
    if arguments.stale:
        sys.stdout.writelines(f"{name}\n" for name in stale_sections(PAGE.read_text(encoding="utf-8")))
        return
    chosen = [*(arguments.only or ()), *arguments.update]
    folder = None if arguments.real is None else Path(arguments.real)
    names = chosen or [*ITEMS, *(PEOPLE if folder else ())]
    wanted = recipes_of(names, arguments.seeds, folder, arguments.seed)
    sections, cost = compute_all(wanted)
    page = PAGE.read_text(encoding="utf-8")
    if arguments.update:
        updated = [section for section in sections if section.name in arguments.update]
        page = replace_sections(page, updated)
    elif not arguments.only:
        page = render_markdown(page_head(sections, arguments.seeds, folder, cost), sections)
    if arguments.other_seeds is not None:
        drawing = [name for name in names if name in ITEMS and ITEMS[name].draws != "nothing"]
        others, _ = compute_all(recipes_of(drawing, arguments.seeds, folder, arguments.other_seeds))
        page = insert_block(page, OTHER_SEEDS, other_seeds_block(sections, others))
    if not arguments.only:
        PAGE.write_text(page, encoding="utf-8")
        renew_blocks()


@dataclass(frozen=True)
class RunCost:
    """What a run computed, and the time that it took; what it found in the cache costs nothing.

    ``processor_s`` is None where nodes of a cluster computed, whose time is not measured.
    """

    items: int
    computed: int
    processes: int
    elapsed_s: float
    processor_s: float | None

    def sentence(self) -> str:
        """The cost in a sentence of the page."""
        what = f"all {self.items}" if self.computed == self.items else f"{self.computed} of {self.items}"
        time_of = f"{_minutes(self.elapsed_s)} minutes in up to {self.processes} processes at a time"
        processor = "" if self.processor_s is None else f", and {_minutes(self.processor_s)} minutes of processor time"
        cached = "" if self.computed == self.items else "; the others had been computed before, by the same code"
        return f"The run computed {what} items in {time_of}{processor}{cached}."


def _minutes(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02}"


def measure_processor_s() -> float:
    """Processor time so far of this process and of all that it started, seconds.

    Of processes that still run (the server from which others are forked) it counts what they have waited for, too.
    """
    here = psutil.Process()
    spent_s = 0.0
    for process in (here, *here.children()):
        with contextlib.suppress(psutil.NoSuchProcess):  # it has ended meanwhile
            times = process.cpu_times()
            spent_s += times.user + times.system + times.children_user + times.children_system
    return spent_s


def compute_all(wanted: list[Recipe]) -> tuple[list[Section], RunCost]:
    """Sections of all items, and what they cost; ends the program if one failed."""
    sections = []
    processes = min(available_processes(), PROCESSES_MAX)
    cache = ResultCache(KEPT)
    computed = sum(cache.load_result(each.name, each.seeds, each.source_digest) is None for each in wanted)
    start = begin = time.monotonic()
    processor_s = measure_processor_s()
    for section in collect_sections(wanted, cache, lambda _f, _m: None, processes=processes):
        sections.append(section)
        sys.stderr.write(f"{section.name}: {section.failure or f'{time.monotonic() - start:.0f} s'}\n")
        start = time.monotonic()
    if any(section.result is None for section in sections):
        sys.exit("An item failed; the page stays as it was.")
    spent_s = None if has_cluster() else measure_processor_s() - processor_s
    return sections, RunCost(len(wanted), computed, processes, time.monotonic() - begin, spent_s)


def stale_sections(page: str) -> list[str]:
    """Sections that other code or models have computed than there are now."""
    modules = {name: item.run.__module__ for name, item in ITEMS.items()}
    modules |= {name: item.module for name, item in PEOPLE.items()}
    return [name for name, code in codes_of(page).items() if code != digest_of(modules[name])]


def renew_blocks() -> None:
    """Write the tables of other pages that repeat numbers of this one."""
    page = PAGE.read_text(encoding="utf-8")
    for (name, table), block_of in BLOCKS.items():
        other = PAGE.parent / name
        other.write_text(insert_block(other.read_text(encoding="utf-8"), table, block_of(page)), encoding="utf-8")


def page_head(sections: list[Section], seeds: int, recordings: Path | None, cost: RunCost) -> str:
    """Introduction of the page."""
    missing = "\nThe recordings were not at hand, so that the sections on people are missing."
    if recordings is None:
        note = missing
    else:
        files, digest = digest_of_contents(recordings / "gait")
        note = f"""
The sections on people are computed from {files} files: SHA-256 of their names and contents, as `arrange_recordings.py`
prints it, `{digest}`."""
    outcomes = count_outcomes(claim for of in sections if of.result is not None for claim in of.result.claims)
    counted = ", ".join(f"{outcomes[key]} {words}" for key, words in WORDS.items())
    return f"""# Reproduction

Written by one run of `scripts/make_reproduction.py --seeds {seeds} --real FOLDER`; where single sections are renewed
by `--update`, their digest of code and models says so. It has every figure and table, and the numbers of the text,
in {sum(outcomes.values())} claims when it was written whole:
{counted}.
Each section says what it draws at random and how often, the command that computes it again, and the digest of the code
and models that computed it; `--stale` names those whose code has changed since. `stridelab reproduce ITEM` computes one
of them, with all its tables and the drawing, `stridelab reproduce --all --recordings FOLDER` all of them as one report.
{cost.sentence()}

Every claim has its place in the thesis: section, figure or table; the text at hand has no page numbers. Chapter 3 on
people is in the thesis' words, the others are shortened. Verdicts are computed from the column *holds if*: a number in
its range is *met*, or *better* where it is better than claimed; outside it is *not met*, or *thesis in error* where the
claim cannot hold as stated; and *undecided* if the 95 % interval is neither inside nor outside. A number (with an
interval: an interval) on the other side overturns a verdict. The bounds of the range are the *thesis'* printed number,
follow from *its words* without a number of ours (a sign, an order, equality up to rounding or sampling error), or are
*our aim*: with another aim of the reader's the verdict may change, so none of these says *thesis in error*. *our aim:
reached*, *undecided* and *missed* stand on claims that the thesis does not make. The last column says what our number
is computed from: *simulated* (models and simulated recordings), *replayed* (motions carried out in a physics
simulation), *people* (recordings of people) or *external* (numbers published by others); n is the number of cases
behind it (draws, steps, people, contact sets, plans).

Where cases are drawn, an interval of 95 % stands beside the number: by 2000 bootstrap samples of the draws, people,
steps or contact sets, the binomial one (Clopper and Pearson) for a share, that of Fisher for a correlation; in figure
4.5 that of a density and a share, for three contact sets at once. A claim on
every case (*always*, *for all the subjects*) stands on the most extreme one, which has no such interval: a sample can
refute it and not prove it, so its verdict is that of the sample, beside the number of cases in the range and the
interval of their share. Where there is neither, the row says why: *deterministic* (nothing is drawn), *sampling error
is in the claim* (a probability, a bound in standard errors), one case, one sample of fixed size, a time of one machine.

The adults are 18 of the 50 people of Schreiber and Moissenet 2019 (doi 10.1038/s41597-019-0124-4, all of them at doi
10.6084/m9.figshare.7734767), the runners those of Hamner and Delp 2013 (doi 10.1016/j.jbiomech.2012.11.024), both as
published with [zmp-opensim](https://github.com/aaronsfox/zmp-opensim) (commit 45c579c), the children the sample study
of [biomechZoo](https://github.com/mcgillmotionlab/biomechzoo) (7daadbc), the stairs those of
[pyCGM](https://github.com/cadop/pyCGM) (1750a62). Fukuchi et al. 2018 (doi 10.7717/peerj.4640) has 42 more, not used
here. These commands put the recordings below FOLDER:

```text
git clone https://github.com/aaronsfox/zmp-opensim clones/zmp-opensim
git clone https://github.com/mcgillmotionlab/biomechzoo clones/biomechzoo
git clone https://github.com/cadop/pyCGM clones/pyCGM
python3 scripts/arrange_recordings.py clones FOLDER
```
{note}

<!-- {OTHER_SEEDS} of reproduction.md -->

<!-- end of {OTHER_SEEDS} -->
"""


if __name__ == "__main__":
    main()
