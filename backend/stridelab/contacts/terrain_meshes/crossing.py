"""The task of crossing a terrain: both feet beside each other at the start and at the goal."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.scenarios.course import StandingRobot
from stridelab.contacts.scenarios.parts import contact
from stridelab.contacts.terrain_meshes.planes import SHORTEST_EDGE_M, STEEPEST_RAD
from stridelab.contacts.terrain_meshes.surfaces import UpperFace, upper_faces
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, InvalidInput

Place = tuple[float, float]
SHORTEST_WAY_M: Final = 0.3
UP: Final = np.array([0.0, 0.0, 1.0])


def crossing_task(
    terrain: Sequence[Mapping[str, Any]], start_m: Place, goal_m: Place, effectors: Mapping[str, EffectorShape]
) -> dict[str, Any]:
    """Return ``{terrain, start, goal}`` for the contact planner; the feet stand on the highest surfaces at both places.

    The robot faces the goal. Raises ``InvalidInput``: ``crossing-too-short``, ``terrain-without-foothold`` naming the
    end and the foot, and ``course-without-feet``.
    """
    way = np.subtract(goal_m, start_m)
    if np.linalg.norm(way) < SHORTEST_WAY_M:
        text = f"start and goal are {np.linalg.norm(way):.2f} m apart; at least {SHORTEST_WAY_M:g} m are needed"
        raise InvalidInput("crossing-too-short", text[0].upper() + text[1:] + ".", [Fault("goal", text)])
    ahead = np.append(way / np.linalg.norm(way), 0.0)
    foot_y_m = StandingRobot.of_effectors(effectors, ()).foot_y_m
    boxes = [face for face in upper_faces([one for one in terrain if one["kind"] == "box"]) if _holds_foot(face)]
    ends = {}
    for end, (x, y) in (("start", start_m), ("goal", goal_m)):
        feet = []
        for side, sign in (("left", 1.0), ("right", -1.0)):
            at_m = np.array([x, y, 0.0]) + sign * foot_y_m * np.cross(UP, ahead)
            sole = _place_sole(boxes, at_m, ahead, f"{end}, {side} foot")
            x_m, y_m, z_m = sole.position_m
            feet.append(contact(f"{side}_foot", (float(x_m), float(y_m), float(z_m)), sole.wxyz))
        ends[end] = {"contacts": feet}
    return {"terrain": list(terrain), **ends}


def _holds_foot(face: UpperFace) -> bool:
    """Whether an upper face is as large and as level as a standing surface; those of obstacles may be neither."""
    R, _, half_m = face
    return bool(2.0 * half_m.min() >= SHORTEST_EDGE_M and R[2, 2] > np.cos(STEEPEST_RAD))


def _place_sole(boxes: Sequence[UpperFace], at_m: Vector3, ahead: Vector3, foot: str) -> Placement:
    """Placement of a sole on the highest upper face at a place."""
    highest: tuple[float, Vector3] | None = None
    for R, top_m, half_m in boxes:
        n = R[:, 2]
        z = top_m[2] - float((at_m - top_m)[:2] @ n[:2]) / n[2]
        local = R.T @ (np.array([at_m[0], at_m[1], z]) - top_m)
        if (np.abs(local[:2]) <= half_m).all() and (highest is None or z > highest[0]):
            highest = z, n
    if highest is None:
        text = f"there is no surface at ({at_m[0]:.2f}, {at_m[1]:.2f}) m"
        raise InvalidInput("terrain-without-foothold", f"{foot[0].upper()}{foot[1:]}: {text}.", [Fault(foot, text)])
    z, n = highest
    y = np.cross(n, ahead)
    y /= np.linalg.norm(y)
    return Placement(np.array([at_m[0], at_m[1], z]), np.column_stack([np.cross(y, n), y, n]))
