"""Wheels with a known clock, drawn by hypothesis or by a seed, and the steps that they walk."""

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from stridelab.walking.curtate_cycloid import Branch, Wheel

HUMAN = Wheel(R_m=0.095, r_m=0.014, z0_m=0.93, x0_m=2.3)
PERIOD_S = 0.54


@dataclass(frozen=True)
class Walked:
    """A wheel that rolled: instants, angles and path; ``period_s`` is what a walker would take for the step period."""

    wheel: Wheel
    time_s: np.ndarray
    theta_rad: np.ndarray
    period_s: float
    omega_rad_s: float

    @property
    def path_m(self) -> np.ndarray:
        return self.wheel.position_m(self.theta_rad)


def walked(wheel: Wheel = HUMAN, theta0_rad: float = -4.0, turns: float = 1.1, unevenness: float = 0.0) -> Walked:
    """At 100 Hz from ``theta0_rad`` on; the clock is uneven by that share of its speed."""
    omega = 2 * np.pi / PERIOD_S
    t = 7.0 + np.arange(round(100 * turns * PERIOD_S) + 1) / 100.0
    even = theta0_rad + omega * (t - t[0])
    return Walked(wheel, t, even + unevenness * np.sin(even + 0.3), PERIOD_S, omega)


@st.composite
def walks(draw: st.DrawFn, *, uneven: bool) -> Walked:
    """Any person, any place in the laboratory, any phase, either branch; a step period that is wrong by up to 15 %."""
    R = draw(st.floats(0.05, 0.2))
    branch: Branch = draw(st.sampled_from([1, -1]))
    wheel = Wheel(
        R_m=R,
        r_m=R * draw(st.floats(0.03, 0.6)),
        z0_m=draw(st.floats(0.4, 1.3)),
        x0_m=draw(st.floats(-20.0, 20.0)),
        branch=branch,
    )
    period = draw(st.floats(0.35, 0.8))
    omega = 2 * np.pi / period * draw(st.floats(0.87, 1.15))
    rate = draw(st.sampled_from([100.0, 200.0]))
    t = draw(st.floats(0.0, 100.0)) + np.arange(round(rate * period * draw(st.floats(0.98, 1.3)))) / rate
    even = draw(st.floats(-np.pi, np.pi)) + omega * (t - t[0])
    wobble = draw(st.floats(-0.25, 0.25)) * np.sin(even + draw(st.floats(0.0, 6.0))) if uneven else 0.0
    return Walked(wheel, t, even + wobble, period, omega)


def parameters(wheel: Wheel) -> np.ndarray:
    """x0, R, r, z0."""
    return np.array([wheel.x0_m, wheel.R_m, wheel.r_m, wheel.z0_m])


def central_differences(of, at: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Derivative of a vector-valued function, one column per argument."""
    columns = []
    for k in range(len(at)):
        h = np.zeros_like(at)
        h[k] = step * max(1.0, abs(at[k]))
        columns.append((of(at + h) - of(at - h)) / (2 * h[k]))
    return np.column_stack(columns)
