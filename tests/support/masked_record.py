"""One axis of a record in which the force is measured for a while, with a flight in it."""

import numpy as np

from stridelab.estimation.jerk_model import measured_inputs


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
