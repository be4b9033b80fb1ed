"""Checks of a card that a person corrected: numbers that no robot has, and contacts away from their links."""

import itertools
import math
from collections.abc import Iterator
from typing import Final

import numpy as np
import pinocchio as pin

from stridelab.conventions import Points
from stridelab.errors import Fault
from stridelab.robots.card import RobotCard, invalid_card
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.proposal.description import MAX_ROTOR_KG_M2, UNLIMITED
from stridelab.robots.proposal.limits import MAX_SPEED_RAD_S
from stridelab.robots.robot import Effector, Robot

MAX_TITLE: Final = 120
MAX_LICENCE: Final = 2_000
OUTSIDE_M: Final = 0.1
"""Distance from the box around the shapes of a link from which a contact does not belong to it."""
BESIDE_M: Final = 0.02
"""Width by which the rectangle of a sole may exceed that box."""
TILT_RAD: Final = math.radians(5.0)
ABOVE_M: Final = 0.01
"""Angle and height at which a sole does not stand on the ground in the reference posture."""


def check_corrected_card(card: RobotCard, robot: Robot) -> None:
    """Raises ``InvalidInput`` (``robot-card-invalid``) with one fault per field of ``card`` that is implausible."""
    faults = [*_text_faults(card), *_limit_faults(card), *_contact_faults(robot)]
    if faults := faults or list(_stance_faults(robot)):
        raise invalid_card(robot.name, faults)


def _text_faults(card: RobotCard) -> Iterator[Fault]:
    for field, text, most in (("title", card.title, MAX_TITLE), ("licence", card.licence, MAX_LICENCE)):
        if not text.strip() or len(text) > most:
            yield Fault(field, f"it must have 1 to {most} characters")


def _limit_faults(card: RobotCard) -> Iterator[Fault]:
    bounds = {
        "limits.torque_nm": (card.limits.torque_nm, UNLIMITED, "N m"),
        "limits.velocity_rad_s": (card.limits.velocity_rad_s, MAX_SPEED_RAD_S, "rad/s"),
        "rotors.armature_kg_m2": (card.rotors.armature_kg_m2, MAX_ROTOR_KG_M2, "kg m2"),
    }
    for where, (table, most, unit) in bounds.items():
        for pattern, value in table.items():
            if value >= most:
                yield Fault(f"{where}.{pattern}", f"{value:g} {unit} is not below {most:g} {unit}, which no robot has")


def _contact_faults(robot: Robot) -> Iterator[Fault]:
    for name, effector in robot.effectors.items():
        corners = _shape_corners(robot, effector)
        if not len(corners):
            corners = -(effector.T_frame_contact.rotation.T @ effector.T_frame_contact.position_m)[None]
        low, high = corners.min(axis=0), corners.max(axis=0)
        beside_m = float(np.linalg.norm(np.maximum(low, 0.0) + np.minimum(high, 0.0)))
        if beside_m > OUTSIDE_M:
            yield Fault(f"effectors.{name}.position_m", f"it lies {beside_m:.3g} m away from the shapes of its link")
        elif effector.contact_half_size_m is not None:
            half = np.array(effector.contact_half_size_m)
            over_m = float(np.max(np.maximum(low[:2] + half, half - high[:2])))
            if over_m > BESIDE_M:
                message = f"the rectangle exceeds the shapes of its link by {over_m:.3g} m"
                yield Fault(f"effectors.{name}.contact_half_size_m", message)


def _stance_faults(robot: Robot) -> Iterator[Fault]:
    """Two soles on one link, and soles that are tilted or above the ground in the reference posture."""
    model, index = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    soles = [name for name, effector in robot.effectors.items() if effector.kind == "surface"]
    for one, other in itertools.combinations(soles, 2):
        if model.frames[index[one]].parentJoint == model.frames[index[other]].parentJoint:
            yield Fault(f"effectors.{other}.frame", f"the same joint moves it as {one}")
    for name in soles:
        T = data.oMf[index[name]]
        tilt_rad, height_m = math.acos(min(T.rotation[2, 2], 1.0)), abs(float(T.translation[2]))
        if tilt_rad > TILT_RAD or height_m > ABOVE_M:
            place = f"tilted by {math.degrees(tilt_rad):.0f} deg and {1e3 * height_m:.0f} mm off the ground"
            yield Fault("reference.joints_rad", f"{name} is {place} in this posture")


def _shape_corners(robot: Robot, effector: Effector) -> Points:
    """Corners ``(8 n, 3)`` of the boxes around the shapes that move with the effector's link, in its contact frame."""
    frame = robot.model.frames[robot.model.getFrameId(effector.frame)]
    T_contact_joint = (
        frame.placement * pin.SE3(effector.T_frame_contact.rotation, effector.T_frame_contact.position_m)
    ).inverse()
    corners = [np.zeros((0, 3))]
    for part in robot.full_collision.geometryObjects:
        if part.parentJoint == frame.parentJoint:
            part.geometry.computeLocalAABB()
            box = part.geometry.aabb_local
            local = np.array(list(itertools.product(*zip(box.min_, box.max_, strict=True))))
            T = T_contact_joint * part.placement
            corners.append(local @ T.rotation.T + T.translation)
    return np.concatenate(corners)
