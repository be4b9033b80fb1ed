"""Contact geometry of effectors, and the surfaces that an effector may touch at a given time.

The contact geometry is a rectangle for a sole and a sphere behind the contact point for a hand. An effector in contact
may touch the surface of its contact and boxes level with it. A swinging effector is near the surface that it leaves
during the first eighth of the swing, and near the one that it approaches during the last eighth.
"""

from collections.abc import Mapping
from typing import Final

import coal
import numpy as np
import pinocchio as pin

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.contacts.terrain import Box, Rail
from stridelab.robots.contact_frames import to_se3
from stridelab.robots.robot import Effector

SWING_SHARE: Final = 0.125
"""Share of a swing after lift-off and before touch-down in which an effector is near its own surface."""
_LEVEL_M: Final = 5e-3
"""Boxes within this distance of a contact's rectangle count as its surfaces."""
NO_SURFACES: Final[frozenset[str]] = frozenset()


class OwnSurfaces:
    """The surfaces that the effectors of a sequence are in contact with, leave or approach."""

    def __init__(self, sequence: ContactSequence, effectors: Mapping[str, Effector]) -> None:
        self._sequence = sequence
        contacts = [contact for phase in sequence.phases for contact in phase.contacts.values()]
        self._carriers = {id(c): _carrying_surfaces(sequence, c, effectors[c.effector]) for c in contacts}

    def contact_surfaces(self, effector: str, phase: int) -> frozenset[str]:
        """Surfaces of the effector's contact in ``phase``; empty in the air."""
        contact = self._sequence.phases[phase].contacts.get(effector)
        return NO_SURFACES if contact is None else self._carriers[id(contact)]

    def nearby_surfaces(self, effector: str, phase: int, time_s: float) -> frozenset[str]:
        """Surfaces that the effector leaves or approaches at ``time_s``; empty in contact."""
        sequence = self._sequence
        if effector in sequence.phases[phase].contacts:
            return NO_SURFACES
        before, after = sequence.last_contact(effector, phase), sequence.next_contact(effector, phase)
        first, last = phase, phase
        # without a previous or next contact the effector swings only in the phase adjacent to the other one
        while before is not None and effector not in sequence.phases[first - 1].contacts:
            first -= 1
        while after is not None and effector not in sequence.phases[last + 1].contacts:
            last += 1
        if before is None:
            first = last
        elif after is None:
            last = first
        start_s, end_s = float(sequence.starts_s[first]), float(sequence.ends_s[last])
        share = (time_s - start_s) / (end_s - start_s)
        near = NO_SURFACES
        if before is not None and share < SWING_SHARE:
            near |= self._carriers[id(before)]
        if after is not None and share > 1.0 - SWING_SHARE:
            near |= self._carriers[id(after)]
        return near


def terrain_shape(surface: Box | Rail) -> tuple[pin.SE3, coal.CollisionGeometry]:
    """Placement in the world and shape of a surface."""
    if isinstance(surface, Box):
        return to_se3(surface.placement), coal.Box(*(float(edge) for edge in surface.size_m))
    axis = surface.to_m - surface.from_m
    length = float((axis @ axis) ** 0.5)
    R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis / length).toRotationMatrix()
    return pin.SE3(R, 0.5 * (surface.from_m + surface.to_m)), coal.Capsule(surface.radius_m, length)


def _carrying_surfaces(sequence: ContactSequence, contact: Contact, effector: Effector) -> frozenset[str]:
    """The surface of a contact and the boxes level with it below the rectangle of a sole or the point of a hand."""
    x, y = effector.contact_half_size_m or (0.0, 0.0)
    rectangle, place = coal.Box(2.0 * x, 2.0 * y, 1e-4), _coal_transform(to_se3(contact.placement))
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    near = {contact.surface}
    for box in sequence.terrain.boxes:
        at, shape = terrain_shape(box)
        result.clear()
        if coal.distance(rectangle, place, shape, _coal_transform(at), request, result) < _LEVEL_M:
            near.add(box.name)
    return frozenset(near)


def _coal_transform(placement: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(placement.rotation, placement.translation)
