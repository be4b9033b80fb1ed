"""``stridelab plan-contacts``: a sequence of contacts from a stance to another, here or on a service."""

from pathlib import Path
from typing import Any, Final

from rich.markup import escape

from stridelab.cli_console import out, progress_bar
from stridelab.cli_groups import Delivery
from stridelab.cli_output import refuse_to_overwrite, result_folder
from stridelab.cli_result import show_files, show_json, show_remarks, write_result
from stridelab.cli_scenario import read_document, understood
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.plans import PlanContactsInput, PlanContactsSummary
from stridelab.service.jobs.kinds.tasks import PlanContactsTask

ENDS: Final = {"start": 0, "goal": -1}
"""Phases of a scenario that are the ends of a task."""

ONLY_SCENARIO: Final = ("description", "start_com_height_m")
"""Fields of a scenario that a task does not have."""


def plan_contacts(typed: str, delivery: Delivery) -> None:
    """Plan here or on a server, write the result folder and show the summary."""
    title = Path(typed).stem
    input_ = task_of(read_document(typed), title)
    target = delivery.folder(f"{title}-contacts")
    refuse_to_overwrite(target, force=delivery.force)
    with result_folder(target, force=delivery.force) as folder:
        if delivery.server is None:
            result = plan_here(input_, title, folder)
        else:
            from stridelab.cli_remote import run_remotely_as_is

            result = run_remotely_as_is("plan-contacts", title, input_, folder, delivery.server, delivery.token)
    show_planned(result, target, as_json=delivery.as_json)


def task_of(document: Any, name: str) -> PlanContactsInput:
    """The task of a file: a task as in the HTTP contract, or a scenario, of which only the ends are taken.

    Raises ``InvalidInput`` (``task-invalid``) naming the fields that make no sense.
    """
    fields = dict(document) if isinstance(document, dict) else {}
    phases = fields.pop("phases", None)
    if isinstance(phases, list) and phases and all(isinstance(phase, dict) for phase in phases):
        fields |= {end: {"contacts": phases[k].get("contacts")} for end, k in ENDS.items()}
        fields = {key: value for key, value in fields.items() if key not in ONLY_SCENARIO}
    return understood(PlanContactsInput, {"name": name, **fields}, name, "task")


def plan_here(input_: PlanContactsInput, title: str, folder: Path) -> JobResult:
    """Run the job's own function in this process."""
    with progress_bar(title) as bar:
        bar(0.0, "starting")
        from stridelab.service.jobs.kinds import plan_contacts as kind

        outcome = kind.run(PlanContactsTask(input=input_), folder, bar)
    return write_result(folder, "plan-contacts", input_, outcome)


def show_planned(result: JobResult, target: Path, *, as_json: bool) -> None:
    """What lands where, or JSON."""
    if as_json:
        show_json(result)
        return
    summary = PlanContactsSummary.model_validate(result.summary)
    scenario = summary.scenario
    out.print(
        f"[bold]{escape(scenario.name)}[/] {summary.steps} steps in {len(scenario.phases)} phases, "
        f"{summary.duration_s:.1f} s, found in {summary.solve_time_s:.2f} s"
    )
    for before, phase in zip(scenario.phases, scenario.phases[1:], strict=False):
        for contact in phase.contacts:
            if contact.effector not in {known.effector for known in before.contacts}:
                x, y, z = contact.position_m
                out.print(f"{escape(contact.effector):<11} to ({x:.3f}, {y:.3f}, {z:.3f})")
    show_remarks(summary.warnings)
    show_files(result, target)
    out.print(f"To plan the motion: stridelab plan {escape(str(target / 'scenario.json'))}")
