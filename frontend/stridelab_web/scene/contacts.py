"""Contacts of a scenario: every placement of an effector, over all phases in which it stays in its place.

Moving a contact moves it in all of these phases.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from stridelab.schemas.robots import RobotEffector
from stridelab.schemas.scenarios import BoxSurface, Scenario, ScenarioContact


@dataclass(frozen=True)
class PlacedContact:
    """One effector in one place from ``first_phase`` to ``last_phase``; numbered from 1 in order of touch-down."""

    number: int
    effector: str
    first_phase: int
    last_phase: int
    start_s: float
    end_s: float
    contact: ScenarioContact


def placed_contacts(scenario: Scenario) -> tuple[PlacedContact, ...]:
    """All contacts in the order of their start; those that start together in the order of the phase."""
    ends_s = np.cumsum([phase.duration_s for phase in scenario.phases])
    placed: list[PlacedContact] = []
    previous: dict[str, PlacedContact] = {}
    for k, phase in enumerate(scenario.phases):
        current: dict[str, PlacedContact] = {}
        for contact in phase.contacts:
            before = previous.get(contact.effector)
            start_s, end_s = float(ends_s[k] - phase.duration_s), float(ends_s[k])
            if before is not None and before.contact == contact:
                touch = PlacedContact(
                    before.number, contact.effector, before.first_phase, k, before.start_s, end_s, contact
                )
                placed[before.number - 1] = touch
            else:
                touch = PlacedContact(len(placed) + 1, contact.effector, k, k, start_s, end_s, contact)
                placed.append(touch)
            current[contact.effector] = touch
        previous = current
    return tuple(placed)


def rotation_matrix(wxyz: tuple[float, float, float, float]) -> np.ndarray:
    """Rotation matrix ``(3, 3)`` of a quaternion; the identity for a zero quaternion."""
    norm = float(np.linalg.norm(wxyz))
    if not np.isfinite(norm) or norm == 0:
        return np.eye(3)
    w, x, y, z = (value / norm for value in wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def box_rotation(box: BoxSurface) -> np.ndarray:
    """Rotation matrix of a box."""
    if box.orientation_wxyz is not None:
        return rotation_matrix(box.orientation_wxyz)
    half = (box.yaw_rad or 0.0) / 2
    return rotation_matrix((float(np.cos(half)), 0.0, 0.0, float(np.sin(half))))


def box_corners_m(box: BoxSurface) -> np.ndarray:
    """The eight corners ``(8, 3)`` of a box in the world."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    return np.asarray(box.center_m + (signs * np.array(box.size_m) / 2) @ box_rotation(box).T)


HalfSizes = Mapping[str, tuple[float, float]]
"""Half the edges of the contact patch, by effector; points are left out."""


def half_sizes(effectors: Iterable[RobotEffector]) -> HalfSizes:
    """The contact patches of a robot."""
    return {e.name: e.contact_half_size_m for e in effectors if e.contact_half_size_m is not None}


def contact_node(touch: PlacedContact) -> str:
    """Node of a contact in a scene."""
    return f"/contacts/{touch.number}"


Side = Literal["left", "right", "hand"]
"""Colour key of an effector."""


def effector_side(effector: str) -> Side:
    """Colour key of an effector."""
    return "hand" if "hand" in effector else "left" if effector.startswith("left") else "right"


def side_nodes(placed: Iterable[PlacedContact]) -> dict[Side, str]:
    """Node of all places of the effectors of one colour, by colour key, in the scene of a plan."""
    return {side: f"/contacts/{side}" for side in dict.fromkeys(effector_side(touch.effector) for touch in placed)}


def yaw_rad(touch: PlacedContact) -> float:
    """Direction of the contact's x axis, seen from above."""
    along = rotation_matrix(touch.contact.orientation_wxyz)[:, 0]
    return math.atan2(along[1], along[0])


def contact_facts(touch: PlacedContact, sizes: HalfSizes) -> dict[str, Any]:
    """JSON facts of a contact with which the page shows and moves it."""
    return {
        "number": touch.number,
        "node": contact_node(touch),
        "effector": touch.effector,
        "side": effector_side(touch.effector),
        "phases": [touch.first_phase, touch.last_phase],
        "start_s": touch.start_s,
        "end_s": touch.end_s,
        "position_m": list(touch.contact.position_m),
        "orientation_wxyz": list(touch.contact.orientation_wxyz),
        "yaw_deg": round(math.degrees(yaw_rad(touch)), 3),
        "surface": touch.effector in sizes,
    }


def move_contact(scenario: Scenario, touch: PlacedContact, position_m: Sequence[float]) -> Scenario:
    """``scenario`` with ``touch`` at another position, without the fields that the service adds."""
    change = {"position_m": tuple(float(x) for x in position_m)}
    body = {name: getattr(scenario, name) for name in Scenario.model_fields}
    phases = list(scenario.phases)
    for k in range(touch.first_phase, touch.last_phase + 1):
        contacts = [
            contact.model_copy(update=change) if contact.effector == touch.effector else contact
            for contact in phases[k].contacts
        ]
        phases[k] = phases[k].model_copy(update={"contacts": contacts})
    return Scenario(**{**body, "phases": phases})
