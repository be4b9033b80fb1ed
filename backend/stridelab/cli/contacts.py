"""``stridelab plan-contacts``: plans a contact sequence between two stances, here or on a service.

``stridelab export-contacts`` and ``import-contacts``: convert contact sequences to and from multicontact-api JSON.

``stridelab read-terrain``: makes the task of crossing a terrain of its mesh, scan, height map or scene.
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import typer
from rich.markup import escape

from stridelab.cli.estimate import run_job
from stridelab.cli.options import Delivery, ScenarioName, with_groups
from stridelab.cli.results import deliver_result, out, show_files, show_remarks
from stridelab.errors import Fault, InvalidInput, NotFound, StridelabError
from stridelab.machine.parallel import map_isolated
from stridelab.pipelines.scenarios.scenario_files import read_document, read_json, read_scenario, validate_document
from stridelab.schemas.base import Remark
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.plans import PlanContactsInput, PlanContactsSummary, PlanContactsTask
from stridelab.schemas.scenarios import Course, Scenario
from stridelab.service.local_runs import write_file

PHASE_OF_END: Final = {"start": 0, "goal": -1}
"""Indices of the scenario phases that are start and goal of a task."""

ONLY_SCENARIO: Final = ("description", "start_com_height_m")
"""Fields of a scenario that a task does not have."""


@with_groups
def plan_contacts(
    *,
    task: Annotated[
        str,
        typer.Argument(
            help="A JSON file with terrain, start and goal; a scenario, whose ends are used; or a course of obstacles."
        ),
    ],
    certify: Annotated[
        int,
        typer.Option(
            min=0,
            max=6,
            help="Compute and certify the motion of up to N plans; each avoids the step that failed before.",
        ),
    ] = 0,
    delivery: Delivery,
) -> None:
    """Find a sequence of contacts over a terrain, from a stance to a goal stance; needs no server."""
    title = Path(task).stem
    request = task_of(read_document(task), title)
    job_task = PlanContactsTask(input=request.model_copy(update={"certify": certify or request.certify}))
    deliver_result(
        f"{title}-contacts",
        delivery,
        lambda folder: run_job("plan-contacts", title, job_task, folder, delivery),
        show_planned,
    )


def task_of(document: Any, name: str) -> PlanContactsInput:
    """Task of a JSON document: a task as in the HTTP contract, a scenario (its first and last phase), or a course.

    Raises ``InvalidInput`` (``task-invalid``, ``course-invalid``) naming the invalid fields, and as ``compose_course``.
    """
    fields = dict(document) if isinstance(document, dict) else {}
    if "elements" in fields:
        from stridelab.contacts.effector_geometry import effector_shapes
        from stridelab.pipelines.plan_contacts import compose_course

        course = validate_document(Course, {"name": name, **fields}, name, "course")
        return compose_course(course, effector_shapes(course.robot))
    phases = fields.pop("phases", None)
    if isinstance(phases, list) and phases and all(isinstance(phase, dict) for phase in phases):
        fields |= {end: {"contacts": phases[k].get("contacts")} for end, k in PHASE_OF_END.items()}
        fields = {key: value for key, value in fields.items() if key not in ONLY_SCENARIO}
    return validate_document(PlanContactsInput, {"name": name, **fields}, name, "task")


def show_planned(result: JobResult, target: Path) -> None:
    """Print where each effector makes contact."""
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
    if summary.certified is not None:
        for failure in summary.failures:
            out.print(f"not certified: {escape(failure)}")
        out.print("The motion of this plan is certified." if summary.certified else "No plan is certified.")
    show_remarks(summary.warnings)
    show_files(result, target)
    out.print(f"To plan the motion: stridelab plan {escape(str(target / 'scenario.json'))}")


MAX_DOCUMENT_BYTES: Final = 8_000_000
"""Maximum size of a document; 400 phases with four contacts each take about 2 MB."""
OUT_FILE_OPTION: Final = "--out-file"
OutFile = Annotated[Path | None, typer.Option(OUT_FILE_OPTION, help="The file to write; must not exist yet.")]
ForceFile = Annotated[bool, typer.Option("--force", help="Replace that file.")]


def export_contacts(scenario: ScenarioName, out_file: OutFile = None, force: ForceFile = False) -> None:
    """Write a scenario's contact sequence with the field names of multicontact-api.

    Raises ``InvalidInput`` (``scenario-invalid``) if the robot cannot carry it out, and the errors of
    ``scenario_files.read_scenario``.
    """
    from stridelab.contacts.effector_geometry import effector_shapes
    from stridelab.contacts.multicontact_api import to_multicontact
    from stridelab.contacts.scenario_io import sequence_of

    exported = read_scenario(scenario)
    sequence = sequence_of(exported.model_dump(mode="json"), effector_shapes(exported.robot))
    document = to_multicontact(sequence, exported.description)
    target = out_file or Path(f"{Path(scenario).stem}.contacts.json")
    write_file(target, json.dumps(document, indent=1, allow_nan=False) + "\n", force=force, option=OUT_FILE_OPTION)
    out.print(f"[green]written[/] {escape(str(target))}: {_describe_size(exported, sequence.duration_s)}")


def import_contacts(
    file: Annotated[Path, typer.Argument(help="JSON with multicontact-api's field names.")],
    beside: Annotated[
        str | None,
        typer.Option("--beside", help="A scenario, or its name: robot, terrain and friction where FILE has none."),
    ] = None,
    out_file: OutFile = None,
    force: ForceFile = False,
) -> None:
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


READ_S, READ_MB = 60.0, 2048
"""Limits of the process that reads a terrain."""
METRES_PER: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}


def read_terrain(
    file: Annotated[
        Path,
        typer.Argument(
            help="The terrain: a mesh (STL, OBJ, PLY, GLB), a cloud of points (PLY, XYZ, PTS, CSV, PCD), a height map "
            "(ASC, PNG) or a scene of MuJoCo (XML, ZIP)."
        ),
    ],
    start: Annotated[str, typer.Option("--start", help="Where the robot starts, as x,y in metres.")],
    goal: Annotated[str, typer.Option("--goal", help="Where it goes, as x,y in metres; it faces there.")],
    robot: Annotated[str, typer.Option("--robot", help="Name of the robot.")] = "talos",
    unit: Annotated[Literal["m", "cm", "mm"], typer.Option("--unit", help="Unit of the file.")] = "m",
    up: Annotated[
        Literal["+z", "-z", "+y", "-y", "+x", "-x"] | None,
        typer.Option(
            "--up", help="Axis that points up; if omitted, found where the points are clear, else +z, of GLB +y."
        ),
    ] = None,
    friction: Annotated[float, typer.Option("--friction", min=0.05, max=2.0, help="Coefficient of friction.")] = 0.3,
    cell_m: Annotated[
        float | None, typer.Option("--cell", min=0.001, max=1.0, help="Edge of the cells of a PNG, in metres.")
    ] = None,
    height_m: Annotated[
        float | None, typer.Option("--height", min=1e-6, max=1.0, help="Height of a step of grey of a PNG, in metres.")
    ] = None,
    height_range_m: Annotated[
        float | None,
        typer.Option("--height-range", min=0.001, max=100.0, help="Height of a PNG from black to white, in metres."),
    ] = None,
    out_file: OutFile = None,
    force: ForceFile = False,
) -> None:
    """Find the surfaces of a terrain on which feet can stand, and write the task of crossing it for plan-contacts.

    Raises ``NotFound`` (``file-not-found``, ``robot-not-found``), ``UnreadableFile`` (``terrain-mesh-unreadable``,
    ``terrain-file-unreadable``, and for scenes as ``read_scene``) and ``InvalidInput`` (``terrain-without-surfaces``,
    ``invalid-request``, and as ``crossing_task``).
    """
    from stridelab.contacts.effector_geometry import effector_shapes
    from stridelab.contacts.terrain_meshes.crossing import crossing_task

    if not file.is_file():
        raise NotFound("file-not-found", f"There is no file {file}.", [Fault(str(file), "missing")])
    ends = _parse_place("--start", start), _parse_place("--goal", goal)
    item = {"file": str(file), "metres_per_unit": METRES_PER[unit], "up": up, "cell_m": cell_m, "height_m": height_m}
    item["height_range_m"] = height_range_m
    ((_, read),) = map_isolated(_read_here, [item], preload=["numpy"], timeout_s=READ_S, spans_nodes=False)
    if isinstance(read, StridelabError):
        raise read
    surfaces = read["terrain"]
    task = crossing_task(surfaces, *ends, effector_shapes(robot))
    request = validate_document(
        PlanContactsInput, {"robot": robot, "friction": friction, "name": file.stem[:100], **task}, file.name, "task"
    )
    target = out_file or Path(f"{file.stem}.task.json")
    write_file(target, request.model_dump_json(indent=2, exclude_none=True) + "\n", force=force, option=OUT_FILE_OPTION)
    out.print(f"[green]written[/] {escape(str(target))}: {_describe_terrain(surfaces)}")
    for flight in read["stairs"]:
        rails = f", {len(flight['rails'])} rail{'s' * (len(flight['rails']) != 1)}" if flight["rails"] else ""
        out.print(
            f"stairs: {len(flight['treads'])} treads, rise {100.0 * flight['rise_m']:.1f} cm, "
            f"run {100.0 * flight['run_m']:.1f} cm, {flight['width_m']:.2f} m wide{rails}"
        )
    show_remarks([Remark(code="terrain-read", message=remark) for remark in read["remarks"]])
    out.print(f"To plan the contacts: stridelab plan-contacts {escape(str(target))}")


def _describe_terrain(surfaces: Sequence[Mapping[str, Any]]) -> str:
    """How many surfaces, rails and obstacles there are, and how high the surfaces."""
    boxes = [one for one in surfaces if one["name"].startswith("surface")]
    heights = [round(one["center_m"][2] + 0.5 * one["size_m"][2], 2) + 0.0 for one in boxes]
    text = f"{len(boxes)} surface{'s' * (len(boxes) != 1)}, {min(heights):.2f} to {max(heights):.2f} m high"
    for kind in ("rail", "obstacle"):
        count = sum(one["name"].startswith(kind) for one in surfaces)
        text += f", {count} {kind}{'s' * (count != 1)}" if count else ""
    return text


def _parse_place(option: str, typed: str) -> tuple[float, float]:
    """Two numbers with a comma between them. Raises ``InvalidInput`` (``invalid-request``)."""
    number = r"\s*(-?\d+(?:\.\d*)?)\s*"
    match = re.fullmatch(f"{number},{number}", typed)
    if match is None:
        raise InvalidInput(
            "invalid-request", f"{option} has the form x,y in metres, as 0,1.5.", [Fault(option, typed[:60])]
        )
    return float(match[1]), float(match[2])


def _read_here(item: Mapping[str, Any]) -> dict[str, Any]:
    """In a process of its own: the terrain of a file, as JSON."""
    from stridelab.pipelines.scenarios.read_terrain import read_terrain as read_file
    from stridelab.service.processes.child import limit_memory

    limit_memory(READ_MB)
    options = {key: value for key, value in item.items() if key != "file"}
    read = read_file(Path(item["file"]), **options)
    return read.model_dump(mode="json", exclude_none=True)
