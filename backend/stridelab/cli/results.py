"""Runs the job of a command and writes its result: folders and files (atomically), tables, errors, progress bars."""

import json
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, TypeVar

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from stridelab.errors import (
    Busy,
    Conflict,
    Forbidden,
    InvalidInput,
    NotEstimable,
    NotFound,
    StridelabError,
    TooLarge,
    Unavailable,
    UnreadableFile,
)
from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.quality import Quality
from stridelab.service.jobs.verdict import verdict_of
from stridelab.service.local_runs import REFERENCES_FILE, RESULT_FILE, result_folder, write_result

if TYPE_CHECKING:
    from stridelab.cli.options import Delivery
    from stridelab.service.kinds.base import Outcome


T = TypeVar("T", bound=Contract)

VERDICT_COLOURS: Final[Mapping[str, str]] = {"contradicted": "bold red", "doubtful": "yellow"}
"""Codes of the remarks that state the verdict of a recording's quality, with their colours."""

OUTCOME_COLOURS: Final[Mapping[str, str]] = {"failed": "bold red", "doubtful": "yellow", "passed": "green"}
"""Colours of the outcome of a verdict."""


def show_json(result: JobResult) -> None:
    """Print the whole result as JSON."""
    out.print_json(json.dumps(result.model_dump(mode="json")))


def show_quality(quality: Quality | None, remarks: Sequence[Remark]) -> None:
    """Print the quality verdict: contradictions in red, doubts in yellow."""
    if quality is None:
        out.print("[yellow]quality not checked[/]: the version that made this result has no checks")
        return
    if quality.verdict == "good":
        out.print(f"[green]quality good[/]: {len(quality.checks)} checks pass")
    for remark in remarks:
        if remark.code in VERDICT_COLOURS:
            out.print(f"[{VERDICT_COLOURS[remark.code]}]{remark.code}[/]: {escape(remark.message)}")
    if quality.not_checked:
        reasons = "; ".join(f"{name} ({why})" for name, why in quality.not_checked.items())
        out.print(f"[dim]not checked: {escape(reasons)}[/]")


def show_verdict(result: JobResult) -> None:
    """Print the verdict on the whole result in one line, red if it failed; nothing if nothing was checked."""
    verdict = verdict_of(result.summary)
    if verdict is not None:
        out.print(f"[{OUTCOME_COLOURS[verdict.outcome]}]verdict[/] {escape(verdict.message)}")


def end_if_contradicted(result: JobResult) -> None:
    """Raise ``typer.Exit`` with the code ``CONTRADICTED`` where the result's sensors contradict each other."""
    quality = result.summary.get("quality")
    if quality is not None and quality["verdict"] == "contradicted":
        raise typer.Exit(CONTRADICTED)


def show_rows(rows: Iterable[tuple[str, str]]) -> None:
    """Print names and values as a table."""
    table = Table(show_header=False, box=None, pad_edge=False)
    for name, value in rows:
        table.add_row(f"[bold]{name}[/]", escape(value))
    out.print(table)


def show_remarks(remarks: list[Remark]) -> None:
    """Print one line per warning, except those that ``show_quality`` prints."""
    for remark in remarks:
        if remark.code in VERDICT_COLOURS:
            continue
        out.print(f"[yellow]note[/] {escape(remark.message)} [dim]({escape(remark.code)})[/]")


def show_files(result: JobResult, target: Path) -> None:
    """Print the folder of the result and its files."""
    names = ", ".join([*(artifact.name for artifact in result.artifacts), RESULT_FILE, REFERENCES_FILE])
    out.print(f"[green]written[/] {escape(str(target))}: {escape(names)}")


FAILURE: Final = 1
CONTRADICTED: Final = 3
"""A result was written, and the sensors of its recording contradict each other."""
INTERRUPTED: Final = 130

EXIT_CODES: Final[Mapping[type[StridelabError], int]] = MappingProxyType(
    {
        InvalidInput: 2,
        UnreadableFile: 3,
        NotEstimable: 4,
        NotFound: 5,
        Conflict: 6,
        TooLarge: 7,
        Busy: 8,
        Forbidden: 9,
        Unavailable: 10,
    }
)
"""Exit code per class of error; 1 is any other failure, 2 also a misspelt command line, 130 Ctrl-C.

3 is also ``CONTRADICTED``: a result was written but is not reliable.
"""

MAX_LISTED_FAULTS: Final = 12
"""Maximum number of faults listed below an error."""

out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, soft_wrap=True)


def exit_code(error: StridelabError) -> int:
    """Exit code of an error, by the nearest class that has one."""
    return next((EXIT_CODES[kind] for kind in type(error).__mro__ if kind in EXIT_CODES), FAILURE)


def show_error(error: StridelabError) -> None:
    """Print message and code on one line, then the faults of the input."""
    err.print(f"[bold red]error[/]: {escape(error.message)} [dim]({escape(error.code)})[/]")
    for fault in error.faults[:MAX_LISTED_FAULTS]:
        err.print(f"  {escape(fault.where)}: {escape(fault.message)}")
    if len(error.faults) > MAX_LISTED_FAULTS:
        err.print(f"  and {len(error.faults) - MAX_LISTED_FAULTS} more")


class Bar:
    """Progress of one run, as a callback ``(fraction, message)``."""

    def __init__(self, progress: Progress, title: str) -> None:
        self._progress = progress
        self._task = progress.add_task(title, total=1.0, message="")

    def __call__(self, fraction: float, message: str) -> None:
        self._progress.update(self._task, completed=fraction, message=message)


@contextmanager
def progress_bar(title: str) -> Iterator[Bar]:
    """Progress bar on stderr; draws nothing unless stderr is a terminal."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("[dim]{task.fields[message]}[/]"),
    )
    with Progress(*columns, console=err, disable=not err.is_terminal) as progress:
        yield Bar(progress, title)


Show = Callable[[JobResult, Path], None]
"""Prints a result and the path of its folder."""


def deliver_result(default_name: str, delivery: "Delivery", compute: Callable[[Path], JobResult], show: Show) -> None:
    """Write the result folder that ``compute`` fills, and show the result, or print it as JSON.

    Raises ``typer.Exit`` with the code ``CONTRADICTED`` where the sensors of the recording contradict each other.
    """
    target = delivery.result_path(default_name)
    with result_folder(target, force=delivery.force) as folder:
        result = compute(folder)
    if delivery.as_json:
        show_json(result)
    else:
        show(result, target)
    end_if_contradicted(result)


def run_kind(kind: str, title: str, task: Any, folder: Path, **options: Any) -> "Outcome":
    """Run the function of a job kind in this process; it writes what the service would publish into ``folder``."""
    with progress_bar(title) as bar:
        bar(0.0, "starting")
        module = import_module(f"stridelab.service.kinds.{kind.replace('-', '_')}.run")
        outcome: Outcome = module.run(task, folder, bar, **options)
    return outcome


def run_in_scratch(
    kind: str, title: str, stage: Callable[[Path], Any], folder: Path, **options: Any
) -> tuple[Any, "Outcome"]:
    """The task that ``stage`` prepares in a temporary folder, and what ``run_kind`` makes of it there.

    Only the result files are moved into ``folder``.
    """
    with tempfile.TemporaryDirectory(prefix="stridelab-") as name:
        work = Path(name)
        task = stage(work)
        outcome = run_kind(kind, title, task, work, **options)
        for artifact in outcome.artifacts:
            shutil.move(work / artifact.name, folder / artifact.name)
    return task, outcome


def run_here(kind: str, title: str, task: Any, folder: Path, **options: Any) -> JobResult:
    """``run_kind`` with ``result.json`` beside its files."""
    return write_result(folder, kind, task.input, run_kind(kind, title, task, folder, **options))
