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

from experiments.reproduction_page import render_markdown, replace_sections
from stridelab.machine.parallel import PROCESSES_MAX, available_processes
from stridelab.reproduction.registry import ITEMS
from stridelab.reproduction.result_cache import ResultCache
from stridelab.reproduction.runner import PEOPLE, QUICK_SEEDS, Section, collect_sections, recipes_of

ROOT = Path(__file__).parents[1]
PAGE, CACHE = ROOT / "docs" / "reproduction.md", ROOT / ".data" / "reproduction"
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
    selected = [r for r in recipes_of(ITEMS, arguments.seeds, folder, arguments.seed) if not chosen or r.name in chosen]
    sections = []
    processes = min(available_processes(), PROCESSES_MAX)
    start = time.monotonic()
    for section in collect_sections(selected, ResultCache(CACHE), lambda _f, _m: None, processes=processes):
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


def head(sections: list[Section], seeds: int) -> str:
    """Introduction of the page."""
    missing = "\nThe recordings were not at hand, so that the sections on people are missing."
    note = "" if any(section.name in PEOPLE for section in sections) else missing
    return f"""# Reproduction

Written by `scripts/make_reproduction.py --seeds {seeds}`: every figure and table, and the numbers of the text. The
sentence before each table says what the item draws at random, and how often. `stridelab reproduce ITEM` computes one
of them, with all its tables and the drawing, `stridelab reproduce --all` all of them as one report.

Verdicts are computed. *met* is what the thesis says, *better* is better than that, *not met* is worse, and *thesis in
error* cannot hold as stated. *our aim* is a threshold of this project, reached or missed: it is no verdict on the
thesis. The last column says what our number is computed from: *simulated* (models and simulated recordings),
*replayed* (motions carried out in a physics simulation), *people* (recordings of people) or *external* (numbers
published by others); n is the number of cases behind it (draws, steps, people, contact sets, plans).{note}
"""


if __name__ == "__main__":
    main()
