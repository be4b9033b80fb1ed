"""A walk on level ground for any robot: what of a scenario depends on the robot comes from its reference posture.

HRP-2 with other axes of its root link: the same body, described in another frame.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import flat_walk
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.assembly import assemble_robot
from stridelab.robots.card import robot_card
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.data_files import data_files
from stridelab.robots.robot import Robot


def com_height_m(robot: Robot) -> float:
    """Of the CoM above the soles, in the reference posture."""
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
