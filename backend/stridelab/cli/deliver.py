"""Runs the job of a command, here or on a service, and delivers its result folder."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stridelab.cli.options import Delivery
from stridelab.cli.results import end_if_contradicted, progress_bar, result_folder, show_json, write_result
from stridelab.cli.scenario_files import read_scenario
from stridelab.errors import NotFound
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.scenarios import Scenario

if TYPE_CHECKING:
    from stridelab.service.kinds.base import Outcome

Show = Callable[[JobResult, Path], None]
"""Prints a result and the path of its folder."""


def deliver_result(default_name: str, delivery: Delivery, compute: Callable[[Path], JobResult], show: Show) -> None:
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


def run_here(kind: str, title: str, task: Any, folder: Path, **options: Any) -> JobResult:
    """``run_kind`` with ``result.json`` beside its files."""
    return write_result(folder, kind, task.input, run_kind(kind, title, task, folder, **options))


def run_job(kind: str, title: str, task: Any, folder: Path, delivery: Delivery) -> JobResult:
    """Run a job that needs no files, here or on the service of ``delivery``."""
    if delivery.server is None:
        return run_here(kind, title, task, folder)
    from stridelab.cli.remote import run_remotely_as_is

    return run_remotely_as_is(kind, title, task.input, folder, delivery)


def known_scenario(typed: str, delivery: Delivery) -> Scenario | None:
    """The scenario of a file or a bundled one; None for another name, which a service may have as a scenario id.

    Raises as ``read_scenario``, with ``NotFound`` only where there is no service.
    """
    try:
        return read_scenario(typed)
    except NotFound:
        if delivery.server is None:
            raise
        return None
