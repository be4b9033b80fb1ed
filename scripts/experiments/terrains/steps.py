"""Footsteps of a survey's scenario, one foot after the other, and the mirror image of a scenario."""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from stridelab.contacts.scenarios.parts import (
    Contacts,
    Scenario,
    Timing,
    Walker,
    contact,
    move_effector,
    phase,
    round_values,
    scenario,
)
from stridelab.conventions import Vector3

SIDE: Final = {"left_foot": 1.0, "right_foot": -1.0}
_OTHER_SIDE: Final = {"left": "right", "right": "left"}


@dataclass(frozen=True)
class Pose:
    """Place and heading of the middle between both feet, on ground that leans by ``pitch_rad`` (positive: uphill)."""

    x_m: float
    y_m: float
    yaw_rad: float = 0.0
    z_m: float = 0.0
    pitch_rad: float = 0.0

    def foot(self, name: str, half_m: float, offset_m: Vector3 | None = None) -> dict[str, Any]:
        """The contact of a foot ``half_m`` aside, moved by ``offset_m`` in the frame of the pose."""
        turn = Rotation.from_euler("zy", [self.yaw_rad, -self.pitch_rad])
        local = np.array([0.0, SIDE[name] * half_m, 0.0]) + (np.zeros(3) if offset_m is None else offset_m)
        x, y, z = (np.array([self.x_m, self.y_m, self.z_m]) + turn.apply(local)).tolist()
        return contact(name, (x, y, z), turn.as_quat(scalar_first=True).tolist())


@dataclass
class Steps:
    """Phases of a walk that grows step by step, from a stance on both feet."""

    walker: Walker
    timing: Timing
    standing: Contacts
    phases: list[dict[str, Any]] = field(default_factory=list)

    @staticmethod
    def from_pose(walker: Walker, timing: Timing, pose: Pose) -> "Steps":
        """Start with both feet side by side at ``pose``."""
        return Steps.from_contacts(walker, timing, *(pose.foot(name, walker.foot_y_m) for name in SIDE))

    @staticmethod
    def from_contacts(walker: Walker, timing: Timing, *contacts: dict[str, Any]) -> "Steps":
        """Start on given contacts."""
        standing = {one["effector"]: one for one in contacts}
        return Steps(walker, timing, standing, [phase(timing.ends_s, standing)])

    def move(self, target: dict[str, Any]) -> None:
        """Move one effector to the contact ``target``."""
        self.phases += move_effector(self.standing, target, self.timing)

    def move_foot(self, name: str, pose: Pose) -> None:
        """Move one foot to its place at ``pose``."""
        self.move(pose.foot(name, self.walker.foot_y_m))

    def as_scenario(self, name: str, description: str, terrain: list[dict[str, Any]]) -> Scenario:
        """The scenario; the last phase lasts as long as the first."""
        self.phases[-1]["duration_s"] = self.timing.ends_s
        return scenario(name, description, self.walker.robot, terrain, self.phases)


def turned_box(
    name: str, middle_of_top_m: Vector3, size_m: tuple[float, float, float], turn: Rotation, friction: float
) -> dict[str, Any]:
    """A box with the middle of its upper face at ``middle_of_top_m``."""
    center = np.asarray(middle_of_top_m) - turn.apply([0.0, 0.0, size_m[2] / 2])
    return {
        "name": name,
        "kind": "box",
        "center_m": round_values(center.tolist()),
        "size_m": round_values(size_m),
        "orientation_wxyz": [round(float(value), 9) + 0.0 for value in turn.as_quat(scalar_first=True)],
        "friction": friction,
    }


def wide_ground(half_m: float = 12.0) -> dict[str, Any]:
    """Level ground at z = 0 in all directions."""
    return {"name": "ground", "kind": "box", "center_m": [0.0, 0.0, -0.1], "size_m": [2 * half_m, 2 * half_m, 0.2]}


def mirrored(given: Scenario) -> Scenario:
    """The mirror image of a scenario in the plane y = 0: left and right change places."""
    return {
        **given,
        "terrain": [_mirrored_surface(surface) for surface in given["terrain"]],
        "phases": [
            {**one, "contacts": sorted(map(_mirrored_contact, one["contacts"]), key=lambda c: str(c["effector"]))}
            for one in given["phases"]
        ],
    }


def _mirrored_contact(given: dict[str, Any]) -> dict[str, Any]:
    side, _, rest = str(given["effector"]).partition("_")
    x, y, z = given["position_m"]
    more = {"orientation_wxyz": _mirrored_turn(given["orientation_wxyz"])} if "orientation_wxyz" in given else {}
    return {**given, "effector": f"{_OTHER_SIDE[side]}_{rest}", "position_m": [x, -y + 0.0, z], **more}


def _mirrored_surface(given: dict[str, Any]) -> dict[str, Any]:
    more: dict[str, Any] = {}
    for key in ("center_m", "from_m", "to_m"):
        if key in given:
            x, y, z = given[key]
            more[key] = [x, -y + 0.0, z]
    if "orientation_wxyz" in given:
        more["orientation_wxyz"] = _mirrored_turn(given["orientation_wxyz"])
    if "yaw_rad" in given:
        more["yaw_rad"] = -given["yaw_rad"] + 0.0
    return {**given, **more}


def _mirrored_turn(wxyz: list[float]) -> list[float]:
    w, x, y, z = wxyz
    return [w, -x + 0.0, y, -z + 0.0]
