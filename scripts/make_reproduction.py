"""Compute every figure and table of the reproduction and write docs/reproduction.md.

    make_reproduction.py                 50 draws of the noise: 25 minutes on one core
    make_reproduction.py --quick         3 draws, for a first look
    make_reproduction.py --only errors   computes that item and keeps it, without writing the page
    make_reproduction.py --real FOLDER   with the table of real recordings in FOLDER/gait (or STRIDELAB_TEST_DATA)

What is computed is kept in .data/reproduction, under a digest of the code that computed it: a run that was interrupted
goes on where it stopped, and a change of the code begins anew.
"""

import argparse
import hashlib
import json
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stridelab.experiments.reproduction import real
from stridelab.experiments.reproduction.item import Claim, Column, Reproduction
from stridelab.experiments.reproduction.registry import ITEMS, reproduce

ROOT = Path(__file__).parents[1]
PAGE, KEPT, CODE = ROOT / "docs" / "reproduction.md", ROOT / ".data" / "reproduction", ROOT / "backend" / "stridelab"
COMPUTES = (
    "body",
    "centroidal",
    "contacts",
    "dynamics",
    "estimation",
    "experiments",
    "reachability",
    "recordings",
    "robots",
    "walking",
)
SEEDS, FEW_SEEDS = 50, 3
WORDS = {"met": "met", "beaten": "met", "not_met": "**not met**", "thesis_in_error": "thesis in error"}
UNITS = {"m": ("mm", 1e3), "s": ("ms", 1e3), "n": ("N", 1.0), "s2": ("m/s²", 1.0)}
"""What the last word of a column's name says about its numbers, and how they are printed."""


def main() -> None:
    """Read the command line, compute, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--quick", action="store_const", const=FEW_SEEDS, dest="seeds", help=f"{FEW_SEEDS} draws")
    parser.add_argument("--only", nargs="+", choices=[*ITEMS, real.NAME], help="compute these, write no page")
    parser.add_argument("--real", type=Path, default=os.environ.get("STRIDELAB_TEST_DATA"), metavar="FOLDER")
    asked = parser.parse_args()
    digest = digest_of_code()
    names = asked.only or [*ITEMS, *([real.NAME] if asked.real else [])]
    sections = [section(name, asked.seeds, digest, asked.real) for name in names]
    if not asked.only:
        PAGE.write_text("\n".join([head(asked.seeds, real=bool(asked.real)), *sections]), encoding="utf-8")


def head(seeds: int, *, real: bool) -> str:
    """What the page is."""
    missing = "" if real else "\nThe recordings were not at hand, so that the section on real walks is missing."
    return f"""# Reproduction

Written by `scripts/make_reproduction.py --seeds {seeds}`: every figure and table, with {seeds} draws of the noise where
there is any. `stridelab reproduce ITEM` computes one of them, with all its tables and the drawing. Verdicts are
computed: *met* is what the thesis says, or an aim of our own where the thesis has no number; *thesis in error* cannot
hold as stated.{missing}
"""


def digest_of_code() -> str:
    """Digest of every module that has a part in the numbers."""
    paths = [path for room in COMPUTES for path in sorted((CODE / room).rglob("*.py"))]
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:16]


def section(name: str, seeds: int, digest: str, folder: Path | None) -> str:
    """One item in Markdown, computed unless it is kept."""
    kept = KEPT / f"{name}-{seeds}-{digest}.json"
    if kept.is_file():
        return str(json.loads(kept.read_text(encoding="utf-8"))["section"])
    start = time.monotonic()
    if name == real.NAME:
        title, printed = real.TITLE, real.PRINTED
        found = real.run(Path(folder or "") / "gait", lambda _fraction, _message: None)
    else:
        title, printed = ITEMS[name].title, ITEMS[name].printed
        found = reproduce(name, seeds, lambda _fraction, _message: None)
    text = markdown(name, title, found, printed)
    KEPT.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps({"section": text}), encoding="utf-8")
    sys.stderr.write(f"{name}: {time.monotonic() - start:.0f} s\n")
    return text


def markdown(name: str, title: str, found: Reproduction, printed: tuple[str, ...]) -> str:
    """Heading, note, claims with their remarks, tables."""
    lines = [f"## {name}: {title}", "", found.note, "", "| claim | thesis | ours | |", "| --- | --- | --- | --- |"]
    lines += [row(claim) for claim in found.claims]
    lines += ["", *(f"- {claim.says}: {claim.note}" for claim in found.claims if claim.note)]
    for key in printed:
        lines += ["", *table(found.tables[key])]
    return "\n".join(lines) + "\n"


def row(claim: Claim) -> str:
    """One claim as a row of the table."""
    thesis = claim.thesis if isinstance(claim.thesis, str) else measured(claim.thesis, claim.unit)
    ours = measured(claim.ours, claim.unit)
    return f"| {claim.says.replace('|', 'or')} | {thesis} | {ours} | {WORDS[claim.verdict]} |"


def measured(value: float, unit: str) -> str:
    """To three digits; metres and seconds below a tenth in thousandths, a ratio as a bare number."""
    if unit in ("m", "s") and 0 < abs(value) < 0.1:
        value, unit = 1000 * value, f"m{unit}"
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"


def table(columns: Mapping[str, Column]) -> list[str]:
    """Columns in Markdown; the unit of a name moves into the heading."""
    heads, cells = zip(*(column(name, values) for name, values in columns.items()), strict=True)
    return [
        f"| {' | '.join(heads)} |",
        f"|{' --- |' * len(heads)}",
        *(f"| {' | '.join(line)} |" for line in zip(*cells, strict=True)),
    ]


def column(name: str, values: Column) -> tuple[str, list[str]]:
    """Heading and cells of one column."""
    if values.dtype.kind not in "fi":
        return name.replace("_", " "), [str(value) for value in values]
    stem, _, last = name.rpartition("_")
    unit, scale = UNITS.get(last, ("", 1.0))
    head = stem.removesuffix("_m") if last == "s2" else stem if unit else name
    written = ["" if not np.isfinite(value) else f"{scale * value:.3g}" for value in values.astype(float)]
    return f"{head} {unit}".replace("_", " ").strip(), written


if __name__ == "__main__":
    main()
