"""``stridelab plan-contacts``: plans a contact sequence between two stances, here or on a service.

``stridelab export-contacts`` and ``import-contacts``: convert contact sequences to and from multicontact-api JSON.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rich.markup import escape

from stridelab.cli.options import Delivery
from stridelab.cli.results import (
    out,
    progress_bar,
    refuse_to_overwrite,
    result_folder,
    show_files,
    show_json,
    show_remarks,
    write_file,
    write_result,
)
from stridelab.cli.scenario_files import read_document, read_json, read_scenario, validate_document
from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.base import Remark
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.plans import PlanContactsInput, PlanContactsSummary
from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.tasks import PlanContactsTask

PHASE_OF_END: Final = {"start": 0, "goal": -1}
"""Indices of the scenario phases that are start and goal of a task."""

ONLY_SCENARIO: Final = ("description", "start_com_height_m")
"""Fields of a scenario that a task does not have."""


def plan_contacts(typed: str, delivery: Delivery) -> None:
    """Plan here or on a server, write the result folder and show the summary."""
    title = Path(typed).stem
    input_ = task_of(read_document(typed), title)
    target = delivery.result_path(f"{title}-contacts")
    refuse_to_overwrite(target, force=delivery.force)
    with result_folder(target, force=delivery.force) as folder:
        if delivery.server is None:
            result = plan_here(input_, title, folder)
        else:
            from stridelab.cli.remote import run_remotely_as_is

            result = run_remotely_as_is("plan-contacts", title, input_, folder, delivery.server, delivery.token)
    show_planned(result, target, as_json=delivery.as_json)


def task_of(document: Any, name: str) -> PlanContactsInput:
    """Task of a JSON document: a task as in the HTTP contract, or a scenario, of which first and last phase are used.

    Raises ``InvalidInput`` (``task-invalid``) naming the invalid fields.
    """
    fields = dict(document) if isinstance(document, dict) else {}
    phases = fields.pop("phases", None)
    if isinstance(phases, list) and phases and all(isinstance(phase, dict) for phase in phases):
        fields |= {end: {"contacts": phases[k].get("contacts")} for end, k in PHASE_OF_END.items()}
        fields = {key: value for key, value in fields.items() if key not in ONLY_SCENARIO}
    return validate_document(PlanContactsInput, {"name": name, **fields}, name, "task")


def plan_here(input_: PlanContactsInput, title: str, folder: Path) -> JobResult:
    """Run the job's own function in this process."""
    with progress_bar(title) as bar:
        bar(0.0, "starting")
        from stridelab.service.kinds.plan_contacts import run as kind

        outcome = kind.run(PlanContactsTask(input=input_), folder, bar)
    return write_result(folder, "plan-contacts", input_, outcome)


def show_planned(result: JobResult, target: Path, *, as_json: bool) -> None:
    """Print where each effector makes contact, or the result as JSON."""
    if as_json:
        show_json(result)
        return
    summary = PlanContactsSummary.model_validate(result.summary)
    scenario = summary.scenario
    out.print(
        f"[bold]{escape(scenario.name)}[/] {summary.steps} steps in {len(scenario.phases)} phases, "
        f"{summary.duration_s:.1f} s, planned in {summary.solve_time_s:.2f} s"
    )
    for before, phase in zip(scenario.phases, scenario.phases[1:], strict=False):
        for contact in phase.contacts:
            if contact.effector not in {earlier.effector for earlier in before.contacts}:
                x, y, z = contact.position_m
                out.print(f"{escape(contact.effector):<11} to ({x:.3f}, {y:.3f}, {z:.3f})")
    show_remarks(summary.warnings)
    show_files(result, target)
    out.print(f"To plan the motion: stridelab plan {escape(str(target / 'scenario.json'))}")


MAX_DOCUMENT_BYTES: Final = 8_000_000
"""Maximum size of a document; 400 phases with four contacts each take about 2 MB."""
OUT_FILE_OPTION: Final = "--out-file"


def export_contacts(typed: str, *, out_file: Path | None, force: bool) -> None:
    """Write a scenario's contact sequence with the field names of multicontact-api.

    Raises ``InvalidInput`` (``scenario-invalid``) if the robot cannot carry it out, and the errors of
    ``cli.scenario_files.read_scenario``.
    """
    from stridelab.contacts.effector_geometry import effector_shapes
    from stridelab.contacts.multicontact_api import to_multicontact
    from stridelab.contacts.scenario_io import sequence_of

    scenario = read_scenario(typed)
    sequence = sequence_of(scenario.model_dump(mode="json"), effector_shapes(scenario.robot))
    document = to_multicontact(sequence, scenario.description)
    target = out_file or Path(f"{Path(typed).stem}.contacts.json")
    write_file(target, json.dumps(document, indent=1, allow_nan=False) + "\n", force=force, option=OUT_FILE_OPTION)
    out.print(f"[green]written[/] {escape(str(target))}: {_describe_size(scenario, sequence.duration_s)}")


def import_contacts(file: Path, *, beside: str | None, out_file: Path | None, force: bool) -> None:
    """Validate the scenario of a contact-sequence document and write it.

    Raises ``UnreadableFile``, ``TooLarge`` (``file-too-large``), ``NotFound`` (``robot-not-found``) and
    ``InvalidInput``: ``contact-sequence-invalid`` for a malformed document, ``scenario-invalid`` for an invalid
    scenario or one that the robot cannot carry out; both name phase and effector.
    """
    from stridelab.contacts.effector_geometry import effector_shapes
    from stridelab.contacts.multicontact_api import from_multicontact
    from stridelab.contacts.scenario_io import sequence_of
    from stridelab.contacts.validation.validate import validate_scenario

    defaults = {} if beside is None else _scenario_without_phases(beside)
    document = read_json(file, MAX_DOCUMENT_BYTES)
    if not isinstance(document, dict):
        fault = Fault("the file", "it is not an object with contact_phases")
        raise InvalidInput("contact-sequence-invalid", f"{file} is not a contact sequence.", [fault])
    fields = from_multicontact(document, defaults)
    scenario = validate_document(Scenario, fields, str(file), "scenario")
    body, effectors = scenario.model_dump(mode="json"), effector_shapes(scenario.robot)
    sequence = sequence_of(body, effectors)
    target = out_file or Path(f"{file.name.split('.')[0]}.scenario.json")
    text = scenario.model_dump_json(indent=2, exclude_none=True) + "\n"
    write_file(target, text, force=force, option=OUT_FILE_OPTION)
    show_remarks(
        [Remark(code=remark.code, message=remark.message) for remark in validate_scenario(body, effectors).remarks]
    )
    out.print(f"[green]written[/] {escape(str(target))}: {_describe_size(scenario, sequence.duration_s)}")
    out.print(f"To plan the motion: stridelab plan {escape(str(target))}")


def _scenario_without_phases(typed: str) -> Mapping[str, Any]:
    """Fields of a scenario document except its phases."""
    document = read_document(typed)
    if not isinstance(document, dict):
        fault = Fault("--beside", "it is not an object with robot and terrain")
        raise InvalidInput("scenario-invalid", f"{typed} is not a scenario.", [fault])
    return {key: value for key, value in document.items() if key in Scenario.model_fields and key != "phases"}


def _describe_size(scenario: Scenario, duration_s: float) -> str:
    count = len(scenario.phases)
    return f"{escape(scenario.name)}, {count} phase{'s' * (count != 1)}, {duration_s:.1f} s, {escape(scenario.robot)}"
