"""Validation of the masses and inertias of a description, link by link, with the criteria of a simulator.

Pinocchio merges links that are fixed to each other into one body, which hides an invalid inertia of one of them.
MuJoCo keeps every link and every joint, including those that the reduced model locks. A link with mass ``m`` and
principal moments ``I_1 <= I_2 <= I_3`` about its centre of mass is physically possible if

    I_1 >= m k^2 ,    I_3 <= I_1 + I_2 ,    k = max(0.1 mm, size / 1000)

where ``size`` is the diagonal of the bounding box of its largest collision shape. A link without inertia is a point
mass and a link without mass is a frame; both are valid if a link that is fixed to them has an inertia.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.errors import Fault

MIN_GYRATION_M: Final = 1e-4
"""Minimum radius of gyration of a link of unknown size."""
MIN_GYRATION_PER_SIZE: Final = 1e-3
"""Minimum ratio of radius of gyration to size of a link; that of a solid rod 500 times as long as thick."""
MOMENT_TOLERANCE: Final = 1e-6
"""Relative amount by which the largest moment may exceed the sum of the others, as in a simulator."""
LONGEST_BODY_M: Final = 5.0
"""Largest radius of gyration; beyond it a moment of inertia has another unit."""
SMALLEST_SPHERE_M: Final = 0.005
ROUNDING_KG_M2: Final = 1e-7
"""Negative moments up to this size are zero but for the few digits that a description states."""
ROUNDING_PER_SPHERE: Final = 0.1
"""The same as a share of the moment of a sphere of water of the same mass, which is added to them."""
WATER_KG_M3: Final = 1000.0
ALLOWED_JOINT_TYPES: Final = ("fixed", "revolute", "continuous")
_MOMENTS: Final = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))


@dataclass(frozen=True)
class Link:
    """A link; ``moments_kg_m2`` are its principal moments of inertia about its centre of mass, ascending."""

    name: str
    mass_kg: float
    moments_kg_m2: Float[np.ndarray, "3"]


def sizes_m(model: pin.Model, collision: pin.GeometryModel) -> dict[str, float]:
    """Diagonal of the bounding box of the largest collision shape of every link that has one (m)."""
    sizes: dict[str, float] = {}
    for part in collision.geometryObjects:
        part.geometry.computeLocalAABB()
        box, link = part.geometry.aabb_local, str(model.frames[part.parentFrame].name)
        diagonal_m = float(np.linalg.norm(box.max_ - box.min_))
        sizes[link] = max(sizes.get(link, 0.0), diagonal_m)
    return sizes


def inertia_faults(root: ET.Element, sizes: Mapping[str, float], accepted: Sequence[str]) -> Iterator[Fault]:
    """Faults of links with impossible inertias, of joints that are not revolute, and of joints that move no inertia.

    ``root`` is the URDF, ``sizes`` the sizes of the links (m). In links that match a pattern of ``accepted``, the
    largest moment may exceed the sum of the others.
    """
    links: dict[str, Link] = {}
    faults = []
    for element in root.findall("link"):
        name = element.attrib["name"]
        try:
            link = links[name] = read_link(element)
        except ValueError as error:
            faults.append(Fault(f"link {name}", str(error)))
            continue
        tolerant = any(re.fullmatch(pattern, name) for pattern in accepted)
        faults += [Fault(f"link {name}", message) for message in _link_faults(link, sizes.get(name, 0.0), tolerant)]
    yield from faults
    for joint in root.findall("joint"):
        if joint.attrib["type"] not in ALLOWED_JOINT_TYPES:
            kind = joint.attrib["type"]
            yield Fault(f"joint {joint.attrib['name']}", f"it is {kind}; joints must turn about one axis, or be fixed")
    if not faults:  # otherwise the same link would be reported twice
        yield from _moved_without_inertia(root, links)


def read_link(element: ET.Element) -> Link:
    """A link of a URDF. Raises ``ValueError`` naming the number that is missing or invalid."""
    inertial = element.find("inertial")
    if inertial is None:
        return Link(element.attrib["name"], 0.0, np.zeros(3))
    mass_kg = _read_number(inertial, "mass", "value")
    I = np.array([[_read_number(inertial, "inertia", key) for key in row] for row in _MOMENTS])
    return Link(element.attrib["name"], mass_kg, np.linalg.eigvalsh(I))


def completed_inertia(mass_kg: float, inertia: Mapping[str, float]) -> tuple[dict[str, float], str] | None:
    """Inertia (kg m2, by element) of a point, a line or a plate with a volume, and how; None where nothing is missing.

    A principal moment that is zero but for rounding is missing. A sphere of water of the same mass is added; it
    replaces moments that contradict each other (the largest exceeds the sum of the others).
    """
    xx, xy, xz, yy, yz, zz = (inertia[key] for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    I = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least = mass_kg * MIN_GYRATION_M**2
    if not (mass_kg > 0.0 and I[0] < least and I[2] < mass_kg * LONGEST_BODY_M**2):
        return None
    radius_m = max((0.75 * mass_kg / (math.pi * WATER_KG_M3)) ** (1.0 / 3.0), SMALLEST_SPHERE_M)
    sphere = 0.4 * mass_kg * radius_m**2
    if I[0] <= -max(least, min(ROUNDING_KG_M2, ROUNDING_PER_SPHERE * sphere)):
        return None
    diagonal = ("ixx", "iyy", "izz")
    if I[2] > I[0] + I[1] + least:
        return {key: sphere if key in diagonal else 0.0 for key in inertia}, f"that of a sphere, {sphere:.2g} kg m2"
    completed = {key: value + (sphere if key in diagonal else 0.0) for key, value in inertia.items()}
    return completed, f"{sphere:.2g} kg m2 added about every axis, since a moment is 0"


def _read_number(inertial: ET.Element, tag: str, key: str) -> float:
    child = inertial.find(tag)
    text = None if child is None else child.get(key)
    if text is None:
        raise ValueError(f"its <inertial> has no {key} of <{tag}>")
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ValueError(f"{key} of its <{tag}> is {text!r}, which is not a number")
    return value


def _link_faults(link: Link, size_m: float, accept_large_moment: bool) -> Iterator[str]:
    m, I = link.mass_kg, link.moments_kg_m2
    if m < 0.0:
        yield f"its mass is {m:g} kg; it must not be negative"
    elif I.any():
        k = max(MIN_GYRATION_M, MIN_GYRATION_PER_SIZE * size_m)
        if m == 0.0:
            yield "it has an inertia but no mass"
        elif not I[0] >= m * k**2:
            yield (
                f"its smallest principal moment of inertia is {I[0]:.3g} kg m2; with a mass of {m:g} kg it must be "
                f"at least {m * k**2:.3g} kg m2"
            )
        elif I[2] > (I[0] + I[1]) * (1.0 + MOMENT_TOLERANCE) and not accept_large_moment:
            yield (
                f"its principal moments of inertia {I[0]:.3g}, {I[1]:.3g} and {I[2]:.3g} kg m2 are not physical: "
                "the largest exceeds the sum of the others"
            )


def _moved_without_inertia(root: ET.Element, links: Mapping[str, Link]) -> Iterator[Fault]:
    """Faults of the base and of links moved by a joint if no link with an inertia is fixed to them."""
    joints = {_joint_end(joint, "child"): joint for joint in root.findall("joint")}
    carried: dict[str, list[Link]] = {}
    for link in links.values():
        name = link.name
        while name in joints and joints[name].attrib["type"] == "fixed":
            name = _joint_end(joints[name], "parent")
        carried.setdefault(name, []).append(link)
    for name, fixed in carried.items():
        what = f"joint {joints[name].attrib['name']!r} moves" if name in joints else "is the base"
        mass_kg = sum(link.mass_kg for link in fixed)
        if mass_kg == 0.0:
            yield Fault(f"link {name}", f"what {what} has the mass 0 kg; it needs an <inertial> with a mass")
        elif not any(link.moments_kg_m2[0] > 0.0 for link in fixed):
            yield Fault(f"link {name}", f"what {what} has the mass {mass_kg:g} kg, but no inertia")


def _joint_end(joint: ET.Element, which: str) -> str:
    return next(iter(joint.findall(which))).attrib["link"]
