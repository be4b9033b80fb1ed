"""What an effector touches with, and which surfaces it may touch at what time.

A sole touches with its contact rectangle, a hand with a ball behind its contact point. An effector in contact stands on
the surface of its contact, and on boxes that are level with it. A sole or a hand that swings is close to the surface
that it leaves in the first eighth of the swing, and to the one that it nears in the last eighth.
"""

from collections.abc import Mapping
from typing import Final

import coal
import numpy as np
import pinocchio as pin

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.contacts.terrain import Box, Rail
from stridelab.robots.contact_frames import se3
from stridelab.robots.robot import Effector

HAND_RADIUS_M: Final = 0.02
"""Of the ball that stands for what a hand touches with; its surface passes through the contact point."""
SWING_SHARE: Final = 0.125
"""Share of a swing after lift-off and before touch-down in which an effector is close to its own surface."""
_LEVEL_M: Final = 5e-3
"""A box nearer than this to a contact's rectangle carries it, or lies level with the box that does."""
NOTHING: Final[frozenset[str]] = frozenset()


class OwnSurfaces:
    """The surfaces that the effectors of a sequence stand on or hold, leave or near."""

    def __init__(self, sequence: ContactSequence, effectors: Mapping[str, Effector]) -> None:
        self._sequence = sequence
        contacts = [contact for phase in sequence.phases for contact in phase.contacts.values()]
        self._carriers = {id(c): _carriers(sequence, c, effectors[c.effector]) for c in contacts}

    def touched(self, effector: str, phase: int) -> frozenset[str]:
        """Those that carry the effector's contact of ``phase``; none while it is in the air."""
        here = self._sequence.phases[phase].contacts.get(effector)
        return NOTHING if here is None else self._carriers[id(here)]

    def near(self, effector: str, phase: int, time_s: float) -> frozenset[str]:
        """Those that it leaves or nears at ``time_s``; none while it touches."""
        sequence = self._sequence
        if effector in sequence.phases[phase].contacts:
            return NOTHING
        before, after = sequence.last_contact(effector, phase), sequence.next_contact(effector, phase)
        first, last = phase, phase
        # without a contact before or after it the effector swings in the phase next to the other one only
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
        near = NOTHING
        if before is not None and share < SWING_SHARE:
            near |= self._carriers[id(before)]
        if after is not None and share > 1.0 - SWING_SHARE:
            near |= self._carriers[id(after)]
        return near

    def at(self, effector: str, phase: int, time_s: float) -> frozenset[str]:
        """All of them."""
        return self.touched(effector, phase) | self.near(effector, phase, time_s)


def terrain_shape(surface: Box | Rail) -> tuple[pin.SE3, coal.CollisionGeometry]:
    """Placement in the world and shape of a surface."""
    if isinstance(surface, Box):
        return se3(surface.placement), coal.Box(*(float(edge) for edge in surface.size_m))
    axis = surface.to_m - surface.from_m
    length = float((axis @ axis) ** 0.5)
    R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis / length).toRotationMatrix()
    return pin.SE3(R, 0.5 * (surface.from_m + surface.to_m)), coal.Capsule(surface.radius_m, length)


def _carriers(sequence: ContactSequence, contact: Contact, effector: Effector) -> frozenset[str]:
    """The surface of a contact and the boxes level with it, under the rectangle of a sole or the point of a hand."""
    x, y = effector.contact_half_size_m or (0.0, 0.0)
    rectangle, place = coal.Box(2.0 * x, 2.0 * y, 1e-4), _transform(se3(contact.placement))
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    near = {contact.surface}
    for box in sequence.terrain.boxes:
        at, shape = terrain_shape(box)
        result.clear()
        if coal.distance(rectangle, place, shape, _transform(at), request, result) < _LEVEL_M:
            near.add(box.name)
    return frozenset(near)


def _transform(placement: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(placement.rotation, placement.translation)
