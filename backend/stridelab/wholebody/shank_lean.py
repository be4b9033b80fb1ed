"""How far the shank of a standing leg may lean ahead before it comes near the terrain, such as the next riser.

A shank turns about the pitch axis of its ankle, at a fixed place above the sole. The distance of its shapes from the
boxes that do not carry the sole is measured for single leans, from upright to the end of the ankle's range.
"""

from functools import lru_cache
from typing import Final

import coal
import numpy as np
import pinocchio as pin

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.contacts.terrain import Box
from stridelab.conventions import Vector3
from stridelab.robots.contact_frames import to_se3
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.clearance import LEG_CLEARANCE_M
from stridelab.wholebody.effector_contact import OwnSurfaces, terrain_shape

RISER_GAP_M: Final = LEG_CLEARANCE_M + 0.005
"""Distance from the terrain that a plan leaves to the shank; the whole body deviates from the estimate by as much."""
STEPS_OF_BISECTION: Final = 10
_Y: Final = np.array([0.0, 1.0, 0.0])


class ShankLean:
    """Leans of the shanks of one robot on the terrain of one sequence."""

    def __init__(self, robot: Robot, sequence: ContactSequence) -> None:
        self._robot, self._own = robot, OwnSurfaces(sequence, robot.effectors)
        self._leans_rad: dict[tuple[str, bytes], float] = {}
        self._boxes = [(box.name, *terrain_shape(box)) for box in sequence.terrain.surfaces if isinstance(box, Box)]

    def largest_lean_rad(self, name: str, contact: Contact, phase: int, ankle_m: Vector3, most_rad: float) -> float:
        """Largest lean (rad) ahead of the sole's normal with ``RISER_GAP_M`` to the terrain, at most ``most_rad``.

        ``name`` stands on ``contact`` in ``phase``, its ankle at ``ankle_m`` in the contact frame. Where even an
        upright shank is nearer, ``most_rad``: its lean is not what has to change.
        """
        place = contact.placement
        key = name, np.vstack([place.position_m, place.rotation]).tobytes()
        if key not in self._leans_rad:
            self._leans_rad[key] = self._find_lean_rad(name, contact, phase, ankle_m, most_rad)
        return self._leans_rad[key]

    def _find_lean_rad(self, name: str, contact: Contact, phase: int, ankle_m: Vector3, most_rad: float) -> float:
        """The lean of ``largest_lean_rad`` by bisection."""
        boxes = [one for one in self._boxes if one[0] not in self._own.contact_surfaces(name, phase)]
        shapes, lean_rad = _shank_shapes(self._robot, name)
        world = to_se3(contact.placement)

        def is_clear(lean: float) -> bool:
            R = pin.exp3((lean - lean_rad) * _Y)
            at = world * pin.SE3(R, ankle_m - R @ ankle_m)
            return all(_is_clear(at * place, shape, box_at, box) for place, shape in shapes for _, box_at, box in boxes)

        low, high = 0.0, most_rad
        if is_clear(high) or not is_clear(low):
            return most_rad
        for _ in range(STEPS_OF_BISECTION):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if is_clear(middle) else (low, middle)
        return low


@lru_cache(maxsize=16)
def _shank_shapes(robot: Robot, name: str) -> tuple[list[tuple[pin.SE3, coal.CollisionGeometry]], float]:
    """The shapes of a shank in the contact frame of its sole in the reference posture, and its lean (rad) there."""
    model = robot.model
    data, effector = model.createData(), robot.effectors[name]
    frame = model.frames[model.getFrameId(effector.frame)]
    knee, ankle = list(model.supports[frame.parentJoint])[-3:-1]
    pin.forwardKinematics(model, data, robot.q_reference)
    contact = data.oMi[frame.parentJoint] * frame.placement * to_se3(effector.T_frame_contact)
    relative = contact.inverse() * data.oMi[knee]
    parts = [part for part in robot.full_collision.geometryObjects if part.parentJoint == knee]
    x, _, z = relative.translation - contact.inverse().act(data.oMi[ankle].translation)
    return [(relative * part.placement, part.geometry) for part in parts], float(np.arctan2(x, z))


def _is_clear(at: pin.SE3, shape: coal.CollisionGeometry, box_at: pin.SE3, box: coal.CollisionGeometry) -> bool:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    places = [coal.Transform3s(one.rotation, one.translation) for one in (at, box_at)]
    return float(coal.distance(shape, places[0], box, places[1], request, result)) >= RISER_GAP_M
