"""``stridelab reproduce``: a figure of the thesis or a table of our own, as in the service, into a folder."""

from pathlib import Path

from rich.markup import escape
from rich.table import Table

from stridelab.cli_console import out, progress_bar
from stridelab.cli_output import refuse_to_overwrite, result_folder
from stridelab.cli_result import show_files, show_json, validated, write_result
from stridelab.errors import InvalidInput
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.reproduction import ReproduceInput, ReproduceSummary
from stridelab.service.jobs.kinds.tasks import ReproduceTask

WORDS = {
    "met": "[green]met[/]",
    "beaten": "[green]aim reached[/]",
    "not_met": "[red]not met[/]",
    "thesis_in_error": "[yellow]thesis in error[/]",
}


def reproduce(
    item: str,
    seeds: int | None,
    *,
    out_dir: Path | None,
    force: bool,
    as_json: bool,
    server: str | None,
    token: str | None,
) -> None:
    """Reproduce one item here or on a server, write the result folder and show the claims."""
    input_ = validated(ReproduceInput, {"item": item, "seeds": seeds})
    target = out_dir or Path(item)
    refuse_to_overwrite(target, force=force)
    with result_folder(target, force=force) as folder:
        if server is None:
            result = reproduce_here(input_, folder)
        else:
            from stridelab.cli_remote import run_remotely

            result = run_remotely(
                "reproduce", item, lambda _client, _bar: input_, folder, server, token, unprepared=InvalidInput
            )
    show_reproduction(result, target, as_json=as_json)


def reproduce_here(input_: ReproduceInput, folder: Path) -> JobResult:
    """Run the job's own function in this process."""
    with progress_bar(input_.item) as bar:
        bar(0.0, "starting")
        from stridelab.service.jobs.kinds import reproduce as kind

        outcome = kind.run(ReproduceTask(input=input_), folder, bar)
    return write_result(folder, "reproduce", input_, outcome)


def show_reproduction(result: JobResult, target: Path, *, as_json: bool) -> None:
    """The claims as a table, or JSON."""
    if as_json:
        show_json(result)
        return
    summary = ReproduceSummary.model_validate(result.summary)
    out.print(f"[bold]{escape(summary.item)}[/] {escape(summary.title)}: {WORDS[summary.verdict]}")
    table = Table("", "thesis, or our aim", "ours", "", box=None, pad_edge=False)
    for claim in summary.claims:
        thesis = claim.thesis if isinstance(claim.thesis, str) else _measured(claim.thesis, claim.unit)
        table.add_row(escape(claim.says), escape(thesis), _measured(claim.ours, claim.unit), WORDS[claim.verdict])
    out.print(table)
    out.print(escape(summary.note))
    show_files(result, target)


def _measured(value: float, unit: str) -> str:
    """To three digits; metres and seconds below a tenth in thousandths, a ratio as a bare number."""
    if unit in ("m", "s") and 0 < abs(value) < 0.1:
        value, unit = 1000 * value, f"m{unit}"
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"
