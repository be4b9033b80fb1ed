"""Legs that stand where the feet are, not where they should be.

A foot lands some millimetres off its place, and on a stair that is higher or lower than planned also too early or too
late. A leg held at its planned angles would then push the base off its way. Instead the leg is asked for the pose of
the foot as it really is, seen from the base as it should be:

    stance   p = T_base_planned^-1 (p_foot where it landed)
    swing    p = T_base_seen^-1 (p_foot planned)              so that the foot lands in its place in the world

and what p differs from the plan goes into the joints of the leg by its Jacobian. A sole that is loaded before its time
stays where it is; one that is not when its time has come goes down in search of the ground.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.wholebody.limb_kinematics import Posed
from stridelab.wholebody.replay.dcm_feedback import Shift
from stridelab.wholebody.replay.sensors import Seen

_DAMPING = 1e-4
"""Of the leg's Jacobian, (m)^2: what a straight knee cannot do is not asked of it."""


@dataclass(frozen=True)
class Footing:
    """``loaded_n`` is the force from which a sole counts as landed, ``settling_s`` how long its place is still watched.

    ``rate_m_s`` limits how fast a leg gives way, ``aside_m_s`` how fast one steps aside; a sole that
    finds no ground goes down by ``search_m_s`` as far as ``search_m``. No correction is larger than ``most_m``. A swing
    may end early from its share ``may_land`` on.
    """

    loaded_n: float = 60.0
    settling_s: float = 0.06
    rate_m_s: float = 0.25
    aside_m_s: float = 1.0
    search_m_s: float = 0.10
    search_m: float = 0.025
    most_m: float = 0.25
    may_land: float = 0.6


class Feet:
    """The corrections of all soles of one replay."""

    def __init__(self, footing: Footing, posed: Posed, soles: tuple[str, ...], dt_s: float) -> None:
        self._footing, self._posed, self._dt_s = footing, posed, dt_s
        self._off: dict[str, Vector3] = {name: np.zeros(3) for name in soles}
        self._landed: dict[str, Vector3] = {}
        self._since: dict[str, float] = {}
        self._sought_m: dict[str, float] = dict.fromkeys(soles, 0.0)

    def angles_rad(
        self, seen: Seen, share: Mapping[str, float], beside: Mapping[str, Shift], body_m: Shift, n_joints: int
    ) -> Float[np.ndarray, "na"]:
        """What to add to the planned angles; ``share`` is how far each sole's swing has come, 1 where it stands.

        ``beside`` is by how much a sole shall land beside its place, ``body_m`` by how much the body shall be beside
        its own.
        """
        found, f = np.zeros(n_joints), self._footing
        self._beside, self._body_m = beside, np.array([*body_m, 0.0])
        for name, swung in share.items():
            step = self._wanted(name, swung, seen) - self._off[name]
            aside = bool(beside[name].any()) and name not in self._landed
            most_m = (f.aside_m_s if aside else f.rate_m_s) * self._dt_s
            length = float(np.linalg.norm(step))
            self._off[name] = self._off[name] + step * min(1.0, most_m / max(length, 1e-12))
            J = self._posed.moved_by_limb(name)
            e = np.concatenate([self._off[name], np.zeros(3)])
            found[self._posed.limb[name]] += J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), e)
        return found

    def _wanted(self, name: str, swung: float, seen: Seen) -> Vector3:
        """By how much the foot's place, seen from the planned base, shall differ from the plan (world axes)."""
        f, planned_m = self._footing, self._posed.contact(name).position_m
        aim_m = planned_m + np.array([*self._beside[name], 0.0])
        loaded = float(np.linalg.norm(seen.forces_n[name])) > f.loaded_n
        if swung < f.may_land:
            self._landed.pop(name, None)
            self._sought_m[name] = 0.0
        elif loaded and (name not in self._landed or self._since[name] < f.settling_s):
            self._since[name] = self._since[name] + self._dt_s if name in self._landed else 0.0
            self._landed[name] = seen.contacts[name].position_m
        if name in self._landed:
            return self._cut(self._landed[name] - planned_m - self._body_m)
        if swung < 1.0:
            return self._cut(self._posed.to_the_world(aim_m, seen) - planned_m)
        self._sought_m[name] = min(f.search_m, self._sought_m[name] + f.search_m_s * self._dt_s)
        down_m = np.array([0.0, 0.0, self._sought_m[name]])
        return np.asarray(self._cut(self._posed.to_the_world(aim_m, seen) - planned_m) - down_m)

    def _cut(self, off_m: Vector3) -> Vector3:
        length = float(np.linalg.norm(off_m))
        return np.asarray(off_m * min(1.0, self._footing.most_m / max(length, 1e-12)))
