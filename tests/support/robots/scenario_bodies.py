"""Scenarios to send and to store, and the robots, effectors and terrains that they are about.

Scenarios to send and to store, made from the one of the interface's description.

Effectors of a robot of TALOS' size with round reach limits, and scenarios changed for the judge.

Terrains for the contact planner: stairs up and down, gaps, rails, at random; some of them lead nowhere.

A walk on level ground for any robot: what of a scenario depends on the robot comes from its reference posture.

HRP-2 with other axes of its root link: the same body, described in another frame.
"""

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from sqlalchemy import insert

from stridelab.contacts.effector_geometry import EffectorReach, EffectorShape
from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import flat_walk
from stridelab.contacts.validation.validate import ValidationReport, validate_scenario
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.assembly import assemble_robot
from stridelab.robots.card import robot_card
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.data_files import data_files
from stridelab.robots.robot import Robot
from stridelab.schemas.scenarios import Scenario
from stridelab.service.api.dependencies import Parts
from stridelab.service.samples.scenario_bodies import ONE_STEP
from stridelab.service.samples.scenarios import new_id
from stridelab.service.storage.tables import scenario


def one_step(**changes: Any) -> dict[str, Any]:
    """A valid body, with fields replaced."""
    return {**json.loads(json.dumps(ONE_STEP)), **changes}


def with_contact(phase: int, contact: int, **changes: Any) -> dict[str, Any]:
    """``one_step`` with fields of one contact replaced."""
    body = one_step()
    body["phases"][phase]["contacts"][contact] |= changes
    return body


async def add_scenario(parts: Parts, scenario_id: str | None = None, **columns: Any) -> str:
    """Insert a scenario unchecked; returns its id."""
    scenario_id = scenario_id or new_id()
    body = Scenario.model_validate(one_step()).model_dump(mode="json")
    async with parts.engine.begin() as connection:
        await connection.execute(insert(scenario).values({"id": scenario_id, "body": body, **columns}))
    return scenario_id


Made = dict[str, Any]
Change = Callable[[Made], None]

FOOT_REACH = EffectorReach((-0.9, -0.6, -0.1), (0.7, 0.6, 1.0), 1.05)
HAND_REACH = EffectorReach((-0.9, -0.9, -0.7), (0.9, 0.9, 0.9), 1.2)

SHAPES = {
    "left_foot": EffectorShape("surface", (0.10, 0.06), FOOT_REACH),
    "right_foot": EffectorShape("surface", (0.10, 0.06), FOOT_REACH),
    "left_hand": EffectorShape("point", None, HAND_REACH),
    "right_hand": EffectorShape("point", None, HAND_REACH),
}


def contact(scenario: Made, phase: int, effector: str) -> Made:
    match: Made
    (match,) = (c for c in scenario["phases"][phase]["contacts"] if c["effector"] == effector)
    return match


def everywhere(scenario: Made, effector: str, place: tuple[float, float, float], **change: Any) -> None:
    """Change all contacts of an effector at one place, as a drag in the viewer does."""
    for phase in scenario["phases"]:
        for entry in phase["contacts"]:
            if entry["effector"] == effector and np.allclose(entry["position_m"], place, atol=1e-6):
                entry.update(change)


def judged(scenario: Made, change: Change, shapes: Mapping[str, EffectorShape] = SHAPES) -> ValidationReport:
    change(scenario)
    return validate_scenario(scenario, shapes)


def faults(report: ValidationReport) -> list[tuple[str, str]]:
    """Places and messages, which go on after the place: no message begins with a capital letter."""
    listed_faults = [(fault.where, fault.message) for fault in report.faults]
    assert not any(message[0].isupper() for _, message in listed_faults)
    return listed_faults


Task = dict[str, Any]
KINDS = ("stairs up", "stairs down", "gaps", "rail")
FOOT_Y_M = 0.09


def box(name: str, x_m: tuple[float, float], top_m: float, width_m: float = 1.2, thick_m: float = 0.3) -> Task:
    center = [sum(x_m) / 2, 0.0, top_m - thick_m / 2]
    return {"name": name, "kind": "box", "center_m": center, "size_m": [x_m[1] - x_m[0], width_m, thick_m]}


def feet(x_m: float, z_m: float) -> list[Task]:
    sides = {"left_foot": FOOT_Y_M, "right_foot": -FOOT_Y_M}
    return [{"effector": name, "position_m": [x_m, y, z_m]} for name, y in sides.items()]


def task(terrain: list[Task], x_m: float, z_m: float) -> Task:
    """From the origin to level feet at ``x_m``."""
    ends = {"start": {"contacts": feet(0.0, 0.0)}, "goal": {"contacts": feet(x_m, z_m)}}
    return {"robot": "talos", "friction": 0.3, "terrain": terrain, **ends}


def planks(gap_m: float, number: int = 3, length_m: float = 0.5) -> Task:
    """Level planks with equal gaps between them."""
    starts = [-0.25 + i * (length_m + gap_m) for i in range(number)]
    return task([box(f"plank {i}", (x, x + length_m), 0.0) for i, x in enumerate(starts)], starts[-1] + 0.25, 0.0)


def random_task(rng: np.random.Generator, kind: str, most: int = 5) -> Task:
    """A way over up to ``most`` surfaces after the first."""
    number, top, x = int(rng.integers(2, most + 1)), 0.0, 0.4
    terrain = [box("start", (-0.4, 0.4), 0.0)]
    sign = -1.0 if kind == "stairs down" else 1.0
    for i in range(1, number + 1):
        gap = float(rng.uniform(0.0, 0.33)) if kind == "gaps" else 0.0
        top += 0.0 if kind == "gaps" else sign * float(rng.uniform(0.05, 0.19))
        length = 0.8 if i == number else float(rng.uniform(0.24, 0.45))
        terrain.append(box(f"part {i}", (x + gap, x + gap + length), top))
        x += gap + length
    planned_task = task(terrain, x - 0.4, top)
    if kind == "rail":
        _with_rail(planned_task, x - 0.4, top)
    return planned_task


def _with_rail(planned_task: Task, x_m: float, z_m: float) -> None:
    """A rail parallel to the way, the right hand on it at both ends."""
    slope, radius = z_m / x_m, 0.02
    a = math.atan(slope)

    def line(x: float) -> list[float]:
        return [x, -0.5, 0.8 + slope * x]

    ends = [[x + radius * math.sin(a), -0.5, 0.8 + slope * x - radius * math.cos(a)] for x in (-0.4, x_m + 0.8)]
    planned_task["terrain"].append(
        {"name": "rail", "kind": "rail", "from_m": ends[0], "to_m": ends[1], "radius_m": radius, "friction": 0.6}
    )
    wxyz = [math.cos(a / 2), 0.0, -math.sin(a / 2), 0.0]
    for end, x in (("start", 0.2), ("goal", x_m + 0.2)):
        planned_task[end]["contacts"].append(
            {"effector": "right_hand", "position_m": line(x), "orientation_wxyz": wxyz}
        )


def com_height_m(robot: Robot) -> float:
    """Height of the CoM above the soles in the reference posture."""
    return float(pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)[2])


def walk_of(robot: Robot, steps: int, step_m: float, timing: Timing) -> dict[str, Any]:
    """``stairs.flat_walk`` with the feet as far apart as ``robot`` has them."""
    model, index = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    scenario = deepcopy(flat_walk(steps, step_m, timing))
    scenario["robot"] = robot.name
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            contact["position_m"][1] = float(data.oMf[index[contact["effector"]]].translation[1])
    return scenario


def one_normal(robot: Robot) -> Mapping[str, Proxy]:
    """One wide normal density per foot, about where the CoM is in the reference posture, in place of learned ones."""
    h = com_height_m(robot)
    covariance = np.diag([0.23 * h, 0.17 * h, 0.12 * h]) ** 2
    mean = np.array([[0.0, 0.0, 0.95 * h]])
    return {name: Proxy(Mixture(np.ones(1), mean, covariance[None])) for name in ("left_foot", "right_foot")}


ROOT = "BODY"


def turned_hrp2(R: np.ndarray, folder: Path) -> Robot:
    """HRP-2 whose root link's axes are the columns of ``R`` (ahead, left and up are its usual ones)."""
    card = robot_card("hrp2")
    files = data_files(card)
    tree = ET.parse(files.urdf)
    root = next(link for link in tree.getroot().findall("link") if link.attrib["name"] == ROOT)
    for tag in ("inertial", "visual", "collision"):
        for element in root.findall(tag):
            _turn(element, R.T)
    for joint in tree.getroot().findall("joint"):
        if joint.find("parent").attrib["link"] == ROOT:
            _turn(joint, R.T)
    folder.mkdir(exist_ok=True)
    tree.write(folder / "hrp2.urdf")
    return assemble_robot("hrp2", card, replace(files, urdf=folder / "hrp2.urdf"))


def _turn(element: ET.Element, R: np.ndarray) -> None:
    """Place what has an origin in the root link as it is seen from the turned axes."""
    origin = element.find("origin")
    if origin is None:
        origin = ET.SubElement(element, "origin")
    xyz, rpy = (np.array([float(x) for x in origin.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
    placed = pin.SE3(R, np.zeros(3)) * pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
    origin.set("xyz", " ".join(f"{x:.17g}" for x in placed.translation))
    origin.set("rpy", " ".join(f"{x:.17g}" for x in pin.rpy.matrixToRpy(placed.rotation)))
