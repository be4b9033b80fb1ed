"""Sizes of the errors from the recording itself: the priors that make its own data most probable.

The likelihood of a Kalman filter falls apart into the axes, and the gradient costs one pass: all parameters of all
axes, each a little larger, are further models in the same batch. Logarithms of the sizes are sought, each held near its
prior by a normal distribution of ``WIDTH`` (a factor of e^WIDTH is one standard deviation), because a second of data
does not know every size. The constant errors (table, plates, clocks) are not learned: one recording shows their sum.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import optimize

from stridelab.estimation.smoother.model import Sizes, state_space
from stridelab.estimation.smoother.recursions import Signals, filtered, gains, log_likelihood

LEARNED: Final = ("marker_m", "moment_m", "table_varying_m", "swing_m_s", "overtone_m_s", "damping")
WIDTH: Final = 1.0
DOWN, UP = 1.1, 3.0
"""No size is learned smaller than a third of its prior (e^-DOWN), nor larger than e^UP times it: markers that were
filtered look free of noise, and their error is slow instead."""
ITERATIONS: Final = 8
STEP: Final = 1e-3
LOOKED_AT: Final = 600
LARGEST_DAMPING: Final = 0.9
SETTLING: Final = 1e-4
"""Relative change at which gains count as final here: sizes come out the same to 1e-3, in half the time."""

HORIZONTAL: Final = np.array([0, 1])

Logs = Float[np.ndarray, "p axes"]


def learned(sizes: Sizes, signals: Signals, rate_hz: float) -> Sizes:
    """The sizes with those of ``LEARNED`` replaced, per axis, by the most probable ones.

    Only the horizontal axes learn. Vertically there is one measurement: its sizes follow the mean of the others', the
    noise of the geometry in the proportion of its roughness.
    The stretch that is looked at lies around the middle of what has force, and has at most ``LOOKED_AT`` samples.
    """
    roughness = np.sqrt(np.mean(np.diff(signals.geometry_m, 3, axis=0) ** 2, axis=0))
    signals = _middle(signals).of(HORIZONTAL)
    middle = replace(sizes, ends=(1.0, 1.0)).of(HORIZONTAL)
    start = np.log([getattr(middle, name) for name in LEARNED])

    def cost(x: Float[np.ndarray, "_"]) -> tuple[float, Float[np.ndarray, "_"]]:
        logs = x.reshape(start.shape)
        values = -log_likelihoods(middle, np.array([logs, *_neighbours(logs)]), signals, rate_hz)
        away = (logs - start) / WIDTH
        slope = (values[1:] - values[0]) / STEP + away / WIDTH
        return float(values[0].sum() + 0.5 * np.sum(away**2)), slope.ravel()

    highest = start + UP
    highest[LEARNED.index("damping")] = np.log(LARGEST_DAMPING)
    bounds = list(zip((start - DOWN).ravel(), highest.ravel(), strict=True))
    best = optimize.minimize(
        cost, start.ravel(), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": ITERATIONS}
    )
    change = best.x.reshape(start.shape) - start
    every = np.exp(np.column_stack([change, change.mean(axis=1)]))
    rough = roughness[2] / np.mean(roughness[:2]) if roughness.min() > 0.0 else 1.0
    every[LEARNED.index("marker_m"), 2] *= np.clip(rough, np.exp(-DOWN), np.exp(UP))
    return replace(sizes, **{name: getattr(sizes, name) * x for name, x in zip(LEARNED, every, strict=True)})


def log_likelihoods(
    sizes: Sizes, candidates: Float[np.ndarray, "k p axes"], signals: Signals, rate_hz: float
) -> Float[np.ndarray, "k axes"]:
    """Log-likelihood of every candidate, per axis."""
    space = state_space(with_logs(sizes, candidates), rate_hz)
    found = gains(space, signals.seen, signals.phi, SETTLING)
    return log_likelihood(space, found, filtered(space, signals, found)).reshape(len(candidates), -1)


def with_logs(sizes: Sizes, candidates: Float[np.ndarray, "k p axes"]) -> Sizes:
    """One batch of models: all axes for each candidate."""
    k = len(candidates)
    batch = sizes.repeated(k)
    given = {name: np.exp(candidates[:, i]).ravel() for i, name in enumerate(LEARNED)}
    given = {name: np.where(getattr(batch, name) > 0, value, 0.0) for name, value in given.items()}
    return replace(batch, **given)


def _middle(signals: Signals) -> Signals:
    at = int(np.median(np.flatnonzero(signals.seen)))
    first = max(0, min(at - LOOKED_AT // 2, len(signals) - LOOKED_AT))
    return signals.between(first, first + LOOKED_AT)


def _neighbours(logs: Logs) -> Float[np.ndarray, "p p axes"]:
    """Each parameter a little larger, in all axes at once."""
    return np.asarray(logs + STEP * np.eye(len(logs))[:, :, None])
