"""``stridelab reproduce``: recomputes a figure or table and writes a result folder.

``stridelab reproduce --all``: every figure, table and number of the thesis in one HTML report.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Final

from rich.markup import escape
from rich.table import Table

from stridelab.cli.estimate import run_job
from stridelab.cli.options import Delivery
from stridelab.cli.results import deliver_result, err, out, progress_bar, show_files
from stridelab.errors import Fault, InvalidInput
from stridelab.machine.parallel import PROCESSES_MAX, available_processes
from stridelab.reproduction.claims import OUTCOMES, WORDS, Claim
from stridelab.reproduction.registry import ITEMS, MAX_SEEDS
from stridelab.reproduction.report.formatting import basis_text, count_outcomes, format_quantity
from stridelab.reproduction.report.html import render_html
from stridelab.reproduction.result_cache import ResultCache
from stridelab.reproduction.runner import PEOPLE, QUICK_SEEDS, SEEDED, Section, collect_sections, recipes_of
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.reproduction import ReproduceInput, ReproduceSummary, ReproduceTask
from stridelab.service.kinds.provenance import software_versions
from stridelab.service.local_runs import cannot_write, validate_options, write_file

CLAIM_FIELDS: Final = {field.name for field in fields(Claim)}
COLOURS: Final = {
    "not_met": "red",
    "aim_missed": "red",
    "thesis_in_error": "yellow",
    "undecided": "yellow",
    "aim_undecided": "yellow",
}
"""Colours of the outcomes; green without an entry."""
OUTCOME_MARKUP: Final = {code: f"[{COLOURS.get(code, 'green')}]{text}[/]" for code, text in WORDS.items()}


def require_one(
    item: str | None,
    *,
    everything: bool,
    quick: bool,
    recordings: Path | None,
    server: str | None,
    drawn: bool = False,
    seeded: bool = False,
) -> str | None:
    """The requested item, or None for all.

    Raises ``InvalidInput`` (``option-invalid``) unless either the item or ``--all`` is given, for options of the other
    one, for an item on people without ``recordings``, and for a number of draws (``drawn``) or a seed (``seeded``) of
    one that takes none.
    """
    wrong = []
    on_people = item in PEOPLE
    if everything == (item is not None):
        wrong.append(Fault("ITEM", "give one item, or --all"))
    if everything and server is not None:
        wrong.append(Fault("--server", "--all computes on this machine; on a server the page /reproduction does"))
    if quick and not everything:
        wrong.append(Fault("--quick", "only with --all"))
    if recordings is not None and not (everything or on_people):
        wrong.append(Fault("--recordings", f"only with --all or an item on people: {', '.join(PEOPLE)}"))
    if on_people and recordings is None:
        wrong.append(Fault("--recordings", f"{item} needs a folder whose gait/ holds the recordings"))
    if recordings is not None and not (recordings / "gait").is_dir():
        wrong.append(Fault("--recordings", f"there is no folder {recordings / 'gait'}"))
    if on_people and drawn:
        wrong.append(Fault("--seeds", f"{item} draws no noise: leave --seeds out"))
    if on_people and seeded and item not in SEEDED:
        wrong.append(Fault("--seed", f"{item} draws nothing at random: leave --seed out"))
    if on_people and server is not None:
        wrong.append(Fault("--server", f"{item} computes on this machine"))
    if wrong:
        raise InvalidInput("option-invalid", "These options do not go together.", wrong)
    return item


def reproduce_item(
    item: str,
    seeds: int | None,
    seed: int | None,
    delivery: Delivery,
) -> None:
    """Reproduce one item here or on a server, write the result folder and show the claims."""
    input_ = validate_options(ReproduceInput, {"item": item, "seeds": seeds, "seed": seed})
    task = ReproduceTask(input=input_)
    deliver_result(item, delivery, lambda folder: run_job("reproduce", item, task, folder, delivery), show_reproduction)


def show_reproduction(result: JobResult, target: Path) -> None:
    """Print the claims as a table."""
    summary = ReproduceSummary.model_validate(result.summary)
    out.print(f"[bold]{escape(summary.item)}[/] {escape(summary.title)}")
    table = Table("", "thesis, or our aim", "ours", "", "evidence", box=None, pad_edge=False)
    for claim in summary.claims:
        thesis = claim.thesis if isinstance(claim.thesis, str) else format_quantity(claim.thesis, claim.unit)
        table.add_row(
            escape(claim.says) + (f"\n[dim]holds if {escape(claim.holds)}[/]" if claim.holds else ""),
            escape(thesis),
            format_quantity(claim.ours, claim.unit),
            OUTCOME_MARKUP[claim.outcome],
            escape(basis_text(Claim(**claim.model_dump(include=CLAIM_FIELDS)))),
        )
    out.print(table)
    out.print(escape(f"{summary.note} {summary.sampling}"))
    show_files(result, target)


FOLDER: Final = Path("reproduction")
REPORT: Final = "reproduction.html"
CACHE_FOLDER: Final = "kept"


def reproduce_all(
    names: Iterable[str] | None = None,
    *,
    seeds: int | None,
    seed: int | None,
    quick: bool,
    recordings: Path | None,
    out_dir: Path | None,
    recompute: bool,
    as_json: bool,
) -> bool:
    """Compute the items that are not cached in the folder, write the report, and return whether all succeeded.

    ``names`` None are all items, with those on people if there are ``recordings``.

    Raises ``InvalidInput``: ``option-invalid`` for an invalid or repeated number of draws;
    ``output-not-writable``.
    """
    draws = _number_of_draws(seeds, quick=quick)
    chosen = [*ITEMS, *(PEOPLE if recordings is not None else ())] if names is None else list(names)
    target = (out_dir or FOLDER).expanduser()
    try:
        (target / CACHE_FOLDER).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(target, error) from error
    sections = []
    with progress_bar("reproduction") as bar:
        for section in collect_sections(
            recipes_of(chosen, draws, recordings, seed),
            ResultCache(target / CACHE_FOLDER),
            bar,
            recompute=recompute,
            processes=min(available_processes(), PROCESSES_MAX),
        ):
            sections.append(section)
            if section.result is None:
                err.print(f"[bold red]failed[/]: {section.name}: {escape(section.failure)}")
    write_file(target / REPORT, render_html(sections, _provenance_text(draws)), force=True, option="--out")
    show_sections(sections, target / REPORT, as_json=as_json)
    return all(section.result is not None for section in sections)


def show_sections(sections: Sequence[Section], target: Path, *, as_json: bool) -> None:
    """Print the counts of all verdicts and the path of the report, or both as JSON with one verdict per item."""
    counts = count_outcomes(claim for section in sections if section.result for claim in section.result.claims)
    if as_json:
        items = {section.name: section.result.verdict if section.result else "failed" for section in sections}
        out.print_json(json.dumps({"report": str(target), "claims": counts, "items": items}))
        return
    counts_text = ", ".join(f"{counts[outcome]} {OUTCOME_MARKUP[outcome]}" for outcome in reversed(OUTCOMES))
    out.print(f"{sum(counts.values())} claims of {len(sections)} items: {counts_text}")
    out.print(f"[green]written[/] {escape(str(target))}")


def _number_of_draws(seeds: int | None, *, quick: bool) -> int | None:
    if quick and seeds is not None:
        raise _option_error("--quick", "it is a number of draws; leave one of --seeds and --quick out")
    if seeds is not None and not 1 <= seeds <= MAX_SEEDS:
        raise _option_error("--seeds", f"must lie between 1 and {MAX_SEEDS}, not {seeds}")
    return QUICK_SEEDS if quick else seeds


def _option_error(option: str, message: str) -> InvalidInput:
    return InvalidInput("option-invalid", "An option has an invalid value.", [Fault(option, message)])


def _provenance_text(draws: int | None) -> str:
    known = software_versions()
    text = "each item's own number of draws" if draws is None else f"{draws} draws of the noise where there is any"
    return f"Computed by stridelab {known['stridelab']} (Python {known['python']}, numpy {known['numpy']}) with {text}."
