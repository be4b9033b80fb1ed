"""Batched forward kinematics of a robot with revolute joints.

    R_i = R_parent R_i0 Rot(axis_i, q_i),   p_i = p_parent + R_parent p_i0

Pinocchio evaluates one configuration at a time; this NumPy version evaluates a whole walk in milliseconds, so that
studies over many seeds are cheap.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from numpy.random import Generator
from scipy.spatial.transform import Rotation

_MIN_FACTOR = 0.05
"""Minimum factor on the mass of a link."""


@dataclass(frozen=True, eq=False)
class LinkMasses:
    """Mass and lever (CoM in the link's frame) of every link; joint ``i`` of the model carries link ``i - 1``."""

    mass_kg: Float[np.ndarray, "links"]
    lever_m: Float[np.ndarray, "links 3"]

    def perturb(self, error: float, rng: Generator) -> "LinkMasses":
        """Masses and levers with a relative ``error`` (one sigma, section 2.5.1); the total mass is unchanged."""
        masses = self.mass_kg * np.maximum(1.0 + error * rng.standard_normal(len(self.mass_kg)), _MIN_FACTOR)
        levers = self.lever_m * (1.0 + error * rng.standard_normal(self.lever_m.shape))
        return LinkMasses(masses * self.mass_kg.sum() / masses.sum(), levers)


@dataclass(frozen=True, eq=False)
class LinkPoses:
    """Rotation and origin of every link in the world, per configuration."""

    rotation: Float[np.ndarray, "n links 3 3"]
    position_m: Float[np.ndarray, "n links 3"]

    def coms_m(self, masses: LinkMasses) -> Float[np.ndarray, "n links 3"]:
        """CoM of every link."""
        return np.asarray(self.position_m + np.einsum("nlij,lj->nli", self.rotation, masses.lever_m))


def link_masses(model: pin.Model) -> LinkMasses:
    """The model's own masses."""
    inertias = list(model.inertias)[1:]
    return LinkMasses(np.array([i.mass for i in inertias]), np.array([i.lever for i in inertias]))


def link_poses(model: pin.Model, q: Float[np.ndarray, "n nq"]) -> LinkPoses:
    """Poses over the configurations ``q`` of a free-flying base with hinges."""
    n, links = len(q), model.njoints - 1
    rotation, position = np.empty((n, links, 3, 3)), np.empty((n, links, 3))
    rotation[:, 0], position[:, 0] = Rotation.from_quat(q[:, 3:7]).as_matrix(), q[:, :3]
    for joint in range(2, model.njoints):
        parent, place = model.parents[joint] - 1, model.jointPlacements[joint]
        turn = Rotation.from_rotvec(q[:, [model.joints[joint].idx_q]] * _hinge_axis(model.joints[joint])).as_matrix()
        rotation[:, joint - 1] = rotation[:, parent] @ place.rotation @ turn
        position[:, joint - 1] = position[:, parent] + rotation[:, parent] @ place.translation
    return LinkPoses(rotation, position)


def _hinge_axis(joint: pin.JointModel) -> Float[np.ndarray, "3"]:
    """Axis of a hinge in the link that it moves."""
    data = joint.createData()
    joint.calc(data, np.zeros(joint.nq))
    return np.array(data.S).reshape(6)[3:]
