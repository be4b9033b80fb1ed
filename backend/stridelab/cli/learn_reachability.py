"""``stridelab learn-reachability``: learns the density of a robot's CoM and writes a result folder.

``stridelab add-robot``: proposes the card of one's own robot, learns its densities and lets it walk.
"""

import json
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from stridelab.cli.estimate import run_job
from stridelab.cli.options import Delivery, PostureMeasure, with_groups
from stridelab.cli.results import FAILURE, deliver_result, out, progress_bar, show_files, show_remarks
from stridelab.errors import Conflict, Fault, InvalidInput, NotFound, StridelabError
from stridelab.machine.models_folder import ROBOTS_VARIABLE, add_models_folder
from stridelab.machine.parallel import map_isolated
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.robots import (
    NAME_PATTERN,
    CommissionRobotInput,
    CommissionRobotSummary,
    LearnReachabilityInput,
    LearnReachabilitySummary,
    LearnReachabilityTask,
)
from stridelab.service.local_runs import validate_options

READ_S, READ_MB = 60.0, 1024
"""Limits of the process that reads a description."""

if TYPE_CHECKING:
    from stridelab.robots.proposal.packages import InstalledPackage
    from stridelab.robots.proposal.propose import Proposal


@with_groups
def learn_reachability(
    *,
    robot: Annotated[str, typer.Argument(help="A robot by name: talos, hrp2, g1.")],
    measure: Annotated[
        PostureMeasure,
        typer.Option("--measure", help="How postures are sampled: uniformly, or conditioned on standing."),
    ] = "uniform",
    samples: Annotated[int | None, typer.Option("--samples", help="Number of valid postures, 500 to 200000.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of the postures and of the fits.")] = None,
    effector: Annotated[
        list[str] | None, typer.Option("--effector", help="Learn this effector only; may be repeated.")
    ] = None,
    delivery: Delivery,
) -> None:
    """Learn the density of a robot's centre of mass relative to its effectors; needs no server."""
    options = {"robot": robot, "measure": measure, "samples": samples, "seed": seed, "effectors": effector or None}
    input_ = validate_options(
        LearnReachabilityInput, {key: value for key, value in options.items() if value is not None}
    )
    name, task = input_.robot, LearnReachabilityTask(input=input_)
    deliver_result(
        f"reachability-{Path(name).name}-{input_.measure}",
        delivery,
        lambda folder: run_job("learn-reachability", name, task, folder, delivery),
        show_learned,
    )


def show_learned(result: JobResult, target: Path) -> None:
    """Print one row per effector."""
    summary = LearnReachabilitySummary.model_validate(result.summary)
    out.print(
        f"[bold]{escape(summary.robot)}[/] {summary.measure}: {summary.samples} postures of {summary.tried}, "
        f"{100 * summary.rejected_share:.1f} % collided"
    )
    table = Table("", "components", "thesis", "KL (nats)", "held out (nats)", "kernels (m)", box=None, pad_edge=False)
    for name, effector in summary.effectors.items():
        table.add_row(
            escape(name),
            str(effector.components),
            str(effector.thesis_components),
            f"{effector.kl_nats:.4f} ± {effector.kl_sd_nats:.4f}",
            f"{effector.held_out_log_likelihood:.3f}",
            f"{effector.bandwidth_m:.3f}",
        )
    out.print(table)
    show_remarks(summary.warnings)
    show_files(result, target)


@with_groups
def add_robot(
    *,
    file: Annotated[
        Path | None,
        typer.Argument(
            help="A zip of one URDF or MJCF file and its meshes, such a file without meshes, or an installed package "
            "and its description, as example-robot-data/romeo (--list). Without it, the robot of this name is "
            "commissioned again, with its card as it is now."
        ),
    ] = None,
    name: Annotated[
        str,
        typer.Option(
            "--name",
            help="Name of the robot: small letters, digits and hyphens; that of its file if omitted.",
        ),
    ] = "",
    listing: Annotated[
        bool, typer.Option("--list", help="List the robots of installed packages; nothing is added.")
    ] = False,
    robots: Annotated[
        Path, typer.Option("--robots", help="Folder of robots of your own.", envvar=ROBOTS_VARIABLE)
    ] = Path("robots"),
    description: Annotated[
        str, typer.Option("--description", help="Which description of a zip with several: its path, or its end.")
    ] = "",
    commission: Annotated[
        bool, typer.Option("--commission/--no-commission", help="Learn its densities and let it walk.")
    ] = True,
    samples: Annotated[int, typer.Option("--samples", help="Postures per density, 500 to 20000.")] = 3000,
    search_s: Annotated[
        float, typer.Option("--search-s", help="Seconds for turn, stair, pace and pushes, up to 360; 0: none.")
    ] = 300.0,
    use_estimates: Annotated[
        bool,
        typer.Option("--use-estimates", help="Take the estimates of stated torques that are implausible."),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a robot of this name.")] = False,
) -> None:
    """Propose the card of your own humanoid, then learn its densities and plan, certify and replay a level walk."""
    from stridelab.robots.card import robot_names
    from stridelab.robots.proposal.offered_estimates import take_estimates
    from stridelab.robots.proposal.packages import pack_description
    from stridelab.robots.proposal.propose import card_toml, propose_card

    if listing:
        show_packages()
        return
    installed = None if file is None or file.is_file() else _find_installed(file.as_posix(), description)
    if file is not None:
        name = name or re.sub(r"[^a-z0-9]+", "-", (file if installed is None else installed[1]).stem.lower()).strip("-")
    if not re.fullmatch(NAME_PATTERN, name):
        fault = Fault("--name", "invalid" if name else "missing")
        raise InvalidInput("invalid-request", "A robot's name has 2 to 40 small letters, digits and hyphens.", [fault])
    request = validate_options(CommissionRobotInput, {"robot": name, "samples": samples, "search_s": search_s})
    own = robots / "robots"
    if file is None:
        if not (own / f"{name}.toml").is_file():
            raise NotFound("robot-not-found", f"There is no robot {name} in {robots}; name its file.")
        _check_own_card(name, robots)
        _commission_own_robot(request, robots)
        return
    with _set_aside(robots, name) if force else nullcontext():
        if name in robot_names() or (own / f"{name}.toml").exists() or (own / name).exists():
            raise Conflict("robot-name-taken", f"There is a robot named {name}; choose another name, or use --force.")
        own.mkdir(parents=True, exist_ok=True)
        title = file.stem
        try:
            with tempfile.TemporaryDirectory() as scratch:
                if installed is not None:
                    package, inside = installed
                    title = f"{inside.stem} of {package.name} {package.version}"
                    file, description = Path(scratch, f"{inside.stem}.zip"), str(inside)
                    pack_description(package, inside, file)
                assumed = _rebuild_apart(file, name, own, description, Path(scratch))
            proposal = propose_card(name, title[:60], own, assumed)
            if use_estimates:
                card, assumed = take_estimates(proposal.card, proposal.assumed)
                proposal = replace(proposal, card=card, assumed=assumed)
            (own / f"{name}.toml").write_text(card_toml(proposal.card), encoding="utf-8")
        except BaseException:
            shutil.rmtree(own / name, ignore_errors=True)
            raise
    show_proposal(proposal, own / f"{name}.toml")
    if commission:
        _commission_own_robot(request, robots)


def _rebuild_apart(file: Path, name: str, own: Path, description: str, scratch: Path) -> dict[str, str]:
    """``rebuild_description`` into the folder ``own``, computed by a process with limits that works in ``scratch``.

    Raises as ``rebuild_description``, and ``StridelabError`` (``computation-timed-out``, ``computation-crashed``).
    """
    item = {"file": str(file), "filename": file.name, "name": name, "description": description, "folder": str(scratch)}
    ((_, read),) = map_isolated(_rebuild_here, [item], preload=["pinocchio"], timeout_s=READ_S, spans_nodes=False)
    if isinstance(read, StridelabError):
        raise read
    shutil.move(scratch / name, own / name)
    return read


def _rebuild_here(item: Mapping[str, str]) -> dict[str, str]:
    """In a process of its own: rebuild the description in a folder."""
    from stridelab.robots.proposal.propose import rebuild_description
    from stridelab.service.processes.child import limit_memory

    limit_memory(READ_MB)
    return rebuild_description(
        Path(item["file"]), item["filename"], item["name"], Path(item["folder"]), item["description"]
    )


def _find_installed(text: str, description: str) -> "tuple[InstalledPackage, PurePosixPath]":
    """The package and the description that ``text`` names, as ``package`` or ``package/description``.

    Raises ``NotFound`` (``file-not-found``) for what looks like a path, ``InvalidInput`` as ``find_package`` and
    ``find_description``.
    """
    from stridelab.robots.proposal.packages import find_description, find_package

    package, _, inside = text.partition("/")
    if not package or package.startswith(".") or (not inside and text.lower().endswith((".zip", ".urdf", ".xml"))):
        raise NotFound("file-not-found", f"There is no file {text}.", [Fault(text, "missing")])
    try:
        installed = find_package(package)
    except InvalidInput as error:
        message = f"There is no file {text}. {error.message}"
        raise InvalidInput(error.code, message, error.faults) from error
    return installed, find_description(installed, description or inside)


def show_packages() -> None:
    """Print the descriptions of robots in installed packages."""
    from stridelab.robots.proposal.packages import installed_packages

    packages = installed_packages()
    if not packages:
        out.print("No installed package has the description of a robot with twelve moving joints.")
    for package in packages.values():
        out.print(f"[bold]{escape(package.name)}[/] {escape(package.version)}")
        for path in package.shortest_paths:
            out.print(f"  {escape(str(path))}")


def _check_own_card(name: str, robots: Path) -> None:
    """Raises ``InvalidInput`` (``robot-card-invalid``, ``robot-description-invalid``) as the service does."""
    from stridelab.robots.assembly import assemble_robot
    from stridelab.robots.card import parse_card
    from stridelab.robots.data_files import data_files
    from stridelab.robots.proposal.corrected_card import check_corrected_card

    add_models_folder(robots)
    card = parse_card(name, (robots / "robots" / f"{name}.toml").read_bytes())
    check_corrected_card(card, assemble_robot(name, card, data_files(card)))


def _commission_own_robot(request: CommissionRobotInput, robots: Path) -> None:
    """Commission a robot of the folder ``robots``; raises ``typer.Exit`` if it does not walk."""
    from stridelab.pipelines.commissioning.commission_robot import commission_robot

    add_models_folder(robots)
    with progress_bar(request.robot) as bar:
        result = commission_robot(request, robots, bar)
    scenario = robots / "robots" / request.robot / "walk.json"
    scenario.write_text(json.dumps(result.scenario, indent=1) + "\n", encoding="utf-8")
    for name, further in result.capability_scenarios.items():
        scenario.with_name(f"{name}.json").write_text(json.dumps(further, indent=1) + "\n", encoding="utf-8")
    show_commission(result.summary)
    out.print(f"The walk is {escape(str(scenario))}; set {ROBOTS_VARIABLE}={escape(str(robots))} to plan with it.")
    if not (result.summary.first_walk.certified and result.summary.first_walk.completed):
        raise typer.Exit(FAILURE)


@contextmanager
def _set_aside(robots: Path, name: str) -> Iterator[None]:
    """Remove the robot ``name`` of the folder, if there is one; it is put back if the context ends with an error."""
    with tempfile.TemporaryDirectory(dir=robots if robots.is_dir() else None) as scratch:
        parts = (Path("robots", f"{name}.toml"), Path("robots", name), Path("reachability", name))
        moved = [(robots / part, Path(scratch, str(k))) for k, part in enumerate(parts) if (robots / part).exists()]
        for path, aside in moved:
            path.rename(aside)
        try:
            yield
        except BaseException:
            for path, aside in moved:
                aside.rename(path)
            raise


def show_proposal(proposal: "Proposal", path: Path) -> None:
    """Print the effectors of a proposed card, and what was assumed."""
    robot = proposal.robot
    size = f"{robot.mass_kg:.1f} kg, {len(robot.joint_names)} joints"
    out.print(f"[bold]{escape(robot.name)}[/]: {size}, {escape(str(path))}")
    table = Table("effector", "link", "kind", "contact patch", box=None, pad_edge=False)
    for name, effector in proposal.card.effectors.items():
        half = effector.contact_half_size_m
        patch = "" if half is None else f"{2e3 * half[0]:.0f} x {2e3 * half[1]:.0f} mm"
        table.add_row(name, escape(effector.frame), effector.kind, patch)
    out.print(table)
    fields_of: dict[str, list[str]] = {}
    for field, how in proposal.assumed.items():
        fields_of.setdefault(how, []).append(field)
    assumed = Table("assumed", "", box=None, pad_edge=False)
    for how, fields in fields_of.items():
        more = f", and {len(fields) - 2} more" if len(fields) > 2 else ""
        assumed.add_row(escape(", ".join(fields[:2]) + more), escape(how))
    out.print(assumed)


def show_commission(summary: CommissionRobotSummary) -> None:
    """Print one row per attempted walk, then one per capability."""
    table = Table("step (m)", "certified", "replay", "CoM error (mm)", "torque ratio", "", box=None, pad_edge=False)
    for attempt in summary.first_walk.attempts:
        error_m, ratio = attempt.com_error_max_m, attempt.torque_ratio_max
        table.add_row(
            f"{attempt.step_m:.3f}",
            "yes" if attempt.certified else "no",
            "completed" if attempt.completed else "no",
            "" if error_m is None else f"{1e3 * error_m:.1f}",
            "" if ratio is None else f"{ratio:.2f}",
            escape(attempt.reason),
        )
    out.print(table)
    tried = [one for one in summary.capabilities if one.ended_by != "not-tried"]
    if not tried:
        return
    table = Table("capability", "largest", "", "not more, because", box=None, pad_edge=False)
    for one in summary.capabilities:
        value = "" if one.value is None else f"{one.value:.3g}" if one.value else "none"
        more = {"range": "end of the range", "time": "the time ended"}.get(one.ended_by, one.reason)
        table.add_row(one.name, value, one.unit, escape(more))
    out.print(table)
