"""Links without mass in a plain URDF: roots that stand for the world, ends that are only drawn, and parts of a joint.

A body that every joint moves needs a mass. A joint of several axes is often written as joints one after the other with
links between them that have none; such a link gets a share of the mass of the next one, taken where the joint between
them is, which changes neither the mass of the robot nor, if the axes meet there, its CoM and inertia.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Final

import numpy as np
import pinocchio as pin

from stridelab.robots.inertias import WATER_KG_M3
from stridelab.robots.proposal.joint_tree import joint_end

SHARES: Final = (1e-2, 3e-3, 1e-3)
"""Shares in the mass of the next link that are tried until a body remains of it."""
WORLDS: Final = ("world", "map", "odom")
_MOMENTS: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def fix_massless_ends(root: ET.Element, assumed: dict[str, str]) -> None:
    """Fix turning joints with no mass at all behind them, such as those of fingers that are only drawn."""
    above = {joint_end(joint, "child"): joint_end(joint, "parent") for joint in root.findall("joint")}
    own_kg = {link.attrib["name"]: _mass_kg(link) for link in root.findall("link")}
    moved_kg = dict.fromkeys(own_kg, 0.0)
    for link, mass_kg in own_kg.items():
        at: str | None = link
        while at is not None:
            moved_kg[at] += abs(mass_kg)
            at = above.get(at)
    for joint in root.findall("joint"):
        if joint.attrib["type"] != "fixed" and moved_kg[joint_end(joint, "child")] == 0.0:
            joint.set("type", "fixed")
            for tag in ("axis", "limit", "dynamics"):
                for element in joint.findall(tag):
                    joint.remove(element)
            assumed[f"joint {joint.attrib['name']}: type"] = "fixed here, since nothing with a mass is behind it"


def remove_world(root: ET.Element, assumed: dict[str, str]) -> None:
    """Remove a root link without mass that one joint attaches to the robot: the robot's base floats.

    Such a root has the name of the world, or its joint moves: one that is fixed to the robot is a frame of its base.
    """
    joints = root.findall("joint")
    children = {joint_end(joint, "child") for joint in joints}
    (base,) = [link for link in root.findall("link") if link.attrib["name"] not in children]
    below = [joint for joint in joints if joint_end(joint, "parent") == base.attrib["name"]]
    if _mass_kg(base) != 0.0 or len(below) != 1:
        return
    moves = below[0].attrib["type"] != "fixed"
    if moves or base.attrib["name"].lower() in WORLDS:
        root.remove(base)
        root.remove(below[0])
        gone = f"link {base.attrib['name']}: ", f"joint {below[0].attrib['name']}: "
        for key in [key for key in assumed if key.startswith(gone)]:
            del assumed[key]
        if moves and below[0].attrib["type"] != "floating":
            assumed[f"joint {below[0].attrib['name']}: type"] = "left out: it attaches the robot to a link without mass"


def share_masses(root: ET.Element, assumed: dict[str, str]) -> None:
    """Give links without mass between two turning joints a share of the mass of the next link that has one."""
    links = {link.attrib["name"]: link for link in root.findall("link")}
    below: dict[str, list[ET.Element]] = {name: [] for name in links}
    above: dict[str, ET.Element] = {}
    for joint in root.findall("joint"):
        below[joint_end(joint, "parent")].append(joint)
        above[joint_end(joint, "child")] = joint
    massless = [name for name, link in links.items() if _mass_kg(link) == 0.0 and name in above]
    for name in massless:
        following = _only_turning(below[name])
        if above[name].attrib["type"] == "fixed" or following is None:
            continue
        end = following
        while (
            joint_end(end, "child") in massless
            and (further := _only_turning(below[joint_end(end, "child")])) is not None
        ):
            end = further
        heavy = links[joint_end(end, "child")]
        if (split := _split_inertia(heavy)) is None:
            continue
        share, sphere, rest = split
        _write_inertia(heavy, rest)
        at_m = np.array([float(value) for value in following.find("origin").attrib["xyz"].split()])  # type: ignore[union-attr]
        _write_inertia(links[name], pin.Inertia(sphere.mass, at_m, sphere.inertia))
        assumed[f"link {name}: mass"] = (
            f"{100.0 * share:g} % of that of link {heavy.attrib['name']}, since it states none"
        )


def _only_turning(joints: list[ET.Element]) -> ET.Element | None:
    return joints[0] if len(joints) == 1 and joints[0].attrib["type"] != "fixed" else None


def _split_inertia(link: ET.Element) -> tuple[float, pin.Inertia, pin.Inertia] | None:
    """A share, a sphere of water with that share of a link's mass at its joint, and the rest; None if none is left."""
    whole = _inertia_of(link)
    if whole is None or whole.mass <= 0.0:
        return None
    for share in SHARES:
        mass_kg = share * whole.mass
        radius_m = (3.0 * mass_kg / (4.0 * np.pi * WATER_KG_M3)) ** (1.0 / 3.0)
        sphere = pin.Inertia.FromSphere(mass_kg, radius_m)
        rest = whole - sphere
        moments = np.linalg.eigvalsh(rest.inertia)
        if moments[0] > 0.0 and moments[0] + moments[1] >= moments[2]:
            return share, sphere, rest
    return None


def _inertia_of(link: ET.Element) -> pin.Inertia | None:
    inertial = link.find("inertial")
    if inertial is None:
        return None
    origin, inertia = inertial.find("origin"), inertial.find("inertia")
    assert origin is not None
    assert inertia is not None
    xyz, rpy = (np.array([float(value) for value in origin.attrib[key].split()]) for key in ("xyz", "rpy"))
    xx, xy, xz, yy, yz, zz = (float(inertia.attrib[key]) for key in _MOMENTS)
    R = pin.rpy.rpyToMatrix(rpy)
    return pin.Inertia(_mass_kg(link), xyz, R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T)


def _write_inertia(link: ET.Element, body: pin.Inertia) -> None:
    for stated in link.findall("inertial"):
        link.remove(stated)
    inertial = ET.Element("inertial")
    link.insert(0, inertial)
    ET.SubElement(inertial, "origin", xyz=" ".join(repr(float(value)) for value in body.lever), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(body.mass)))
    I = body.inertia
    values: Mapping[str, float] = dict(
        zip(_MOMENTS, (I[0, 0], I[0, 1], I[0, 2], I[1, 1], I[1, 2], I[2, 2]), strict=True)
    )
    ET.SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in values.items()})


def _mass_kg(link: ET.Element) -> float:
    mass = link.find("inertial/mass")
    return 0.0 if mass is None else float(mass.attrib["value"])
