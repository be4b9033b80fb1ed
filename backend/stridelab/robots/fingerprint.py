"""What identifies a robot: a hash of all that makes a difference to a motion, and of nothing else."""

import hashlib
from pathlib import Path

import pinocchio as pin

from stridelab.robots.card import RobotCard
from stridelab.robots.data_files import DataFiles


def fingerprint(card: RobotCard, files: DataFiles, collision: pin.GeometryModel) -> str:
    """SHA-256 over the URDF, the SRDF where there is one, the meshes that can touch, and what the card says.

    Comments, layout, title and licence of the card do not enter, nor where the files lie.
    """
    total = hashlib.sha256()
    meshes = sorted({Path(part.meshPath) for part in collision.geometryObjects if part.meshPath not in _PRIMITIVES})
    for path in (files.urdf, files.srdf, *meshes):
        content = b"" if path is None else path.read_bytes()
        total.update(hashlib.sha256(content).digest())
    total.update(hashlib.sha256(card.canonical()).digest())
    return total.hexdigest()


_PRIMITIVES = {"", "BOX", "CYLINDER", "SPHERE", "CAPSULE"}
"""What pinocchio writes for the path of a shape that has no file."""
