"""A swing that is re-aimed while it is under way: quintics from the present state to the target."""

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Vector3


SEARCH_M_S = 0.3
RISE_M_S2 = 15.0
MOST_M_S2 = 40.0
BEHIND_M = 0.03


def quintic_coefficients(p: float, v: float, a: float, p_1: float, v_1: float, T: float) -> Float[np.ndarray, "6"]:
    """Polynomial in t from ``(p, v, a)`` at 0 to ``(p_1, v_1, 0)`` at T, lowest power first."""
    d = p_1 - p - v * T - 0.5 * a * T * T
    dv = (v_1 - v - a * T) * T
    da = -a * T * T
    return np.array([
        p,
        v,
        a / 2.0,
        (10.0 * d - 4.0 * dv + 0.5 * da) / T**3,
        (-15.0 * d + 7.0 * dv - da) / T**4,
        (6.0 * d - 3.0 * dv + 0.5 * da) / T**5,
    ])


def evaluate(c: Float[np.ndarray, "6"], t: float) -> tuple[float, float, float]:
    """Value and two derivatives."""
    return (
        float(c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))))),
        float(c[1] + t * (2 * c[2] + t * (3 * c[3] + t * (4 * c[4] + t * 5 * c[5])))),
        float(2 * c[2] + t * (6 * c[3] + t * (12 * c[4] + t * 20 * c[5]))),
    )


class AimedSwing:
    """State of one swinging sole: position, velocity and acceleration of its centre, advanced sample by sample."""

    def __init__(self, position_m: Vector3, velocity_m_s: Vector3) -> None:
        self.p, self.v, self.a = position_m.copy(), velocity_m_s.copy(), np.zeros(3)
        self.ground_m = float(position_m[2])
        self.clear_m = self.ground_m
        self.landing = False
        self.elapsed_s = 0.0

    def advance(self, place_m: np.ndarray, height_m: float, in_s: float, dt_s: float) -> None:
        """Advance by ``dt_s`` towards a landing at ``place_m`` in ``in_s``; ``clear_m`` is the height to pass over."""
        T = max(in_s, dt_s)
        self.elapsed_s += dt_s
        if in_s <= dt_s:  # search for the ground
            self.v = np.array([0.0, 0.0, -SEARCH_M_S])
            self.a = np.zeros(3)
            self.p = self.p + self.v * dt_s
            return
        fall_s = min(max(0.45 * (T + self.elapsed_s), 0.08), 0.2)
        self.landing = self.landing or fall_s >= T
        level_T = max(T - 0.02, dt_s)
        for k in range(2):
            c = quintic_coefficients(self.p[k], self.v[k], self.a[k], float(place_m[k]), 0.0, level_T)
            self._integrate(k, evaluate(c, min(dt_s, level_T))[2], dt_s)
        if self.landing:
            c = quintic_coefficients(self.p[2], self.v[2], self.a[2], height_m, -0.1, T)
        else:
            rise_s = max(T - fall_s, 2 * dt_s)
            reachable = self.p[2] + RISE_M_S2 * rise_s**2 / 5.77 + 0.5 * rise_s * max(self.v[2], 0.0)
            apex = max(min(self.clear_m, reachable), height_m + 0.015, self.p[2] - 0.02)
            c = quintic_coefficients(self.p[2], self.v[2], self.a[2], apex, 0.0, rise_s)
        self._integrate(2, evaluate(c, dt_s)[2], dt_s)

    def follow(self, position_m: Vector3, velocity_m_s: Vector3) -> None:
        """Let the reference follow a sole that is left behind by more than ``BEHIND_M``."""
        behind = position_m - self.p
        distance = float(np.linalg.norm(behind))
        if distance > BEHIND_M:
            self.p = self.p + behind * (1.0 - BEHIND_M / distance)
            self.v = self.v + 0.3 * (velocity_m_s - self.v)

    def _integrate(self, k: int, a: float, dt_s: float) -> None:
        a = float(np.clip(a, -MOST_M_S2, MOST_M_S2))
        before = self.v[k]
        self.a[k] = a
        self.v[k] += a * dt_s
        self.p[k] += 0.5 * (before + self.v[k]) * dt_s
