"""Reads an uploaded robot and proposes its card, in killable confined children of ``POST /robots``.

The first child reads the stranger's bytes within the limits of parsing and leaves a rebuilt description; the second
proposes the card from it, draws its meshes and packs the files to be stored.
"""

import json
from pathlib import Path
from typing import Any

from stridelab.contacts.effector_geometry import plain_shapes
from stridelab.pipelines.progress import ProgressCallback
from stridelab.robots.assembly import assemble_robot
from stridelab.robots.data_files import data_files
from stridelab.robots.proposal.corrected_card import check_corrected_card
from stridelab.robots.proposal.packages import find_description, find_package, installed_packages, pack_description
from stridelab.robots.proposal.propose import card_fields, propose_card, rebuild_description
from stridelab.robots.robot import Robot
from stridelab.robots.visuals import glb, link_meshes
from stridelab.schemas.base import Contract
from stridelab.schemas.robots import RobotPackage
from stridelab.service.filenames import BUNDLE_FILE, INSTALLED_FILE, LINKS_FILE, STAGED_ROBOT
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.robots.description import robot_facts
from stridelab.service.kinds.robots.staged import MODELS_FOLDER, own_card, pack_files, write_card


class ReadRobotTask(Contract):
    """Task of reading: the uploaded file in the folder, its name at the user's, and the robot's name.

    ``description`` is the path, or its end, of the one that is read from a zip with several.
    """

    file: str
    filename: str
    name: str
    description: str = ""


class ProposeCardTask(Contract):
    """Task of the proposal, after reading in the same folder."""

    name: str
    title: str
    assumed: dict[str, str]


class PackInstalledTask(Contract):
    """Task of packing: an installed package, and the path, or its end, of one of its descriptions."""

    package: str
    description: str = ""


class CheckCardTask(Contract):
    """Task of checking the staged card."""

    name: str


def list_packages(task: Contract, _folder: Path, _progress: ProgressCallback) -> Outcome:
    """List the installed packages with descriptions of robots, as ``RobotPackage``; ``task`` is empty."""
    packages = [
        RobotPackage(package=one.name, version=one.version, descriptions=[str(path) for path in one.shortest_paths])
        for one in installed_packages().values()
    ]
    return Outcome({"packages": [one.model_dump(mode="json") for one in packages]}, (), ())


def pack_installed(task: PackInstalledTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Pack a robot of an installed package as ``INSTALLED_FILE``; the summary has a ``filename`` and its path in it.

    Raises as ``find_package``, ``find_description`` and ``pack_description``.
    """
    progress(0.0, "reading the package")
    package = find_package(task.package)
    inside = find_description(package, task.description)
    pack_description(package, inside, folder / INSTALLED_FILE)
    filename = f"{inside.stem} of {package.name} {package.version}.zip"
    return Outcome({"filename": filename, "inside": str(inside)}, (), ())


def read_robot(task: ReadRobotTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Rebuild the description; the summary is what was assumed. Raises as ``rebuild_description``."""
    progress(0.0, "reading the description")
    robots = folder / MODELS_FOLDER / "robots"
    assumed = rebuild_description(folder / task.file, task.filename, task.name, robots, task.description)
    return Outcome({"assumed": assumed}, (), ())


def propose(task: ProposeCardTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Propose the card; the summary has card, assumptions, facts and shapes. Raises as ``propose_card``."""
    models = folder / MODELS_FOLDER
    progress(0.1, "proposing the card")
    proposal = propose_card(task.name, task.title, models / "robots", task.assumed)
    write_card(models, task.name, proposal.card)
    progress(0.8, "drawing the robot")
    (folder / LINKS_FILE).write_bytes(glb(link_meshes(proposal.robot)))
    own = models / "robots" / task.name
    pack_files({path.name: path for path in own.iterdir()}, folder / BUNDLE_FILE)
    summary = {"card": card_fields(proposal.card), "assumed": dict(proposal.assumed)}
    return Outcome(summary | robot_state(proposal.robot), (), ())


def check_card(task: CheckCardTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Assemble the staged robot with its card; the summary has card, facts and shapes.

    Raises ``InvalidInput`` (``robot-card-invalid``, ``robot-description-invalid``) with one fault per field.
    """
    progress(0.1, "checking the card")
    fields = json.loads((folder / STAGED_ROBOT).read_text(encoding="utf-8"))["card"]
    card = own_card(task.name, fields)
    robot = assemble_robot(task.name, card, data_files(card))
    check_corrected_card(card, robot)
    return Outcome({"card": card_fields(card)} | robot_state(robot), (), ())


def robot_state(robot: Robot) -> dict[str, Any]:
    """What the service stores of a robot: ``facts`` (``RobotFacts``), and ``shapes`` of its effectors."""
    return {"facts": robot_facts(robot).model_dump(mode="json"), "shapes": plain_shapes(robot.name)}
