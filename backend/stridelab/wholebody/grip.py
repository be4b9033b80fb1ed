"""Hand force control: a hand presses on its rail as planned, and never so lightly that it only touches.

The normal force asked for is the planned one, at least

    f_least = min(least_n, d m g / |((p - s) x n)_xy|) ,

which moves the centre of pressure by d at most, for the plan knows nothing of it: s is the middle of the soles. On a
wall, 0.85 m above them, that is much less than on a rail beside the hip. A hand that touches is given what this is more
than planned through the torques of the arm, ``J' f``. What is missing even so moves the hand's place, as the joints are
told it, into the surface or out of it,

    delta' = k (f_wanted - f) ,     |delta| <= delta_max ,      dq = J^+ (-delta n) .

A rail that is not where it should be is found like that, straight along the normal, and where there is none the search
ends at ``delta_max`` without any force on the body.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact
from stridelab.conventions import Vector3
from stridelab.wholebody.posed import Posed
from stridelab.wholebody.seen import Seen

_DAMPING = 1e-3
"""Of the arm's Jacobian, m^2: a straight elbow stays straight."""


@dataclass(frozen=True)
class Grip:
    """``pressure_m`` is d, ``gain_m_per_ns`` k; a hand that lets go forgets delta within ``let_go_s``.

    From ``touching_n`` on a hand counts as touching; the torques follow by ``rate_n_s`` at most.
    """

    least_n: float = 25.0
    pressure_m: float = 0.03
    gain_m_per_ns: float = 0.001
    most_m: float = 0.03
    let_go_s: float = 0.05
    touching_n: float = 3.0
    rate_n_s: float = 200.0

    def pressed_n(self, planned_n: float, hand: Contact, soles_m: Vector3, weight_n: float) -> float:
        """The normal force asked of a hand of a robot on soles around ``soles_m``."""
        arm_m = np.cross(hand.placement.position_m - soles_m, hand.placement.rotation[:, 2])[:2]
        most_n = self.pressure_m * weight_n / max(float(np.linalg.norm(arm_m)), 1e-9)
        return max(planned_n, min(self.least_n, most_n))


class Hands:
    """The corrections of all hands of one replay."""

    def __init__(self, grip: Grip, posed: Posed, dt_s: float) -> None:
        self._grip, self._posed, self._dt_s = grip, posed, dt_s
        self._pressed_m: dict[str, Vector3] = {}
        self._added_n: dict[str, Vector3] = {}

    def at(
        self,
        seen: Seen,
        touching: Mapping[str, Contact],
        planned_n: Mapping[str, float],
        wanted_n: Mapping[str, float],
        n_joints: int,
    ) -> tuple[Float[np.ndarray, "na"], Float[np.ndarray, "na"]]:
        """Angles (rad) and torques (N m) to add; the normal forces, planned and asked for, are of hands that touch."""
        angles, tau, g = np.zeros(n_joints), np.zeros(n_joints), self._grip
        for name in {**self._pressed_m, **touching}:
            pressed_m, more_n = self._pressed_m.get(name, np.zeros(3)), np.zeros(3)
            if name in touching:
                normal = touching[name].placement.rotation[:, 2]
                here_n = float(seen.forces_n[name] @ normal)
                delta_m = float(-pressed_m @ normal) + g.gain_m_per_ns * self._dt_s * (wanted_n[name] - here_n)
                pressed_m = -float(np.clip(delta_m, -g.most_m, g.most_m)) * normal
                if here_n > g.touching_n:
                    more_n = -(wanted_n[name] - planned_n[name]) * normal
            else:
                pressed_m = pressed_m * (1.0 - min(1.0, self._dt_s / g.let_go_s))
            self._pressed_m[name] = pressed_m
            added_n = self._added_n.get(name, np.zeros(3))
            step_n = more_n - added_n
            most_n = g.rate_n_s * self._dt_s
            added_n = added_n + step_n * min(1.0, most_n / max(float(np.linalg.norm(step_n)), 1e-9))
            self._added_n[name] = added_n
            J, limb = self._posed.moved_by_limb(name)[:3], self._posed.limb[name]
            angles[limb] += J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(3), pressed_m)
            tau[limb] += J.T @ added_n
        return angles, tau
