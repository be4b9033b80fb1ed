"""``stridelab export-contacts`` and ``import-contacts``: contact sequences for other tools, and from them."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rich.markup import escape

from stridelab.cli_console import out
from stridelab.cli_output import write_file
from stridelab.cli_result import show_remarks
from stridelab.cli_scenario import read_document, read_json, read_scenario, understood
from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.base import Remark
from stridelab.schemas.scenarios import Scenario

LARGEST_BYTES: Final = 8_000_000
"""Largest document that is read: one of 400 phases with four contacts each takes about two."""
OPTION: Final = "--out-file"


def export_contacts(typed: str, *, out_file: Path | None, force: bool) -> None:
    """Write a scenario's contact sequence with the field names of multicontact-api.

    Raises ``InvalidInput`` (``scenario-invalid``) where the robot cannot do it, and as ``cli_scenario.read_scenario``.
    """
    from stridelab.contacts.multicontact import to_multicontact
    from stridelab.contacts.scenario_json import sequence_of
    from stridelab.contacts.shapes import effector_shapes

    scenario = read_scenario(typed)
    sequence = sequence_of(scenario.model_dump(mode="json"), effector_shapes(scenario.robot))
    document = to_multicontact(sequence, scenario.description)
    target = out_file or Path(f"{Path(typed).stem}.contacts.json")
    write_file(target, json.dumps(document, indent=1, allow_nan=False) + "\n", force=force, option=OPTION)
    out.print(f"[green]written[/] {escape(str(target))}: {_size(scenario, sequence.duration_s)}")


def import_contacts(file: Path, *, beside: str | None, out_file: Path | None, force: bool) -> None:
    """Write the scenario of a document once the judge of all scenarios has passed it.

    Raises ``UnreadableFile``, ``TooLarge`` (``file-too-large``), ``NotFound`` (``robot-not-found``) and
    ``InvalidInput``: ``contact-sequence-invalid`` for what cannot be read, ``scenario-invalid`` for what makes no
    scenario or what the robot cannot do, both naming phase and effector.
    """
    from stridelab.contacts.multicontact import from_multicontact
    from stridelab.contacts.scenario_json import sequence_of
    from stridelab.contacts.shapes import effector_shapes
    from stridelab.contacts.validation import check

    known = {} if beside is None else _surroundings(beside)
    document = read_json(file, LARGEST_BYTES)
    if not isinstance(document, dict):
        fault = Fault("the file", "it is not an object with contact_phases")
        raise InvalidInput("contact-sequence-invalid", f"{file} is not a contact sequence.", [fault])
    read = from_multicontact(document, known)
    scenario = understood(Scenario, read, str(file), "scenario")
    body, effectors = scenario.model_dump(mode="json"), effector_shapes(scenario.robot)
    sequence = sequence_of(body, effectors)
    target = out_file or Path(f"{file.name.split('.')[0]}.scenario.json")
    text = scenario.model_dump_json(indent=2, exclude_none=True) + "\n"
    write_file(target, text, force=force, option=OPTION)
    show_remarks([Remark(code=remark.code, message=remark.message) for remark in check(body, effectors).remarks])
    out.print(f"[green]written[/] {escape(str(target))}: {_size(scenario, sequence.duration_s)}")
    out.print(f"To plan the motion: stridelab plan {escape(str(target))}")


def _surroundings(typed: str) -> Mapping[str, Any]:
    """Of a scenario, or of one without phases, all that is not its contacts."""
    document = read_document(typed)
    if not isinstance(document, dict):
        fault = Fault("--beside", "it is not an object with robot and terrain")
        raise InvalidInput("scenario-invalid", f"{typed} is not a scenario.", [fault])
    return {key: value for key, value in document.items() if key in Scenario.model_fields and key != "phases"}


def _size(scenario: Scenario, duration_s: float) -> str:
    count = len(scenario.phases)
    return f"{escape(scenario.name)}, {count} phase{'s' * (count != 1)}, {duration_s:.1f} s, {escape(scenario.robot)}"
