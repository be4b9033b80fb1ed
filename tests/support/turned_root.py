"""HRP-2 with other axes of its root link: the same body, described in another frame."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from stridelab.robots.assembly import assemble
from stridelab.robots.card import robot_card
from stridelab.robots.data_files import data_files
from stridelab.robots.robot import Robot

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
    return assemble("hrp2", card, replace(files, urdf=folder / "hrp2.urdf"))


def _turn(element: ET.Element, R: np.ndarray) -> None:
    """Place what has an origin in the root link as it is seen from the turned axes."""
    origin = element.find("origin")
    if origin is None:
        origin = ET.SubElement(element, "origin")
    xyz, rpy = (np.array([float(x) for x in origin.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
    placed = pin.SE3(R, np.zeros(3)) * pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
    origin.set("xyz", " ".join(f"{x:.17g}" for x in placed.translation))
    origin.set("rpy", " ".join(f"{x:.17g}" for x in pin.rpy.matrixToRpy(placed.rotation)))
