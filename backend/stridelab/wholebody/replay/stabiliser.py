"""The stabiliser of the replay: corrects the joint commands at every sample from the measured state.

It consists of capture-point feedback through ankles and legs (``capture``), adaptation of the legs to the landing
positions of the feet (``footing``), force control of the hands (``grip``), and adaptation of the plan's timing and
steps when these are not sufficient (``stepping``). The feedback is relative to the centre of pressure of the
whole-body motion.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.conventions import GRAVITY_M_S2, Angles, Series, Vector3
from stridelab.robots.robot import Robot
from stridelab.wholebody.limb_kinematics import LimbKinematics
from stridelab.wholebody.motion import MotionArrival, WholeBodyMotion
from stridelab.wholebody.replay.capturability import Capturability
from stridelab.wholebody.replay.dcm_feedback import (
    CapturePointFeedback,
    Sole,
    ankle_torques_nm,
    ankles_of,
    pendulum_rate,
    size_share,
)
from stridelab.wholebody.replay.foot_adaptation import FootAdaptation, Footing
from stridelab.wholebody.replay.hand_force_control import Grip, HandForceControl
from stridelab.wholebody.replay.sensors import SensedState
from stridelab.wholebody.replay.step_adjustment import AdaptiveClock, Stepping

_AHEAD_S = 1.5
"""A motion that is still being computed is followed so far behind: all but a hundredth of a sole's reach is known."""


@dataclass(frozen=True)
class Stabiliser:
    """Settings; ``ankle_stiffness`` scales the position control of the ankles, which counteracts ``capture``.

    ``least_load_n`` is the lower bound of a sole's load in the ankle feedback.
    """

    capture: CapturePointFeedback = field(default_factory=CapturePointFeedback)
    footing: Footing | None = field(default_factory=Footing)
    grip: Grip | None = field(default_factory=Grip)
    stepping: Stepping = field(default_factory=Stepping)
    ankle_stiffness: float = 0.2
    least_load_n: float = 30.0

    def scaled_by(self, size: float) -> "Stabiliser":
        """For a robot of ``size`` times the lengths (``size_share``): forces with its cube."""
        return replace(
            self,
            capture=self.capture.scaled_by(size),
            footing=None if self.footing is None else self.footing.scaled_by(size),
            grip=None if self.grip is None else self.grip.scaled_by(size),
            stepping=self.stepping.scaled_by(size),
            least_load_n=size**3 * self.least_load_n,
        )


class StabiliserRun:
    """State of the stabiliser during one replay."""

    def __init__(self, stabiliser: Stabiliser, robot: Robot, motion: WholeBodyMotion) -> None:
        size = size_share(robot)
        stabiliser = stabiliser if size == 1.0 else stabiliser.scaled_by(size)
        self._settings, self._robot, self._motion = stabiliser, robot, motion
        self._ankles = ankles_of(robot)
        self._kinematics = LimbKinematics(robot, motion.sequence.effectors)
        self._share = swing_progress(motion.sequence, motion.time_s)
        kinds = {name: robot.effectors[name].kind for name in motion.sequence.effectors}
        self._soles = tuple(name for name, kind in kinds.items() if kind == "surface")
        self._hands = tuple(name for name, kind in kinds.items() if kind == "point")
        self._dt_s = 1.0 / motion.rate_hz
        self._feet = (
            None
            if stabiliser.footing is None
            else FootAdaptation(stabiliser.footing, self._kinematics, self._soles, self._dt_s)
        )
        self._grips = (
            None
            if stabiliser.grip is None
            else HandForceControl(stabiliser.grip, self._kinematics, self._hands, self._dt_s)
        )
        self._integral_m, self._body_off_m, self._missed_m = np.zeros(2), np.zeros(2), np.zeros(2)
        self._half_size_m = {name: ankle.half_size_m for name, ankle in self._ankles.items() if name in self._soles}
        self._ahead = round(_AHEAD_S * motion.rate_hz)
        complete = None if motion.arrival is None else self._complete_capturability
        self.pace = AdaptiveClock(stabiliser.stepping, self._capturability_from(0), motion.rate_hz, complete)

    def compute_corrections(self, measured: SensedState) -> tuple[Angles, Angles]:
        """Angles (rad) and torques (N m) to add at the sample of ``pace``; the last sample is a standing posture."""
        motion, i = self._motion, self.pace.sample_index
        n = motion.tau_nm.shape[1]
        contacts = motion.sequence.phases[motion.sequence.phase_at(float(motion.time_s[i]) + 1e-9)].contacts
        self._kinematics.set_configuration(motion.q[i])
        progress = {name: float(self._share[name][i]) for name in self._soles}
        tau = self._balance_torques_nm(i, contacts, progress, measured)
        angles = np.zeros(n)
        if self._feet is not None:
            angles = self._feet.angles_rad(measured, progress, self.pace.off_m, self._body_off_m, n)
        if self._grips is not None:
            hand_contacts = {name: contacts[name] for name in self._hands if name in contacts}
            planned_n = {name: motion.forces_n[name][i].sum(axis=0) for name in hand_contacts}
            reference_n = self._hand_references_n(contacts, planned_n)
            hand_angles, hand_tau = self._grips.compute_corrections(
                measured, hand_contacts, planned_n, reference_n, motion.tau_nm[i]
            )
            angles, tau = angles + hand_angles, tau + hand_tau
        return angles, tau

    def receive_motion(self, arrival: MotionArrival) -> None:
        """Wait for the part of the motion that the next sample needs."""
        ahead = self.pace.sample_index + self._ahead
        arrival.wait_for_samples(ahead)
        known = self.pace.margins.known
        if known < min(ahead, arrival.total):
            self.pace.margins = self._capturability_from(self.pace.sample_index)

    def _capturability_from(self, first: int) -> Capturability:
        """Capturability of the whole motion, or, while it is computed, of its samples from ``first`` on."""
        motion, inside_m = self._motion, self._settings.capture.edge_m
        known = None if motion.arrival is None else motion.arrival.arrived
        return Capturability.of_motion(motion, self._half_size_m, inside_m, first, known)

    def _complete_capturability(self) -> Capturability:
        """Capturability of the whole motion, after waiting for it."""
        if self._motion.arrival is not None:
            self._motion.arrival.wait_for_samples(self._motion.arrival.total)
        return self._capturability_from(0)

    def _hand_references_n(self, contacts: Mapping[str, Contact], planned_n: Mapping[str, Vector3]) -> dict[str, float]:
        """Normal force reference of every hand in contact; the planned one if no sole is in contact."""
        grip = self._settings.grip
        if not planned_n:
            return {}
        soles_m = [contacts[name].placement.position_m for name in self._soles if name in contacts]
        normal_n = {name: float(f @ contacts[name].placement.rotation[:, 2]) for name, f in planned_n.items()}
        if grip is None or not soles_m:
            return normal_n
        weight_n, middle_m = self._robot.mass_kg * GRAVITY_M_S2, np.mean(soles_m, axis=0)
        return {name: grip.force_reference_n(f, contacts[name], middle_m, weight_n) for name, f in normal_n.items()}

    def _balance_torques_nm(
        self, i: int, contacts: Mapping[str, Contact], progress: Mapping[str, float], measured: SensedState
    ) -> Angles:
        motion, capture, pace = self._motion, self._settings.capture, self.pace
        tau = np.zeros(motion.tau_nm.shape[1])
        soles = {name: self._planned_sole(name, c, i) for name, c in contacts.items() if name in self._ankles}
        if not soles:
            return tau
        ground_m = sum(float(sole.position_m[2]) for sole in soles.values()) / len(soles)
        w = pendulum_rate(float(measured.com_m[2]) - ground_m)
        ended = i == len(motion.time_s) - 1
        capture_m = measured.com_m[:2] + measured.com_v_m_s[:2] / w
        soles_m = {name: self._kinematics.contact_placement(name).position_m for name in progress}
        grip = self._settings.grip
        hand_shift_m = 0.0 if grip is None or not any(name in contacts for name in self._hands) else grip.pressure_m
        pace.update_rate(capture_m, soles_m, progress, hand_shift_m)
        margins = pace.margins
        # while the clock pauses, the reference is rest at the capture point, from which the plan can continue
        pause_share = 0.0 if ended else 1.0 - min(max(pace.rate, 0.0), 1.0)
        reference_m = motion.com_reference_m[i, :2] if ended else margins.capture_m[i]
        off_m = pace.reference_off_m
        body_m = off_m + pause_share * (reference_m - motion.com_reference_m[i, :2])
        self._body_off_m += w * self._dt_s * (body_m - self._body_off_m)
        xi_m = capture_m - reference_m - off_m
        pause_shift_m = pause_share * (margins.capture_m[i] - margins.pressure_m[i])
        limit = capture.integral_m / max(capture.integral_gain, 1e-9)
        added_m = w * self._dt_s * capture.integrable_m(xi_m, self._missed_m)
        self._integral_m = np.minimum(np.maximum(self._integral_m + added_m, -limit), limit)
        half = {name: self._ankles[name].half_size_m for name in soles}
        shifts, transferred, self._missed_m = capture.distribute_shift(
            capture.shift_m(xi_m, self._integral_m) + pause_shift_m, soles, half
        )
        for name, sole in soles.items():
            ankle = self._ankles[name]
            load_n = max(sole.load_n + transferred[name], self._settings.least_load_n)
            tau[list(ankle.joints)] += ankle_torques_nm(ankle, shifts[name], load_n)
            if transferred[name]:
                tau[self._kinematics.limb[name]] += self._kinematics.torques_nm(
                    name, np.array([0.0, 0.0, -transferred[name]])
                )
        return tau

    def _planned_sole(self, name: str, contact: Contact, i: int) -> Sole:
        """Sole state from the forces of the motion; without forces, half the weight at the centre."""
        R = contact.placement.rotation
        weight_n = self._robot.mass_kg * GRAVITY_M_S2
        forces = self._motion.forces_n.get(name)
        if forces is None:
            return Sole(contact.placement.position_m, R, weight_n / 2.0, np.zeros(2))
        f_n = forces[i] @ R[:, 2]
        load_n = float(f_n.sum())
        pressure_m = f_n @ self._motion.points_m[name][:, :2] / max(load_n, 1.0)
        return Sole(contact.placement.position_m, R, max(load_n, 1.0), pressure_m)


def swing_progress(sequence: ContactSequence, time_s: Series) -> dict[str, Series]:
    """Swing progress per effector and sample, from 0 at lift-off; 1 in contact."""
    shares = {name: np.ones(len(time_s)) for name in sequence.effectors}
    for name, share in shares.items():
        first: int | None = None
        for k, phase in enumerate(sequence.phases):
            if name in phase.contacts:
                first = None
                continue
            if first is None:
                first = k
                last = k
                while last + 1 < len(sequence.phases) and name not in sequence.phases[last + 1].contacts:
                    last += 1
                start, end = float(sequence.starts_s[first]), float(sequence.ends_s[last])
                inside = (time_s + 1e-9 >= start) & (time_s + 1e-9 < end)
                share[inside] = (time_s[inside] - start) / (end - start)
    return shares
