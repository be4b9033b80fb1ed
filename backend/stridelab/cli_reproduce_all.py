"""``stridelab reproduce --all``: every figure, table and number of the thesis in one HTML report."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from rich.markup import escape

from stridelab.cli_console import err, out, progress_bar
from stridelab.cli_output import cannot_write, write_file
from stridelab.cli_reproduce import WORDS
from stridelab.errors import Fault, InvalidInput
from stridelab.experiments.reproduction.as_html import report
from stridelab.experiments.reproduction.collected import FEW_SEEDS, Section, collect, recipes
from stridelab.experiments.reproduction.in_words import counted
from stridelab.experiments.reproduction.item import VERDICTS
from stridelab.experiments.reproduction.kept import Kept
from stridelab.experiments.reproduction.registry import ITEMS, MOST_SEEDS
from stridelab.service.jobs.kinds.provenance import versions

FOLDER: Final = Path("reproduction")
REPORT: Final = "reproduction.html"
KEPT: Final = "kept"


def reproduce_all(
    names: Iterable[str] = tuple(ITEMS),
    *,
    seeds: int | None,
    quick: bool,
    recordings: Path | None,
    out_dir: Path | None,
    anew: bool,
    as_json: bool,
) -> bool:
    """Compute what the folder does not keep already, write the report, show the counts; whether no item failed.

    Raises ``InvalidInput``: ``option-invalid`` for a number of draws that makes no sense, or two of them;
    ``output-not-writable``.
    """
    draws = _draws(seeds, quick=quick)
    target = (out_dir or FOLDER).expanduser()
    try:
        (target / KEPT).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(target, error) from error
    sections = []
    with progress_bar("reproduction") as bar:
        for section in collect(recipes(names, draws, recordings), Kept(target / KEPT), bar, anew=anew):
            sections.append(section)
            if section.found is None:
                err.print(f"[bold red]failed[/]: {section.name}: {escape(section.failure)}")
    write_file(target / REPORT, report(sections, _made(draws)), force=True, option="--out")
    show_sections(sections, target / REPORT, as_json=as_json)
    return all(section.found is not None for section in sections)


def show_sections(sections: Sequence[Section], target: Path, *, as_json: bool) -> None:
    """Counts of all verdicts and where the report lies, or the same as JSON with one verdict per item."""
    counts = counted(claim for section in sections if section.found for claim in section.found.claims)
    if as_json:
        items = {section.name: section.found.verdict if section.found else "failed" for section in sections}
        out.print_json(json.dumps({"report": str(target), "claims": counts, "items": items}))
        return
    said = ", ".join(f"{counts[verdict]} {WORDS[verdict]}" for verdict in reversed(VERDICTS))
    out.print(f"{sum(counts.values())} claims of {len(sections)} items: {said}")
    out.print(f"[green]written[/] {escape(str(target))}")


def _draws(seeds: int | None, *, quick: bool) -> int | None:
    if quick and seeds is not None:
        raise _invalid("--quick", "it is a number of draws; leave one of --seeds and --quick out")
    if seeds is not None and not 1 <= seeds <= MOST_SEEDS:
        raise _invalid("--seeds", f"must lie between 1 and {MOST_SEEDS}, not {seeds}")
    return FEW_SEEDS if quick else seeds


def _invalid(option: str, message: str) -> InvalidInput:
    return InvalidInput("option-invalid", "An option has a value that makes no sense.", [Fault(option, message)])


def _made(draws: int | None) -> str:
    known = versions()
    said = "each item's own number of draws" if draws is None else f"{draws} draws of the noise where there is any"
    return f"Computed by stridelab {known['stridelab']} (Python {known['python']}, numpy {known['numpy']}) with {said}."
