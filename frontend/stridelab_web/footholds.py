"""Moving a touch of a scenario: all phases in which the effector stays there move together."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

from stridelab.schemas.robots import RobotEffector
from stridelab.schemas.scenarios import Scenario
from stridelab_web.touches import Touch, rotation

HalfSizes = Mapping[str, tuple[float, float]]
"""Half the edges of the contact patch, by effector; a point has none."""


def half_sizes(effectors: Iterable[RobotEffector]) -> HalfSizes:
    """The contact patches of a robot."""
    return {e.name: e.contact_half_size_m for e in effectors if e.contact_half_size_m is not None}


def node(touch: Touch) -> str:
    """Node of a touch in a scene."""
    return f"/contacts/{touch.number}"


def side(effector: str) -> Literal["left", "right", "hand"]:
    """How an effector is coloured."""
    return "hand" if "hand" in effector else "left" if effector.startswith("left") else "right"


def yaw_rad(touch: Touch) -> float:
    """Direction of the contact's x axis, seen from above."""
    along = rotation(touch.contact.orientation_wxyz)[:, 0]
    return math.atan2(along[1], along[0])


def facts(touch: Touch, sizes: HalfSizes) -> dict[str, Any]:
    """What the page must know of a touch to show and to move it."""
    return {
        "number": touch.number,
        "node": node(touch),
        "effector": touch.effector,
        "side": side(touch.effector),
        "phases": [touch.first_phase, touch.last_phase],
        "start_s": touch.start_s,
        "end_s": touch.end_s,
        "position_m": list(touch.contact.position_m),
        "orientation_wxyz": list(touch.contact.orientation_wxyz),
        "yaw_deg": round(math.degrees(yaw_rad(touch)), 3),
        "surface": touch.effector in sizes,
    }


def moved(scenario: Scenario, touch: Touch, position_m: Sequence[float]) -> Scenario:
    """What is sent to store ``scenario`` with ``touch`` elsewhere: without the fields that the service added."""
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
