"""Hand force limits: the bound on a hand's normal force from the torque limits of the arm.

With the arm at rest in a posture q in contact (J the Jacobian of the contact point, g(q) the gravity torques, both for
the joints between trunk and hand), a force f on the hand needs the torques

    tau = g(q) - J^T f,        |tau_i| <= s tau_max,i - d_i

with s < 1, which reserves torque for motion, and the dry friction d_i of the joint. The largest lambda for which this
holds along every ray of the friction cone with normal component lambda bounds the normal force, for any tangential
force within friction. The postures are those of the robot standing over its soles in the first and the last phase of
each hand contact; the minimum is used.
"""

from collections.abc import Iterator, Mapping, MutableMapping
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.centroidal.free_variables import contact_spans
from stridelab.centroidal.point_forces import pyramid_rays
from stridelab.centroidal.problem import standing_com_m
from stridelab.centroidal.rest_to_rest import standing_height_m
from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.inverse_kinematics import stand
from stridelab.robots.robot import Robot
from stridelab.robots.usable_torques import usable_torques_nm

TORQUE_SHARE: Final = 0.9
"""Share of a joint's torque limit that is available to a static force."""
N_RAYS: Final = 8
MIN_BOUND_N: Final = 1.0
"""Lower bound of the computed limits."""
CONTACT_TOLERANCE_M: Final = 0.01
"""Distance from the contact up to which a posture counts as touching it."""


def max_normal_force_n(robot: Robot, q: Float[np.ndarray, "nq"], contact: Contact) -> float:
    """Largest normal force that the arm at rest in ``q`` carries at ``contact``; 0 where it cannot hold its weight."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    frame = frames[contact.effector]
    J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
    arm = [i for i in _chain_to_trunk(model, frame) if robot.group[model.names[i]] == "arm"]
    columns = [model.joints[i].idx_v for i in arm]
    gravity = pin.computeGeneralizedGravity(model, data, q)[columns]
    torque_limit = usable_torques_nm(TORQUE_SHARE * model.effortLimit[columns], model.friction[columns])
    friction_rays = pyramid_rays(contact.friction / np.cos(np.pi / N_RAYS), N_RAYS)  # a pyramid that contains the cone
    torque_per_n = -J[:, columns].T @ contact.placement.rotation @ friction_rays
    remaining_torque = torque_limit[:, None] - np.sign(torque_per_n) * gravity[:, None]
    with np.errstate(divide="ignore"):
        max_forces_n = np.where(np.abs(torque_per_n) > 0.0, remaining_torque / np.abs(torque_per_n), np.inf)
    return float(max(0.0, max_forces_n.min()))


def hand_bounds_n(
    robot: Robot, sequence: ContactSequence, known_n: MutableMapping[bytes, float] | None = None
) -> dict[str, float]:
    """Bounds for ``PathBounds.normal_force_max_n``; hands whose contacts no posture reaches have none.

    ``known_n`` are bounds of stances from earlier calls for this robot, infinite where no posture reaches; new ones are
    added.
    """
    known_n = {} if known_n is None else known_n
    bounds: dict[str, float] = {}
    for phase, name in _hand_contact_phases(robot, sequence):
        placements = {
            other: contact.placement
            for other in sequence.effectors
            if (contact := _contact_for_posture(robot, sequence, phase, other)) is not None
        }
        soles = {
            other: contact
            for other in sequence.effectors
            if robot.effectors[other].kind == "surface" and (contact := sequence.last_contact(other, phase)) is not None
        }
        if not soles:
            continue
        key = _stance_key(name, {**soles, **sequence.phases[phase].contacts})
        if key not in known_n:
            posture = stand(robot, placements, standing_com_m(soles, standing_height_m(robot), robot.effectors))
            reaches, contact = posture.error_m < CONTACT_TOLERANCE_M, sequence.phases[phase].contacts[name]
            known_n[key] = max(MIN_BOUND_N, max_normal_force_n(robot, posture.q, contact)) if reaches else np.inf
        if known_n[key] < np.inf:
            bounds[name] = min(known_n[key], bounds.get(name, np.inf))
    return bounds


def _stance_key(hand: str, contacts: Mapping[str, Contact]) -> bytes:
    """Equal for the same hand and placements."""
    parts = [hand.encode()]
    for name in sorted(contacts):
        place = contacts[name].placement
        parts += [name.encode(), np.r_[place.position_m, place.rotation.ravel(), contacts[name].friction].tobytes()]
    return b"".join(parts)


def _hand_contact_phases(robot: Robot, sequence: ContactSequence) -> Iterator[tuple[int, str]]:
    """First and last phase of every contact of a point effector."""
    for span in contact_spans(sequence):
        if robot.effectors[span.contact.effector].kind == "point":
            for phase in sorted({span.first, span.last}):
                yield phase, span.contact.effector


def _contact_for_posture(robot: Robot, sequence: ContactSequence, phase: int, effector: str) -> Contact | None:
    """A hand's contact in the phase, if any; a foot's current or latest one, where its swing begins."""
    if robot.effectors[effector].kind == "surface":
        return sequence.last_contact(effector, phase)
    return sequence.phases[phase].contacts.get(effector)


def _chain_to_trunk(model: pin.Model, frame: int) -> list[int]:
    """Joints on the chain from a frame up to the trunk."""
    joints, joint = [], model.frames[frame].parentJoint
    while joint > 1:
        joints.append(joint)
        joint = model.parents[joint]
    return joints
