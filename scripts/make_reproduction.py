"""Compute every figure and table of the reproduction and write docs/reproduction.md.

    make_reproduction.py                 50 draws of the noise: 25 minutes on one core
    make_reproduction.py --quick         3 draws, for a first look
    make_reproduction.py --only errors   computes that item and keeps it, without writing the page
    make_reproduction.py --update errors computes that item and replaces its section; the others stay as they are
    make_reproduction.py --real FOLDER   with the items on real recordings in FOLDER/gait (or STRIDELAB_TEST_DATA)

What is computed is kept in .data/reproduction, under a digest of the code and data that computed it: a run that was
interrupted goes on where it stopped, and what a change of the code can have moved is computed anew.
"""

import argparse
import os
import sys
import time
from pathlib import Path

from experiments.reproduction_page import BLOCKS, insert_block, render_markdown, replace_sections
from stridelab.machine.parallel import PROCESSES_MAX, available_processes
from stridelab.reproduction.registry import ITEMS
from stridelab.reproduction.result_cache import ResultCache
from stridelab.reproduction.runner import PEOPLE, QUICK_SEEDS, Section, collect_sections, recipes_of

ROOT = Path(__file__).parents[1]
PAGE, KEPT = ROOT / "docs" / "reproduction.md", ROOT / ".data" / "reproduction"
SEEDS = 50


def main() -> None:
    """Read the command line, compute, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--quick", action="store_const", const=QUICK_SEEDS, dest="seeds", help=f"{QUICK_SEEDS} draws")
    parser.add_argument("--only", nargs="+", choices=[*ITEMS, *PEOPLE], help="compute these, write no page")
    parser.add_argument("--real", type=Path, default=os.environ.get("STRIDELAB_TEST_DATA"), metavar="FOLDER")
    parser.add_argument("--update", nargs="+", default=[], choices=[*ITEMS, *PEOPLE], help="compute and replace these")
    parser.add_argument("--seed", type=int, default=0, help="first seed of the draws")
    arguments = parser.parse_args()
    chosen = [*(arguments.only or ()), *arguments.update]
    folder = None if arguments.real is None else Path(arguments.real)
    names = chosen or [*ITEMS, *(PEOPLE if folder else ())]
    wanted = recipes_of(names, arguments.seeds, folder, arguments.seed)
    sections = []
    processes = min(available_processes(), PROCESSES_MAX)
    start = time.monotonic()
    for section in collect_sections(wanted, ResultCache(KEPT), lambda _f, _m: None, processes=processes):
        sections.append(section)
        sys.stderr.write(f"{section.name}: {section.failure or f'{time.monotonic() - start:.0f} s'}\n")
        start = time.monotonic()
    if any(section.result is None for section in sections):
        sys.exit("An item failed; the page stays as it was.")
    if arguments.update:
        updated = [section for section in sections if section.name in arguments.update]
        PAGE.write_text(replace_sections(PAGE.read_text(encoding="utf-8"), updated), encoding="utf-8")
    elif not arguments.only:
        PAGE.write_text(render_markdown(head(sections, arguments.seeds), sections), encoding="utf-8")
    if not arguments.only:
        renew_blocks()


def renew_blocks() -> None:
    """Write the tables of other pages that repeat numbers of this one."""
    page = PAGE.read_text(encoding="utf-8")
    for name, (table, block_of) in BLOCKS.items():
        other = PAGE.parent / name
        other.write_text(insert_block(other.read_text(encoding="utf-8"), table, block_of(page)), encoding="utf-8")


def head(sections: list[Section], seeds: int) -> str:
    """Introduction of the page."""
    missing = "\nThe recordings were not at hand, so that the sections on people are missing."
    note = "" if any(section.name in PEOPLE for section in sections) else missing
    return f"""# Reproduction

Written by `scripts/make_reproduction.py --seeds {seeds}`, single sections anew by `--update`: every figure and table,
and the numbers of the text. Each section says what it draws at random and how often, and the command that computes it
again. `stridelab reproduce ITEM` computes one
of them, with all its tables and the drawing, `stridelab reproduce --all` all of them as one report.

Every claim has its place in the thesis: section, figure or table; the text at hand has no page numbers. Chapter 3 on
people is in the thesis' words, the others are shortened. Verdicts are computed from the column *holds if*: a number in
its range is *met*, or *better* where it is better than claimed; outside it is *not met*, or *thesis in error* where the
claim cannot hold as stated; and *undecided* if the 95 % interval is neither inside nor outside. A number (with an
interval: an interval) on the other side overturns a verdict. The bounds of the range are the *thesis'* printed number,
follow from *its words* without a number of ours (a sign, an order, equality up to rounding or sampling error), or are
*our aim*: with another aim of the reader's the verdict may change. *our aim: reached* and *missed* stand on claims that
the thesis does not make. The last column says what our number is computed from: *simulated* (models and simulated
recordings), *replayed* (motions carried out in a physics simulation), *people* (recordings of people) or *external*
(numbers published by others); n is the number of cases behind it (draws, steps, people, contact sets, plans).

Where cases are drawn, an interval of 95 % stands beside the number: by 2000 bootstrap samples of the draws, people,
steps or contact sets, the binomial one (Clopper and Pearson) for a share, that of Fisher for a correlation. A claim on
every case (*always*, *for all the subjects*) stands on the most extreme one, which has no such interval: a sample can
refute it and not prove it, so its verdict is that of the sample, beside the number of cases in the range and the
interval of their share. Where there is neither, the row says why: *deterministic* (nothing is drawn), *sampling error
is in the claim* (a probability, a bound in standard errors), one case, one sample of fixed size, a time of one machine.

The recordings of adults are a part (11 of 50 people) of the data of Schreiber and Moissenet 2019
(doi 10.1038/s41597-019-0124-4), published at doi 10.6084/m9.figshare.7734767; put the folders of the people below
FOLDER/gait/rehazenter-adult-walking. Fukuchi et al. 2018 (doi 10.7717/peerj.4640) has 42 more, not used here. The
runners are those of Hamner and Delp 2013 (doi 10.1016/j.jbiomech.2012.11.024, published at
simtk.org/projects/nmbl_running): Run_2.trc to Run_5.trc, Run_2_grf.mot to Run_5_grf.mot and static.trc of each person
in a folder below FOLDER/gait/running.{note}
"""


if __name__ == "__main__":
    main()
