"""Hand force control: a hand exerts its planned force, stays at its landing position and recovers lost contact.

The normal force reference is the planned force, but at least

    f_least = min(least_n, d m g / |((p - s) x n)_xy|, f_plan + min_i (c tau_max + sgn(J' n) tau_plan)_i / j_i) ,
    j = |J' n| + mu |J' - J' n n'| ,

which shifts the centre of pressure by at most d, as the plan does not model it; s is the mean position of the soles.
On a wall, 0.85 m above them, that is much less than on a rail beside the hip. What is added to the plan's force takes
a joint's torque, together with that of the plan and with the friction of the surface in the worst direction, to at
most the share c of its limit: where the forearm of TALOS points across its rail, 24 N took 3.4 of 3 N m, the arm gave
way, the hand slid off to the side, and was pressed on all the more. In contact the difference to the planned force is
added by the torques of the arm, ``J' f``. The remaining force error moves the commanded position of the hand into the
surface or out of it,

    delta' = k (f_reference - f) ,     |delta| <= delta_max ,      dq = W J' (J W J')^-1 (o - delta n) .

W holds the torque limits of the arm's joints, relative to their mean: with equal shares, the forearm's roll joint of
TALOS (3 N m) was asked for up to three times its limit. This locates a displaced rail along the normal; without a
surface the search ends at ``delta_max`` without a force on the body. Along the surface, o keeps a hand in contact at
its landing position, and moves one without contact to its planned world position despite errors of the base, as for
swinging feet. The landing position is that of the first
contact until contact is lost for longer than ``lost_s``: tracking the current position instead would let the hand slide
on, and a lightly loaded one creeps up its wall by repeatedly losing and regaining contact. The added force changes at
a limited rate, except that it ends at once where the planned force rises and takes its place, and where the plan
lifts the hand: 18 N that still pressed a wrist of TALOS onto its rail came on top of what lifting it takes.

A hand that has lost its rail must not hook under it. The planned force is removed immediately, as it would press the
hand down beside the rail; if contact is not regained, the hand is lifted while it is beside its position, and then
lowered again.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact
from stridelab.conventions import Vector3
from stridelab.wholebody.limb_kinematics import LimbKinematics
from stridelab.wholebody.replay.sensors import SensedState

_DAMPING = 1e-3
"""Damping (m^2) of the arm's Jacobian inverse, for straight elbows."""


@dataclass(frozen=True)
class Grip:
    """Settings: ``pressure_m`` is d, ``gain_m_per_ns`` k and ``most_m`` delta_max.

    Without contact delta decays within ``release_s``. ``touching_n``: force above which a hand is in contact;
    ``rate_n_s`` limits the rate of the added force. Along the surface, corrections are limited to ``aside_m_s`` and
    ``most_aside_m``. Contact is lost after ``lost_s`` without force; a hand farther than ``beside_m`` from its position
    is then lifted by up to ``lift_m`` at ``lift_m_s``. A hand that touches nothing moves towards its surface at
    ``search_m_s`` at least, however small its force reference. A force beyond the plan's takes no joint of the arm
    beyond ``torque_share`` of its torque limit.
    """

    least_n: float = 25.0
    pressure_m: float = 0.03
    gain_m_per_ns: float = 0.001
    most_m: float = 0.03
    release_s: float = 0.05
    touching_n: float = 3.0
    lost_s: float = 0.04
    rate_n_s: float = 200.0
    aside_m_s: float = 0.25
    most_aside_m: float = 0.10
    beside_m: float = 0.02
    lift_m: float = 0.05
    lift_m_s: float = 0.2
    search_m_s: float = 0.06
    torque_share: float = 0.5

    def scaled_by(self, size: float) -> "Grip":
        """For a robot of ``size`` times the lengths: times with its root, forces with its cube."""
        powers = {"least_n": 3.0, "touching_n": 3.0, "gain_m_per_ns": -2.5, "rate_n_s": 2.5}
        powers |= dict.fromkeys(("pressure_m", "most_m", "most_aside_m", "beside_m", "lift_m"), 1.0)
        powers |= dict.fromkeys(("release_s", "lost_s", "aside_m_s", "lift_m_s", "search_m_s"), 0.5)
        return replace(self, **{name: size**power * getattr(self, name) for name, power in powers.items()})

    def force_reference_n(self, planned_n: float, hand: Contact, soles_m: Vector3, weight_n: float) -> float:
        """Normal force reference (N) of a hand of a robot with soles around ``soles_m``."""
        arm_m = np.cross(hand.placement.position_m - soles_m, hand.placement.rotation[:, 2])[:2]
        most_n = self.pressure_m * weight_n / max(float(np.linalg.norm(arm_m)), 1e-9)
        return max(planned_n, min(self.least_n, most_n))

    def bounded_reference_n(
        self,
        reference_n: float,
        planned_n: float,
        planned_nm: Float[np.ndarray, "k"],
        lever_m: Float[np.ndarray, "k"],
        drag_m: Float[np.ndarray, "k"],
        limits_nm: Float[np.ndarray, "k"],
    ) -> float:
        """Reference (N) that takes no joint beyond ``torque_share`` of its limit, the planned force at least.

        ``planned_nm`` are the planned torques of the limb's joints, ``lever_m`` what a newton of the normal force takes
        from them, and ``drag_m`` the most that its friction takes.
        """
        left_nm = np.maximum(0.0, self.torque_share * limits_nm + np.sign(lever_m) * planned_nm)
        arm_n = float((left_nm / np.maximum(np.abs(lever_m) + drag_m, 1e-9)).min())
        return max(planned_n, min(reference_n, planned_n + arm_n))


class HandForceControl:
    """Corrections of all hands during one replay."""

    def __init__(self, grip: Grip, kinematics: LimbKinematics, hands: tuple[str, ...], dt_s: float) -> None:
        self._grip, self._kinematics = grip, kinematics
        self._hands = {name: _Hand(grip, dt_s) for name in hands}
        self._strengths = {name: kinematics.strengths(name) for name in hands}

    def compute_corrections(
        self,
        measured: SensedState,
        contacts: Mapping[str, Contact],
        planned_n: Mapping[str, Vector3],
        reference_n: Mapping[str, float],
        planned_nm: Float[np.ndarray, "na"],
    ) -> tuple[Float[np.ndarray, "na"], Float[np.ndarray, "na"]]:
        """Angles (rad) and torques (N m) to add; planned forces and force references are of hands in contact.

        ``planned_nm`` are the planned torques of all joints.
        """
        angles, tau = np.zeros((2, len(planned_nm)))
        for name, hand in self._hands.items():
            J, limb, w = self._kinematics.limb_jacobian(name)[:3], self._kinematics.limb[name], self._strengths[name]
            planned_m = self._kinematics.contact_placement(name).position_m
            home_m = self._kinematics.compensate_base_error(planned_m, measured) - planned_m
            if name in contacts:
                here_m, force_n = measured.contacts[name].position_m, measured.forces_n[name]
                n, limits_nm = contacts[name].placement.rotation[:, 2], self._kinematics.torque_limits_nm(name)
                planned = float(planned_n[name] @ n)
                drag_m = contacts[name].friction * np.linalg.norm(J - np.outer(n, n @ J), axis=0)
                wanted_n = self._grip.bounded_reference_n(
                    reference_n[name], planned, planned_nm[limb], J.T @ n, drag_m, limits_nm
                )
                hand.update_in_contact(contacts[name], here_m, home_m, force_n, planned_n[name], wanted_n)
            else:
                hand.update_in_swing(home_m)
            angles[limb] += w * (J.T @ np.linalg.solve(J @ (w[:, None] * J.T) + _DAMPING * np.eye(3), hand.moved_m))
            tau[limb] += J.T @ hand.added_n
        return angles, tau


class _Hand:
    """State of one hand: o, delta, and the force added to the plan's."""

    def __init__(self, grip: Grip, dt_s: float) -> None:
        self._grip, self._dt_s = grip, dt_s
        self._aside_m, self._delta_m, self._normal = np.zeros(3), 0.0, np.zeros(3)
        self.added_n: Vector3 = np.zeros(3)
        self._landed_m: Vector3 | None = None
        self._no_contact_s = np.inf

    @property
    def moved_m(self) -> Vector3:
        """``o - delta n``, world axes."""
        return np.asarray(self._aside_m - self._delta_m * self._normal)

    def update_in_contact(
        self,
        contact: Contact,
        here_m: Vector3,
        home_m: Vector3,
        force_n: Vector3,
        planned_n: Vector3,
        reference_n: float,
    ) -> None:
        """Sample of a planned contact; ``home_m`` moves the hand to its planned world position."""
        g, n = self._grip, contact.placement.rotation[:, 2]
        self._normal = n
        pressed_n = float(force_n @ n)
        beside_m = _tangential_component(here_m - contact.placement.position_m, n)
        in_contact = pressed_n > g.touching_n
        self._no_contact_s = 0.0 if in_contact else self._no_contact_s + self._dt_s
        lost = self._no_contact_s > g.lost_s
        if lost:
            self._landed_m = None
        elif self._landed_m is None:
            self._landed_m = beside_m
        missing_n = -(reference_n - float(planned_n @ n)) * n
        if in_contact and float(self.added_n @ n) < float(missing_n @ n):
            self.added_n = missing_n
        self._approach_targets(
            _tangential_component(home_m, n) if self._landed_m is None else self._landed_m,
            missing_n if in_contact else planned_n,
        )
        if lost and float(np.linalg.norm(beside_m)) > g.beside_m:
            rate_m_s = -g.lift_m_s
        elif lost and self._delta_m < 0.0:
            rate_m_s = g.lift_m_s
        else:
            rate_m_s = g.gain_m_per_ns * (reference_n - pressed_n)
            if not in_contact:
                rate_m_s = max(rate_m_s, g.search_m_s)
        self._delta_m = float(np.clip(self._delta_m + self._dt_s * rate_m_s, -g.lift_m, g.most_m))

    def update_in_swing(self, home_m: Vector3) -> None:
        """Sample of a planned swing."""
        self._landed_m, self._no_contact_s = None, np.inf
        self.added_n = np.zeros(3)
        self._move_aside(home_m)
        self._delta_m *= 1.0 - min(1.0, self._dt_s / self._grip.release_s)

    def _approach_targets(self, aside_m: Vector3, added_n: Vector3) -> None:
        self._move_aside(aside_m)
        self.added_n = _limited_step(self.added_n, added_n, self._grip.rate_n_s * self._dt_s)

    def _move_aside(self, aside_m: Vector3) -> None:
        g = self._grip
        self._aside_m = _limited_step(
            self._aside_m, _limited_step(np.zeros(3), aside_m, g.most_aside_m), g.aside_m_s * self._dt_s
        )


def _tangential_component(v: Vector3, n: Vector3) -> Vector3:
    """Component of v tangential to the surface with normal n."""
    return np.asarray(v - n * float(n @ v))


def _limited_step(here: Vector3, there: Vector3, most: float) -> Vector3:
    """Step from ``here`` towards ``there``, at most ``most`` long."""
    step = there - here
    return np.asarray(here + step * min(1.0, most / max(float(np.linalg.norm(step)), 1e-12)))
