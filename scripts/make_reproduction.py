"""Compute all figures of the thesis and write docs/reproduction.md; usage: make_reproduction.py [SEEDS]."""

import sys
from pathlib import Path

from stridelab.experiments.reproduction.item import Claim
from stridelab.experiments.reproduction.registry import ITEMS, reproduce

PAGE = Path(__file__).parents[1] / "docs" / "reproduction.md"
WORDS = {"met": "met", "beaten": "beaten", "not_met": "**not met**", "thesis_in_error": "thesis in error"}


def page(seeds: int) -> str:
    """The whole page."""
    lines = [
        "# Reproduction",
        "",
        f"Written by `scripts/make_reproduction.py {seeds}`: every figure, with {seeds} draws of the noise where",
        "there is any. `stridelab reproduce ITEM` computes one of them, with its tables and the drawing. *Met*: as the",
        "thesis says. *Beaten*: beyond the thesis, by an aim of our own. *Thesis in error*: it cannot hold as stated.",
    ]
    for item in ITEMS.values():
        found = reproduce(item.name, seeds, lambda _fraction, _message: None)
        lines += [
            "",
            f"## {item.name}: {item.title}",
            "",
            found.note,
            "",
            "| claim | thesis | ours | |",
            "| --- | --- | --- | --- |",
        ]
        lines += [row(claim) for claim in found.claims]
        lines += ["", *(f"- {claim.says}: {claim.note}" for claim in found.claims if claim.note)]
    return "\n".join(lines) + "\n"


def row(claim: Claim) -> str:
    """One claim as a row of the table."""
    thesis = claim.thesis if isinstance(claim.thesis, str) else f"{claim.thesis:.3g}"
    unit = "" if claim.unit == "1" else f" {claim.unit}"
    return f"| {claim.says.replace('|', 'or')} | {thesis} | {claim.ours:.3g}{unit} | {WORDS[claim.verdict]} |"


if __name__ == "__main__":
    PAGE.write_text(page(int(sys.argv[1]) if len(sys.argv) > 1 else 50), encoding="utf-8")
