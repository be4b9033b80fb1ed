"""Hand force control: a hand presses on its rail as planned, stays where it landed, and comes back when it lost it.

The normal force asked for is the planned one, at least

    f_least = min(least_n, d m g / |((p - s) x n)_xy|) ,

which moves the centre of pressure by d at most, for the plan knows nothing of it: s is the middle of the soles. On a
wall, 0.85 m above them, that is much less than on a rail beside the hip. A hand that touches is given what this is more
than planned through the torques of the arm, ``J' f``. What is missing even so moves the hand's place, as the joints are
told it, into the surface or out of it,

    delta' = k (f_wanted - f) ,     |delta| <= delta_max ,      dq = J^+ (o - delta n) .

A rail that is not where it should be is found like that, straight along the normal, and where there is none the search
ends at ``delta_max`` without any force on the body. Along the surface, o keeps a hand that touches where it landed, and
brings one that does not to its place in the world, whatever the base is off, as swinging feet are brought to theirs.
Told to be where it has slid, a hand would slide on: a light one creeps up its wall, letting go and touching by turns.
So where it landed is where it first touched, until it has been off its surface for longer than it takes to come back.

A hand that has lost its rail must not hook itself under it. The force that the arm was planned to press with is taken
off it at once, or it would be pressed down beside the rail; and if it stays off, it is lifted while it is beside its
place, to come down anew.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact
from stridelab.conventions import Vector3
from stridelab.wholebody.limb_kinematics import Posed
from stridelab.wholebody.replay.sensors import Seen

_DAMPING = 1e-3
"""Of the arm's Jacobian, m^2: a straight elbow stays straight."""


@dataclass(frozen=True)
class Grip:
    """``pressure_m`` is d, ``gain_m_per_ns`` k, ``most_m`` delta_max; a free hand forgets delta within ``let_go_s``.

    From ``touching_n`` on a hand counts as touching; the torques follow by ``rate_n_s`` at most. Along the surface it
    follows by ``aside_m_s`` and up to ``most_aside_m``. One that has not touched for ``lost_s`` is lost; farther than
    ``beside_m`` beside its place it is lifted by ``lift_m``, with ``lift_m_s``.
    """

    least_n: float = 25.0
    pressure_m: float = 0.03
    gain_m_per_ns: float = 0.001
    most_m: float = 0.03
    let_go_s: float = 0.05
    touching_n: float = 3.0
    lost_s: float = 0.04
    rate_n_s: float = 200.0
    aside_m_s: float = 0.25
    most_aside_m: float = 0.10
    beside_m: float = 0.02
    lift_m: float = 0.05
    lift_m_s: float = 0.2

    def pressed_n(self, planned_n: float, hand: Contact, soles_m: Vector3, weight_n: float) -> float:
        """The normal force asked of a hand of a robot on soles around ``soles_m``."""
        arm_m = np.cross(hand.placement.position_m - soles_m, hand.placement.rotation[:, 2])[:2]
        most_n = self.pressure_m * weight_n / max(float(np.linalg.norm(arm_m)), 1e-9)
        return max(planned_n, min(self.least_n, most_n))


class Hands:
    """The corrections of all hands of one replay."""

    def __init__(self, grip: Grip, posed: Posed, hands: tuple[str, ...], dt_s: float) -> None:
        self._posed = posed
        self._hands = {name: _Hand(grip, dt_s) for name in hands}

    def at(
        self,
        seen: Seen,
        touching: Mapping[str, Contact],
        planned_n: Mapping[str, Vector3],
        wanted_n: Mapping[str, float],
        n_joints: int,
    ) -> tuple[Float[np.ndarray, "na"], Float[np.ndarray, "na"]]:
        """Angles (rad) and torques (N m) to add; planned forces and normal forces asked for are of hands that touch."""
        angles, tau = np.zeros(n_joints), np.zeros(n_joints)
        for name, hand in self._hands.items():
            planned_m = self._posed.contact(name).position_m
            home_m = self._posed.to_the_world(planned_m, seen) - planned_m
            if name in touching:
                here_m, force_n = seen.contacts[name].position_m, seen.forces_n[name]
                hand.hold(touching[name], here_m, home_m, force_n, planned_n[name], wanted_n[name])
            else:
                hand.swing(home_m)
            J, limb = self._posed.moved_by_limb(name)[:3], self._posed.limb[name]
            angles[limb] += J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(3), hand.moved_m)
            tau[limb] += J.T @ hand.added_n
        return angles, tau


class _Hand:
    """One hand: o, delta, and the force that it presses with beside the plan's."""

    def __init__(self, grip: Grip, dt_s: float) -> None:
        self._grip, self._dt_s = grip, dt_s
        self._aside_m, self._delta_m, self._normal = np.zeros(3), 0.0, np.zeros(3)
        self.added_n: Vector3 = np.zeros(3)
        self._landed_m: Vector3 | None = None
        self._without_s = np.inf

    @property
    def moved_m(self) -> Vector3:
        """``o - delta n``, world axes."""
        return np.asarray(self._aside_m - self._delta_m * self._normal)

    def hold(
        self, contact: Contact, here_m: Vector3, home_m: Vector3, force_n: Vector3, planned_n: Vector3, wanted_n: float
    ) -> None:
        """A sample in contact, by the plan; ``home_m`` brings the hand to its place whatever the base is off."""
        g, n = self._grip, contact.placement.rotation[:, 2]
        self._normal = n
        pressed_n = float(force_n @ n)
        beside_m = _along(here_m - contact.placement.position_m, n)
        touches = pressed_n > g.touching_n
        self._without_s = 0.0 if touches else self._without_s + self._dt_s
        lost = self._without_s > g.lost_s
        if lost:
            self._landed_m = None
        elif self._landed_m is None:
            self._landed_m = beside_m
        self._follow(
            _along(home_m, n) if self._landed_m is None else self._landed_m,
            -(wanted_n - float(planned_n @ n)) * n if touches else planned_n,
        )
        if lost and float(np.linalg.norm(beside_m)) > g.beside_m:
            rate_m_s = -g.lift_m_s
        elif lost and self._delta_m < 0.0:
            rate_m_s = g.lift_m_s
        else:
            rate_m_s = g.gain_m_per_ns * (wanted_n - pressed_n)
        self._delta_m = float(np.clip(self._delta_m + self._dt_s * rate_m_s, -g.lift_m, g.most_m))

    def swing(self, home_m: Vector3) -> None:
        """A sample in the air, by the plan."""
        self._landed_m, self._without_s = None, np.inf
        self._follow(home_m, np.zeros(3))
        self._delta_m *= 1.0 - min(1.0, self._dt_s / self._grip.let_go_s)

    def _follow(self, aside_m: Vector3, added_n: Vector3) -> None:
        g = self._grip
        self._aside_m = _towards(
            self._aside_m, _towards(np.zeros(3), aside_m, g.most_aside_m), g.aside_m_s * self._dt_s
        )
        self.added_n = _towards(self.added_n, added_n, g.rate_n_s * self._dt_s)


def _along(v: Vector3, n: Vector3) -> Vector3:
    """What of v lies in the surface with normal n."""
    return np.asarray(v - n * float(n @ v))


def _towards(here: Vector3, there: Vector3, most: float) -> Vector3:
    """A step from here to there, no longer than ``most``."""
    step = there - here
    return np.asarray(here + step * min(1.0, most / max(float(np.linalg.norm(step)), 1e-12)))
