"""Reflected inertias of motors that a description adds to the moments of its links.

A motor behind a gear resists the motion of its joint by J about the joint's axis a, and nothing else. Some descriptions
state it with the link that the joint moves, I = I_b + J a a^T; where J is large, no body has such moments.
"""

import xml.etree.ElementTree as ET
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.robots.inertias import MOMENT_TOLERANCE

ALIGNED: Final = 0.999
"""Least cosine between the axis of the largest moment and that of the joint."""
_ENTRIES: Final = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


def move_motor_inertias(root: ET.Element, assumed: dict[str, str]) -> None:
    """Move J from the links of a plain description to their joints, as ``armature``; ``assumed`` is extended."""
    inertials = {link.attrib["name"]: link.find("inertial") for link in root.findall("link")}
    for joint in root.findall("joint"):
        axis, child = joint.find("axis"), joint.find("child")
        inertial = None if child is None else inertials[child.attrib["link"]]
        if axis is None or inertial is None:
            continue
        inertia = inertial.find("inertia")
        assert inertia is not None
        I = np.empty((3, 3))
        for key, (row, column) in _ENTRIES.items():
            I[row, column] = I[column, row] = float(inertia.attrib[key])
        origin = inertial.find("origin")
        rpy = np.zeros(3) if origin is None else np.array(origin.get("rpy", "0 0 0").split(), float)
        a = pin.rpy.rpyToMatrix(rpy).T @ np.array(axis.attrib["xyz"].split(), float)
        if (J := motor_inertia(I, a)) == 0.0:
            continue
        body = I - J * np.outer(a, a)
        inertia.attrib.update({key: repr(float(body[entry])) for key, entry in _ENTRIES.items()})
        dynamics = joint.find("dynamics")
        if dynamics is None:
            dynamics = ET.SubElement(joint, "dynamics", damping="0", armature="0")
        dynamics.set("armature", repr(float(dynamics.attrib["armature"]) + J))
        where = f"joint {joint.attrib['name']}: rotor inertia"
        assumed[where] = f"{J:.2g} kg m2, which the description adds to the moments of its link"


def motor_inertia(I: Float[np.ndarray, "3 3"], a: Vector3) -> float:
    """Inertia J (kg m2) of a motor in the moments ``I`` (kg m2) of a link that turns about ``a``; 0 if there is none.

    Where the largest moment exceeds the sum of the others and acts about ``a``, the body itself is taken to have about
    ``a`` the larger of its other moments.
    """
    moments, axes = np.linalg.eigh(I)
    if moments[0] <= 0.0 or moments[2] <= (moments[0] + moments[1]) * (1.0 + MOMENT_TOLERANCE):
        return 0.0
    J = float(a @ I @ a - moments[1])
    body = np.linalg.eigvalsh(I - J * np.outer(a, a))
    is_body = body[0] > 0.0 and body[2] <= body[0] + body[1]
    return J if abs(axes[:, 2] @ a) > ALIGNED and is_body else 0.0
