"""The stabiliser of the replay: it sees the robot a sample at a time and corrects what the joints are told.

Capture-point feedback through ankles and legs (``ankles``), legs that adapt to where the feet landed (``footing``) and
force control of the hands (``grip``). The centre of pressure that the whole-body motion planned is where the feedback
starts from.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact
from stridelab.conventions import GRAVITY_M_S2
from stridelab.robots.robot import Robot
from stridelab.wholebody.ankles import CapturePoint, Sole, ankle_torques_nm, ankles_of, pendulum_rate
from stridelab.wholebody.footing import Feet, Footing
from stridelab.wholebody.grip import Grip, Hands
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.posed import Posed
from stridelab.wholebody.schedule import swung_shares
from stridelab.wholebody.seen import Seen

Angles = Float[np.ndarray, "na"]
_LIGHT_N = 30.0
"""A sole that is planned to bear less than this gets at least so much of the feedback."""


@dataclass(frozen=True)
class Stabiliser:
    """Its three parts; ``ankle_stiffness`` scales the position control of the ankles, which would fight the first."""

    capture: CapturePoint = field(default_factory=CapturePoint)
    footing: Footing | None = field(default_factory=Footing)
    grip: Grip | None = field(default_factory=Grip)
    ankle_stiffness: float = 0.2


class Stabilising:
    """One run over one motion."""

    def __init__(self, stabiliser: Stabiliser, robot: Robot, motion: WholeBodyMotion) -> None:
        self._by, self._robot, self._motion = stabiliser, robot, motion
        self._ankles = ankles_of(robot)
        self._posed = Posed(robot, motion.sequence.effectors)
        self._share = swung_shares(motion.sequence, motion.time_s)
        kinds = {name: robot.effectors[name].kind for name in motion.sequence.effectors}
        self._soles = tuple(name for name, kind in kinds.items() if kind == "surface")
        self._hands = tuple(name for name, kind in kinds.items() if kind == "point")
        self._dt_s = 1.0 / motion.rate_hz
        self._feet = (
            None if stabiliser.footing is None else Feet(stabiliser.footing, self._posed, self._soles, self._dt_s)
        )
        self._grips = None if stabiliser.grip is None else Hands(stabiliser.grip, self._posed, self._dt_s)
        self._integral_m = np.zeros(2)

    def at(self, k: int, seen: Seen) -> tuple[Angles, Angles]:
        """Angles (rad) and torques (N m) to add at sample ``k``; after the last one the motion stands still."""
        motion, last = self._motion, len(self._motion.time_s) - 1
        i, n = min(k, last), motion.tau_nm.shape[1]
        contacts = motion.sequence.phases[motion.sequence.phase_at(float(motion.time_s[i]) + 1e-9)].contacts
        self._posed.at(motion.q[i])
        tau = self._balance(i, float(k < last), contacts, seen)
        angles = np.zeros(n)
        if self._feet is not None:
            angles = self._feet.angles_rad(seen, {name: float(self._share[name][i]) for name in self._soles}, n)
        if self._grips is not None:
            touching = {name: contacts[name] for name in self._hands if name in contacts}
            planned_n = {
                name: float(motion.forces_n[name][i].sum(axis=0) @ c.placement.rotation[:, 2])
                for name, c in touching.items()
            }
            pressed, pressing = self._grips.at(seen, touching, planned_n, n)
            angles, tau = angles + pressed, tau + pressing
        return angles, tau

    def _balance(self, i: int, moving: float, contacts: Mapping[str, Contact], seen: Seen) -> Angles:
        motion, capture = self._motion, self._by.capture
        tau = np.zeros(motion.tau_nm.shape[1])
        soles = {name: self._sole(name, c, i) for name, c in contacts.items() if name in self._ankles}
        if not soles:
            return tau
        ground_m = float(np.mean([sole.position_m[2] for sole in soles.values()]))
        w = pendulum_rate(float(seen.com_m[2]) - ground_m)
        error_m = seen.com_m - motion.com_reference_m[i]
        error_v = seen.com_v_m_s - moving * motion.com_v_reference_m_s[i]
        xi_m = (error_m + error_v / w)[:2]
        limit = capture.integral_m / max(capture.integral_gain, 1e-9)
        self._integral_m = np.clip(self._integral_m + w * self._dt_s * xi_m, -limit, limit)
        half = {name: self._ankles[name].half_size_m for name in soles}
        shifts, gained = capture.spread(capture.shift_m(xi_m, self._integral_m), soles, half)
        for name, sole in soles.items():
            ankle = self._ankles[name]
            load_n = max(sole.load_n + gained[name], _LIGHT_N)
            tau[list(ankle.joints)] += ankle_torques_nm(ankle, shifts[name], load_n)
            if gained[name]:
                tau[self._posed.limb[name]] += self._posed.torques_nm(name, np.array([0.0, 0.0, -gained[name]]))
        return tau

    def _sole(self, name: str, contact: Contact, i: int) -> Sole:
        """From the forces of the whole-body motion; a sole that has none is pressed in its middle."""
        R = contact.placement.rotation
        weight_n = self._robot.mass_kg * GRAVITY_M_S2
        forces = self._motion.forces_n.get(name)
        if forces is None:
            return Sole(contact.placement.position_m, R, weight_n / 2.0, np.zeros(2))
        f_n = forces[i] @ R[:, 2]
        load_n = float(f_n.sum())
        pressure_m = f_n @ self._motion.points_m[name][:, :2] / max(load_n, 1.0)
        return Sole(contact.placement.position_m, R, max(load_n, 1.0), pressure_m)
