"""Reading a robot's description with pinocchio: its full model and geometries, as they stand in the data package."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.errors import Unavailable
from stridelab.robots.robot import Robot


def full_model(urdf: Path) -> pin.Model:
    """All joints of the description on a floating base.

    Raises ``Unavailable`` (``robot-data-unreadable``).
    """
    return _read(urdf, lambda: pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer()))


def read_srdf(model: pin.Model, srdf: Path) -> None:
    """Give ``model`` the reference postures and the rotor inertias (as ``armature``) of an SRDF.

    Raises ``Unavailable`` (``robot-data-unreadable``).
    """

    def read() -> None:
        pin.loadRotorParameters(model, str(srdf), False)
        pin.loadReferenceConfigurations(model, str(srdf), False)

    _read(srdf, read)
    model.armature = model.rotorInertia * model.rotorGearRatio**2


def collision_geometry(model: pin.Model, urdf: Path, package_dirs: Sequence[Path]) -> pin.GeometryModel:
    """The collision geometries of the full model, without pairs.

    Raises ``Unavailable`` (``robot-data-unreadable``).
    """
    return _geometry(model, urdf, package_dirs, pin.GeometryType.COLLISION)


def visual_geometry(model: pin.Model, urdf: Path, package_dirs: Sequence[Path]) -> pin.GeometryModel:
    """What the full model looks like.

    Raises ``Unavailable`` (``robot-data-unreadable``).
    """
    return _geometry(model, urdf, package_dirs, pin.GeometryType.VISUAL)


def full_configuration(robot: Robot, model: pin.Model) -> Float[np.ndarray, "nq_full"]:
    """The reference posture of ``robot`` in the coordinates of the full ``model``."""
    q = pin.neutral(model)
    q[:7] = robot.q_reference[:7]
    for joint, angle_rad in [*zip(robot.joint_names, robot.q_reference[7:], strict=True), *robot.locked.items()]:
        q[model.joints[model.getJointId(joint)].idx_q] = angle_rad
    return np.asarray(q)


def _geometry(model: pin.Model, urdf: Path, package_dirs: Sequence[Path], kind: pin.GeometryType) -> pin.GeometryModel:
    folders = [str(folder) for folder in package_dirs]
    return _read(urdf, lambda: pin.buildGeomFromUrdf(model, str(urdf), kind, package_dirs=folders))


def _read(path: Path, read: Callable[[], Any]) -> Any:
    try:
        return read()
    except (ValueError, RuntimeError) as error:  # what pinocchio raises for a broken or a missing file
        raise Unavailable("robot-data-unreadable", f"The robot description {path.name} cannot be read.") from error
