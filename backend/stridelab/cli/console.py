"""Console output of the command line: one-line errors with an exit code per class, and progress bars on stderr."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Final

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

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
