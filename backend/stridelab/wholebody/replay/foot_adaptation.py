"""Foot adaptation: adapts the legs to the actual landing positions of the feet.

A foot lands some millimetres off its planned position, and on a stair of a different height also too early or too
late. A leg at its planned angles would then displace the base. Instead, the leg tracks the actual position of the foot
relative to the planned base:

    stance   p = T_base_planned^-1 (p_foot at landing)
    swing    p = T_base_measured^-1 (p_foot planned)          so that the foot lands at its planned world position

and the difference of p from the plan is mapped to the joints of the leg by its Jacobian. A sole that is loaded early
stays at its position; one that is not loaded in time moves down to search for the ground.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import length_of
from stridelab.wholebody.limb_kinematics import LimbKinematics
from stridelab.wholebody.replay.dcm_feedback import Shift
from stridelab.wholebody.replay.sensors import SensedState

_DAMPING = 1e-4
"""Damping (m^2) of the leg's Jacobian inverse, for straight knees."""
_DAMPED = _DAMPING * np.eye(6)


@dataclass(frozen=True)
class Footing:
    """``loaded_n``: force above which a sole has landed; its position is updated for ``settling_s`` after that.

    ``rate_m_s`` limits the rate of corrections, ``aside_m_s`` that of side steps; a sole without ground contact moves
    down at ``search_m_s`` by up to ``search_m``. Corrections are limited to ``most_m``. A swing may end early after its
    share ``may_land``.
    """

    loaded_n: float = 60.0
    settling_s: float = 0.06
    rate_m_s: float = 0.25
    aside_m_s: float = 1.0
    search_m_s: float = 0.10
    search_m: float = 0.025
    most_m: float = 0.25
    may_land: float = 0.6

    def scaled_by(self, size: float) -> "Footing":
        """For a robot of ``size`` times the lengths: times with its root, forces with its cube."""
        root = size**0.5
        return replace(
            self,
            loaded_n=size**3 * self.loaded_n,
            settling_s=root * self.settling_s,
            rate_m_s=root * self.rate_m_s,
            aside_m_s=root * self.aside_m_s,
            search_m_s=root * self.search_m_s,
            search_m=size * self.search_m,
            most_m=size * self.most_m,
        )


class FootAdaptation:
    """Corrections of all soles during one replay."""

    def __init__(self, footing: Footing, kinematics: LimbKinematics, soles: tuple[str, ...], dt_s: float) -> None:
        self._footing, self._kinematics, self._dt_s = footing, kinematics, dt_s
        self._offsets_m: dict[str, Vector3] = {name: np.zeros(3) for name in soles}
        self._landed: dict[str, Vector3] = {}
        self._since: dict[str, float] = {}
        self._sought_m: dict[str, float] = dict.fromkeys(soles, 0.0)
        self._error = np.zeros(6)

    def angles_rad(
        self,
        measured: SensedState,
        share: Mapping[str, float],
        beside: Mapping[str, Shift],
        body_m: Shift,
        n_joints: int,
    ) -> Float[np.ndarray, "na"]:
        """Corrections (rad) of the planned angles; ``share`` is the swing progress of each sole, 1 in contact.

        ``beside`` are the desired offsets of the soles from their planned positions, ``body_m`` that of the body.
        """
        angles, f = np.zeros(n_joints), self._footing
        self._beside, self._body_m = beside, np.array([*body_m, 0.0])
        for name, swung in share.items():
            step = self._desired_offset_m(name, swung, measured) - self._offsets_m[name]
            aside = bool(beside[name].any()) and name not in self._landed
            most_m = (f.aside_m_s if aside else f.rate_m_s) * self._dt_s
            length = length_of(step)
            self._offsets_m[name] = self._offsets_m[name] + step * min(1.0, most_m / max(length, 1e-12))
            J = self._kinematics.limb_jacobian(name)
            self._error[:3] = self._offsets_m[name]
            angles[self._kinematics.limb[name]] += J.T @ np.linalg.solve(J @ J.T + _DAMPED, self._error)
        return angles

    def _desired_offset_m(self, name: str, progress: float, measured: SensedState) -> Vector3:
        """Desired offset of the foot from the plan, relative to the planned base (world axes)."""
        f, planned_m = self._footing, self._kinematics.contact_placement(name).position_m
        target_m = planned_m + np.array([*self._beside[name], 0.0])
        loaded = length_of(measured.forces_n[name]) > f.loaded_n
        if progress < f.may_land:
            self._landed.pop(name, None)
            self._sought_m[name] = 0.0
        elif loaded and (name not in self._landed or self._since[name] < f.settling_s):
            self._since[name] = self._since[name] + self._dt_s if name in self._landed else 0.0
            self._landed[name] = measured.contacts[name].position_m
        if name in self._landed:
            return self._limited_offset_m(self._landed[name] - planned_m - self._body_m)
        if progress < 1.0:
            return self._limited_offset_m(self._kinematics.compensate_base_error(target_m, measured) - planned_m)
        self._sought_m[name] = min(f.search_m, self._sought_m[name] + f.search_m_s * self._dt_s)
        down_m = np.array([0.0, 0.0, self._sought_m[name]])
        return np.asarray(
            self._limited_offset_m(self._kinematics.compensate_base_error(target_m, measured) - planned_m) - down_m
        )

    def _limited_offset_m(self, off_m: Vector3) -> Vector3:
        length = length_of(off_m)
        return np.asarray(off_m * min(1.0, self._footing.most_m / max(length, 1e-12)))
