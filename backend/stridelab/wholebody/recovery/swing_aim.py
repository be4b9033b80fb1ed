"""A swing that is re-aimed at every sample: quintics from the present state of its reference to the target."""

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.wholebody.recovery.step_choice import DROP_M, EDGE_SHARE, QUINTIC_PEAK, fall_time_s

SEARCH_M_S = 0.3
"""Speed downwards of a sole that has not met the ground in time."""
RISE_M_S2 = 15.0
MOST_M_S2 = 40.0
BEHIND_M = 0.03
"""Distance by which a sole may be behind its reference."""
TOUCH_DOWN_M_S = 0.1


def quintic_acceleration(p: float, v: float, a: float, end: float, v_end: float, T: float, t: float) -> float:
    """Acceleration at t of the quintic from ``(p, v, a)`` at 0 to ``(end, v_end, 0)`` at T."""
    d, dv, da = end - p - v * T - 0.5 * a * T * T, (v_end - v - a * T) * T, -a * T * T
    third = (10.0 * d - 4.0 * dv + 0.5 * da) / T**3
    fourth = (-15.0 * d + 7.0 * dv - da) / T**4
    fifth = (6.0 * d - 3.0 * dv + 0.5 * da) / T**5
    return a + t * (6.0 * third + t * (12.0 * fourth + t * 20.0 * fifth))


class AimedSwing:
    """Reference of one swinging sole: position, velocity and acceleration of its centre.

    ``clear_m`` is the height to pass over. The last 45 % of the swing, 0.08 to 0.2 s, come down. Where it comes down by
    more than ``DROP_M``, it is above its place before.
    """

    def __init__(self, position_m: Vector3, velocity_m_s: Vector3) -> None:
        self.position_m, self.velocity_m_s, self.acceleration_m_s2 = position_m.copy(), velocity_m_s.copy(), np.zeros(3)
        self.clear_m = float(position_m[2])
        self.landing = False
        self._elapsed_s = 0.0

    def advance(self, place_m: Float[np.ndarray, "2"], height_m: float, in_s: float, dt_s: float) -> None:
        """Advance by ``dt_s`` towards a landing at ``place_m`` in ``in_s``; after that, search for the ground."""
        self._elapsed_s += dt_s
        if in_s <= dt_s:
            self.velocity_m_s, self.acceleration_m_s2 = np.array([0.0, 0.0, -SEARCH_M_S]), np.zeros(3)
            self.position_m = self.position_m + self.velocity_m_s * dt_s
            return
        fall_s = min(max(0.45 * (in_s + self._elapsed_s), 0.08), 0.2)
        up, over_s = float(self.position_m[2]), 0.02
        drop_m = max(self.clear_m, up) - height_m
        if not self.landing and drop_m > DROP_M:
            fall_s = max(fall_s, float(fall_time_s(drop_m, 0.0)))
        if self.clear_m - height_m > DROP_M:
            over_s = EDGE_SHARE * fall_s
        self.landing = self.landing or fall_s >= in_s
        level_s = max(in_s - over_s, dt_s)
        ends = [(float(place_m[0]), 0.0, level_s), (float(place_m[1]), 0.0, level_s)]
        if self.landing:
            ends.append((height_m, -TOUCH_DOWN_M_S, in_s))
        else:
            rise_s, speed = max(in_s - fall_s, 2.0 * dt_s), float(self.velocity_m_s[2])
            within = up + RISE_M_S2 * rise_s**2 / QUINTIC_PEAK + 0.5 * rise_s * max(speed, 0.0)
            ends.append((max(min(self.clear_m, within), height_m + 0.015, up - 0.02), 0.0, rise_s))
        state = zip(self.position_m.tolist(), self.velocity_m_s.tolist(), self.acceleration_m_s2.tolist(), strict=True)
        a = [quintic_acceleration(*now, *end, min(dt_s, end[2])) for now, end in zip(state, ends, strict=True)]
        self.acceleration_m_s2 = np.clip(a, -MOST_M_S2, MOST_M_S2)
        self.position_m = self.position_m + self.velocity_m_s * dt_s + 0.5 * self.acceleration_m_s2 * dt_s**2
        self.velocity_m_s = self.velocity_m_s + self.acceleration_m_s2 * dt_s

    def follow(self, position_m: Vector3, velocity_m_s: Vector3) -> None:
        """Let the reference wait for a sole that is left behind by more than ``BEHIND_M``."""
        behind = position_m - self.position_m
        distance = float(np.linalg.norm(behind))
        if distance > BEHIND_M:
            self.position_m = self.position_m + behind * (1.0 - BEHIND_M / distance)
            self.velocity_m_s = self.velocity_m_s + 0.3 * (velocity_m_s - self.velocity_m_s)
