"""What an arm can carry: the bound on a hand's normal force, from the limits of its torques.

With the arm at rest in a posture q that touches (J the Jacobian of the contact point, g(q) the torques that hold the
arm against gravity, both for the joints between trunk and hand), a force f on the hand takes

    tau = g(q) - J^T f,        |tau_i| <= s tau_max,i

with s < 1, the rest being for motion. The largest lambda for which this holds along every ray of the friction cone with
normal component lambda bounds the normal force, whatever tangential force friction allows with it. The postures are
those of the robot standing over its soles in every phase that the hand begins or ends to touch in; the least counts.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.centroidal.free_variables import stays
from stridelab.centroidal.point_forces import rays
from stridelab.centroidal.problem import standing_com_m
from stridelab.centroidal.rest_to_rest import standing_height_m
from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.inverse_kinematics import stand
from stridelab.robots.robot import Robot

TORQUE_SHARE: Final = 0.9
"""Of a joint's torque that a force at rest may take."""
N_RAYS: Final = 8
LEAST_N: Final = 1.0
"""An arm that bears less is given this."""
NEAR_M: Final = 0.01
"""An arm that stays so far away from its contact is taken to touch all the same."""


def carried_n(robot: Robot, q: Float[np.ndarray, "nq"], contact: Contact) -> float:
    """The largest normal force that the arm at rest in ``q`` carries at ``contact``, 0 where it cannot hold itself."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    frame = frames[contact.effector]
    J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
    arm = [i for i in _above(model, frame) if robot.group[model.names[i]] == "arm"]
    columns = [model.joints[i].idx_v for i in arm]
    gravity = pin.computeGeneralizedGravity(model, data, q)[columns]
    most = TORQUE_SHARE * model.effortLimit[columns]
    around = rays(contact.friction / np.cos(np.pi / N_RAYS), N_RAYS)  # a pyramid that holds the cone
    pull = -J[:, columns].T @ contact.placement.rotation @ around
    room = most[:, None] - np.sign(pull) * gravity[:, None]
    with np.errstate(divide="ignore"):
        bears = np.where(np.abs(pull) > 0.0, room / np.abs(pull), np.inf)
    return float(max(0.0, bears.min()))


def hand_bounds_n(robot: Robot, sequence: ContactSequence) -> dict[str, float]:
    """Bounds for ``PathBounds.normal_force_max_n``; of a hand that no posture brings to its contact there is none."""
    bounds: dict[str, float] = {}
    for phase, name in _touches(robot, sequence):
        placements = {
            other: contact.placement
            for other in sequence.effectors
            if (contact := _there(robot, sequence, phase, other)) is not None
        }
        soles = {
            other: contact
            for other in sequence.effectors
            if robot.effectors[other].kind == "surface" and (contact := sequence.last_contact(other, phase)) is not None
        }
        if not soles:
            continue
        found = stand(robot, placements, standing_com_m(soles, standing_height_m(robot), robot.effectors))
        if found.error_m < NEAR_M:
            bears = max(LEAST_N, carried_n(robot, found.q, sequence.phases[phase].contacts[name]))
            bounds[name] = min(bears, bounds.get(name, np.inf))
    return bounds


def _touches(robot: Robot, sequence: ContactSequence) -> Iterator[tuple[int, str]]:
    """First and last phases of every contact of a point effector."""
    for stay in stays(sequence):
        if robot.effectors[stay.contact.effector].kind == "point":
            for phase in sorted({stay.first, stay.last}):
                yield phase, stay.contact.effector


def _there(robot: Robot, sequence: ContactSequence, phase: int, effector: str) -> Contact | None:
    """Hands where they touch; feet where they are or were last, which is where a leg in swing begins."""
    if robot.effectors[effector].kind == "surface":
        return sequence.last_contact(effector, phase)
    return sequence.phases[phase].contacts.get(effector)


def _above(model: pin.Model, frame: int) -> list[int]:
    """Joints from the trunk to a frame."""
    found, joint = [], model.frames[frame].parentJoint
    while joint > 1:
        found.append(joint)
        joint = model.parents[joint]
    return found
