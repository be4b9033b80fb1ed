"""``stridelab reproduce``: a figure of the thesis or a table of our own, as in the service, into a folder."""

from pathlib import Path

from rich.markup import escape
from rich.table import Table

from stridelab.cli_console import out, progress_bar
from stridelab.cli_groups import Delivery
from stridelab.cli_output import refuse_to_overwrite, result_folder
from stridelab.cli_result import show_files, show_json, validated, write_result
from stridelab.errors import Fault, InvalidInput
from stridelab.experiments.reproduction.in_words import measured
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.reproduction import ReproduceInput, ReproduceSummary
from stridelab.service.jobs.kinds.tasks import ReproduceTask

WORDS = {
    "met": "[green]met[/]",
    "beaten": "[green]better, or our aim reached[/]",
    "not_met": "[red]not met[/]",
    "thesis_in_error": "[yellow]thesis in error[/]",
}


def require_one(
    item: str | None, *, everything: bool, quick: bool, recordings: Path | None, server: str | None
) -> str | None:
    """The item asked for, None for all of them.

    Raises ``InvalidInput`` (``option-invalid``) unless it is one or the other, and for options of the other one.
    """
    wrong = []
    if everything == (item is not None):
        wrong.append(Fault("ITEM", "give one item, or --all"))
    if everything and server is not None:
        wrong.append(Fault("--server", "--all computes on this machine; on a server the page /reproduction does"))
    if not everything:
        wrong += [Fault(option, "only with --all") for option, given in
                  (("--quick", quick), ("--recordings", recordings is not None)) if given]  # fmt: skip
    if wrong:
        raise InvalidInput("option-invalid", "This cannot be reproduced as asked.", wrong)
    return item


def reproduce(
    item: str,
    seeds: int | None,
    delivery: Delivery,
) -> None:
    """Reproduce one item here or on a server, write the result folder and show the claims."""
    input_ = validated(ReproduceInput, {"item": item, "seeds": seeds})
    target = delivery.folder(item)
    refuse_to_overwrite(target, force=delivery.force)
    with result_folder(target, force=delivery.force) as folder:
        if delivery.server is None:
            result = reproduce_here(input_, folder)
        else:
            from stridelab.cli_remote import run_remotely_as_is

            result = run_remotely_as_is("reproduce", item, input_, folder, delivery.server, delivery.token)
    show_reproduction(result, target, as_json=delivery.as_json)


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
        thesis = claim.thesis if isinstance(claim.thesis, str) else measured(claim.thesis, claim.unit)
        table.add_row(escape(claim.says), escape(thesis), measured(claim.ours, claim.unit), WORDS[claim.verdict])
    out.print(table)
    out.print(escape(summary.note))
    show_files(result, target)
