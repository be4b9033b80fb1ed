"""Local dynamic stability: the largest Lyapunov exponent of walking (Rosenstein, Collins and De Luca 1993).

The lateral velocity of the CoM over all strides, on 100 samples per stride on average, is embedded in five dimensions
with a delay of ten samples. Each state has a nearest neighbour at least one stride away in time; with d_k the mean over
all states of the logarithm of the distance to it k samples later,

    exponent = slope of d_k over half a stride, per stride.

Larger values say that small disturbances grow faster. The estimate depends on the number of strides and is imprecise
below 150 (Bruijn, van Dieen, Meijer and Beek 2009): with fewer it is refused, and it has no stated error.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series
from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import LEFT, WalkMotion, strides
from stridelab.walking.steps import GaitStep

LEAST_STRIDES: Final = 150
"""Number of consecutive strides that the exponent needs."""
STRIDE_SAMPLES: Final = 100
DIMENSIONS: Final = 5
DELAY_SAMPLES: Final = 10
_BLOCK: Final = 500


def local_stability(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    """``local_dynamic_stability`` of the longest run of strides; empty with fewer than ``LEAST_STRIDES``."""
    run = longest_run_s(motion, steps)
    if len(run) <= LEAST_STRIDES:
        return []
    first_s, last_s = run[0], run[LEAST_STRIDES]
    at_s = np.linspace(first_s, last_s, LEAST_STRIDES * STRIDE_SAMPLES)
    lateral = np.interp(at_s, motion.time_s, motion.velocity_m_s[:, LEFT])
    states = embed_delays(lateral, DIMENSIONS, DELAY_SAMPLES)
    per_sample = divergence_rate(states, separation=STRIDE_SAMPLES, horizon=STRIDE_SAMPLES // 2)
    return [Measure("local_dynamic_stability", STRIDE_SAMPLES * per_sample, None, "1/stride")]


def longest_run_s(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[float]:
    """Strikes of one foot in the longest unbroken run of strides within the estimate, in seconds; n strides are n + 1.

    A step that is missing between two strikes ends the run.
    """
    runs: list[list[float]] = [[]]
    for side in ("left", "right"):
        runs.append([])
        for _, step, following in strides(steps):
            whole = following.prior_strike_s is not None and step.strike_s < following.prior_strike_s
            if step.side != side or not whole or not motion.covers(step.strike_s, following.strike_s):
                continue
            if not runs[-1] or runs[-1][-1] != step.strike_s:
                runs.append([step.strike_s])
            runs[-1].append(following.strike_s)
    return max(runs, key=len)


def embed_delays(track: Series, dimensions: int, delay: int) -> Float[np.ndarray, "m d"]:
    """States of ``dimensions`` values of ``track`` that are ``delay`` samples apart."""
    n = len(track) - (dimensions - 1) * delay
    return np.column_stack([track[k * delay : k * delay + n] for k in range(dimensions)])


def divergence_rate(states: Float[np.ndarray, "n d"], *, separation: int, horizon: int) -> float:
    """Slope of the mean logarithmic distance of nearest neighbours, per sample, from 0 to ``horizon`` samples.

    Neighbours are more than ``separation`` samples apart. Identical states are left out.
    """
    n = len(states) - horizon
    nearest = np.concatenate([_nearest(states[:n], start, separation) for start in range(0, n, _BLOCK)])
    own = np.arange(n)
    distances = np.array([np.linalg.norm(states[own + k] - states[nearest + k], axis=1) for k in range(horizon + 1)])
    growing = (distances > 0.0).all(axis=0)
    mean_logarithm = np.log(distances[:, growing]).mean(axis=1)
    return float(np.polyfit(np.arange(horizon + 1), mean_logarithm, 1)[0])


def _nearest(states: Float[np.ndarray, "n d"], start: int, separation: int) -> np.ndarray:
    """Nearest neighbours of a block of states from ``start`` on."""
    block = states[start : start + _BLOCK]
    square = (states**2).sum(axis=1)
    distance = square - 2.0 * block @ states.T
    for k, row in enumerate(distance, start=start):
        row[max(0, k - separation) : k + separation + 1] = np.inf
    return np.asarray(distance.argmin(axis=1))
