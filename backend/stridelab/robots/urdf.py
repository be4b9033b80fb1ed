"""Reads a robot's description with pinocchio: the full model and its geometries."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.errors import Fault, Unavailable
from stridelab.robots.robot import Robot


def full_model(urdf: Path) -> pin.Model:
    """All joints of the description on a floating base.

    Raises ``Unavailable`` (``robot-data-unreadable``).
    """
    return _read_or_raise(urdf, lambda: pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer()))


def read_srdf(model: pin.Model, srdf: Path) -> None:
    """Load the reference postures of an SRDF and, if given, its rotor inertias (as ``armature``) into ``model``.

    Raises ``Unavailable`` (``robot-data-unreadable``).
    """

    def load_into_model() -> None:
        if parse_xml(srdf).find("rotor_params") is not None:  # not every SRDF has them
            pin.loadRotorParameters(model, str(srdf), False)
        pin.loadReferenceConfigurations(model, str(srdf), False)

    _read_or_raise(srdf, load_into_model)
    model.armature = model.rotorInertia * model.rotorGearRatio**2


def collision_geometry(model: pin.Model, urdf: Path, package_dirs: Sequence[Path]) -> pin.GeometryModel:
    """The collision geometries of the full model, without pairs.

    Raises ``Unavailable`` (``robot-data-unreadable``, ``robot-meshes-missing``).
    """
    return _read_geometry(model, urdf, package_dirs, pin.GeometryType.COLLISION)


def visual_geometry(model: pin.Model, urdf: Path, package_dirs: Sequence[Path]) -> pin.GeometryModel:
    """The visual geometries of the full model.

    Raises ``Unavailable`` (``robot-data-unreadable``, ``robot-meshes-missing``).
    """
    return _read_geometry(model, urdf, package_dirs, pin.GeometryType.VISUAL)


def matching_visuals(
    model: pin.Model, urdf: Path, package_dirs: Sequence[Path], patterns: Sequence[str]
) -> pin.GeometryModel:
    """The visual geometries of the links with a geometry that matches a pattern; reading all would take seconds.

    The name of a geometry is that of its link with its index in the link.

    Raises ``Unavailable`` (``robot-data-unreadable``, ``robot-meshes-missing``).
    """
    _require_meshes(urdf, package_dirs)
    root = parse_xml(urdf)
    for link in root.iter("link"):
        shapes = link.findall("visual")
        names = (f"{link.attrib['name']}_{i}" for i in range(len(shapes)))
        if not any(re.fullmatch(pattern, name) for name in names for pattern in patterns):
            for shape in shapes:
                link.remove(shape)
    text, folders = ET.tostring(root, encoding="unicode"), [str(folder) for folder in package_dirs]
    kind = pin.GeometryType.VISUAL
    return _read_or_raise(urdf, lambda: pin.buildGeomFromUrdfString(model, text, kind, package_dirs=folders))


def full_configuration(robot: Robot, model: pin.Model) -> Float[np.ndarray, "nq_full"]:
    """The reference posture of ``robot`` in the coordinates of the full ``model``."""
    q = pin.neutral(model)
    q[:7] = robot.q_reference[:7]
    for joint, angle_rad in [*zip(robot.joint_names, robot.q_reference[7:], strict=True), *robot.locked.items()]:
        q[model.joints[model.getJointId(joint)].idx_q] = angle_rad
    return np.asarray(q)


def _read_geometry(
    model: pin.Model, urdf: Path, package_dirs: Sequence[Path], kind: pin.GeometryType
) -> pin.GeometryModel:
    _require_meshes(urdf, package_dirs)
    folders = [str(folder) for folder in package_dirs]
    return _read_or_raise(urdf, lambda: pin.buildGeomFromUrdf(model, str(urdf), kind, package_dirs=folders))


def _require_meshes(urdf: Path, package_dirs: Sequence[Path]) -> None:
    missing = sorted(set(missing_meshes(urdf, package_dirs)))
    if missing:
        faults = [Fault(name, "there is no such file") for name in missing]
        what = f"{urdf.name} names {len(missing)} meshes that are missing, such as {missing[0]}."
        raise Unavailable("robot-meshes-missing", what, faults)


def missing_meshes(urdf: Path, package_dirs: Sequence[Path]) -> Iterator[str]:
    """Meshes of a URDF that do not exist. Only ``package://`` names are supported, relative to ``package_dirs``."""
    for mesh in parse_xml(urdf).iter("mesh"):
        name = mesh.attrib.get("filename", "")
        inside = name.removeprefix("package://")
        if inside == name or not any((folder / inside).is_file() for folder in package_dirs):
            yield name


def parse_xml(urdf: Path) -> ET.Element:
    """The URDF's XML. Raises ``Unavailable`` (``robot-data-unreadable``) with the position of the error."""
    try:
        return ET.parse(urdf).getroot()  # noqa: S314 (a file of the installation, not a user's)
    except ET.ParseError as error:
        raise Unavailable(
            "robot-data-unreadable", f"The robot description {urdf.name} cannot be read: {error}."
        ) from error


def _read_or_raise(path: Path, read: Callable[[], Any]) -> Any:
    try:
        return read()
    except (ValueError, RuntimeError) as error:  # raised by pinocchio for a broken or a missing file
        parse_xml(path)  # says where the XML is broken, if it is
        raise Unavailable("robot-data-unreadable", f"The robot description {path.name} cannot be read.") from error
