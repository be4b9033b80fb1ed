"""One axis of a record in which the force is measured for a while, with a flight in it.

Analytic motions of a body with known CoM, angular momentum and contact wrench: the truth of the estimation tests.
"""

from dataclasses import dataclass, field

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.estimation.kalman.jerk_model import measured_inputs
from stridelab.recordings.recording import Window, WrenchTrack


def masked_record(rate_hz: float, n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """One axis: geometry always, force in one window, in it a flight without an axis; and what is measured."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / rate_hz
    c, a = 3 + 1.2 * t + 0.03 * np.sin(10 * t), -3 * np.sin(10 * t)
    y = np.column_stack([c, a, c]) + rng.normal(size=(n, 3)) * [0.01, 0.1, 0.02]
    force = np.tile([0.0, 0.0, 700.0], (n // 2, 1))
    force[n // 8 : n // 6] = 0.0
    measured = measured_inputs(n, slice(n // 4, n // 4 + n // 2), force)
    return np.where(measured, y, np.nan), measured


WEIGHT_M_S2 = np.array([0.0, 0.0, 9.81])


@dataclass(frozen=True)
class Harmonics:
    """``x(t) = start + rate t + sum A sin(2 pi f t + phase)`` per axis, with exact derivatives."""

    start: np.ndarray
    rate: np.ndarray
    waves: tuple[tuple[float, np.ndarray, float], ...] = ()

    def at(self, t: np.ndarray, order: int = 0) -> np.ndarray:
        line = [self.start + np.outer(t, self.rate), np.tile(self.rate, (len(t), 1)), np.zeros((len(t), 3))]
        x = line[min(order, 2)].astype(float)
        for f, amplitude, phase in self.waves:
            w = 2 * np.pi * f
            x = x + np.outer(w**order * np.sin(w * t + phase + order * np.pi / 2), amplitude)
        return x


@dataclass(frozen=True)
class Motion:
    """CoM and angular momentum about it; the wrench follows from Newton and Euler, written out here once more."""

    com: Harmonics
    momentum: Harmonics = field(default_factory=lambda: Harmonics(np.zeros(3), np.zeros(3)))
    mass_kg: float = 70.0

    def force(self, t: np.ndarray) -> np.ndarray:
        return self.mass_kg * (self.com.at(t, 2) + WEIGHT_M_S2)

    def moment(self, t: np.ndarray) -> np.ndarray:
        return np.cross(self.com.at(t), self.force(t)) + self.momentum.at(t, 1)

    def wrench_track(self, t: np.ndarray, window: Window, late_s: float = 0.0, read_late_s: float = 0.0) -> WrenchTrack:
        """What plates see whose clock is ``late_s`` late, read ``read_late_s`` later; NaN outside the window."""
        shifted = t - late_s + read_late_s
        complete = (t >= window.start_s) & (t <= window.end_s)
        hole = np.where(complete, 0.0, np.nan)[:, None]
        return WrenchTrack(
            time_s=t,
            force_n=self.force(shifted) + hole,
            moment_nm=self.moment(shifted) + hole,
            complete=complete,
            windows=(window,),
            latency_applied_s=read_late_s,
        )

    def geometric(
        self, t: np.ndarray, bias_m: np.ndarray | None = None, noise_m: np.ndarray | None = None
    ) -> GeometricCom:
        com = self.com.at(t) + (0 if bias_m is None else bias_m) + (0 if noise_m is None else noise_m)
        return GeometricCom(t, com, "truth", {}, {}, (0.02, 0.02, 0.02))


def uniform(velocity_m_s: tuple[float, float, float] = (1.2, -0.1, 0.05), mass_kg: float = 70.0) -> Motion:
    """A body that coasts."""
    return Motion(Harmonics(np.array([3.0, -2.0, 0.9]), np.array(velocity_m_s)), mass_kg=mass_kg)


def sinusoid(frequency_hz: float, amplitude_m: float = 1.0) -> Motion:
    """All three axes swing together around a fixed point; heavy gravity share keeps the axis defined."""
    wave = (frequency_hz, np.array([amplitude_m] * 3), 0.3)
    return Motion(Harmonics(np.array([1.0, 2.0, 1.0]), np.zeros(3), (wave,)))


def walk(speed_m_s: float = 1.2, step_hz: float = 1.8, mass_kg: float = 70.0) -> Motion:
    """Level walking along +x: steps in x and z, strides in y, with the angular momentum of an adult."""
    stride = step_hz / 2
    com = Harmonics(
        np.array([0.4, 0.1, 0.95]),
        np.array([speed_m_s, 0.0, 0.0]),
        (
            (step_hz, np.array([0.012, 0.0, 0.0]), 0.4),
            (step_hz, np.array([0.0, 0.0, 0.02]), 2.1),
            (2 * step_hz, np.array([0.001, 0.0, 0.0015]), 1.0),
            (stride, np.array([0.0, 0.025, 0.0]), 0.2),
            (3 * stride, np.array([0.0, 0.002, 0.0]), 1.2),
        ),
    )
    momentum = Harmonics(
        np.zeros(3),
        np.zeros(3),
        ((step_hz, np.array([0.0, 2.2, 0.0]), 0.9), (stride, np.array([1.5, 0.0, 0.6]), 2.5)),
    )
    return Motion(com, momentum, mass_kg)
