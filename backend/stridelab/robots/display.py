"""What a viewer needs of a robot: one coloured mesh per moving joint, and where they are in a configuration.

The meshes are made from those of the installed data package whenever they are wanted; they are never kept in this
project.
"""

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.robots.description import full_configuration, full_model, visual_geometry
from stridelab.robots.gltf import glb
from stridelab.robots.meshes import LinkMesh, merged, mesh_of
from stridelab.robots.robot import Robot

__all__ = ["LinkMesh", "glb", "link_meshes", "link_names", "link_poses"]


def link_names(robot: Robot) -> tuple[str, ...]:
    """Name of the link that each joint moves, the base first: the order of meshes and poses."""
    return tuple(_link_of(robot.model, joint) for joint in range(1, robot.model.njoints))


def link_meshes(robot: Robot) -> tuple[LinkMesh, ...]:
    """One mesh per link of ``link_names``, decimated to a few millimetres; what is locked belongs to the link it is on.

    Raises ``Unavailable`` (``robot-data-unreadable``) where the description's meshes cannot be read.
    """
    full = full_model(robot.urdf)
    visual = visual_geometry(full, robot.urdf, robot.package_dirs)
    held = [full.getJointId(joint) for joint in robot.locked]
    _, visual = pin.buildReducedModel(full, visual, held, full_configuration(robot, full))
    shapes = [(shape.parentJoint, mesh_of(shape)) for shape in visual.geometryObjects]
    return tuple(
        merged(name, [mesh for parent, mesh in shapes if parent == joint])
        for joint, name in enumerate(link_names(robot), start=1)
    )


def link_poses(robot: Robot, q: Float[np.ndarray, "nq"]) -> Float[np.ndarray, "n_links 7"]:
    """Pose of every link of ``link_names`` in the world: px, py, pz (m), qw, qx, qy, qz (w >= 0)."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    poses = np.array([pin.SE3ToXYZQUAT(T_world_joint) for T_world_joint in list(data.oMi)[1:]])
    wxyz = poses[:, [6, 3, 4, 5]]
    return np.column_stack([poses[:, :3], np.where(wxyz[:, :1] < 0.0, -wxyz, wxyz)])


def _link_of(model: pin.Model, joint: int) -> str:
    """The body that the joint carries; those that are fixed to it come after it."""
    return next(str(f.name) for f in model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY)
