"""The largest Lyapunov exponent of a system whose exponent is known, and of walks with enough strides and too few."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stridelab.measures.local_stability import (
    LEAST_STRIDES,
    divergence_rate,
    embed_delays,
    local_stability,
    longest_run_s,
)
from support.recordings.analytic_motions import STEP_S, plain_steps, plain_walk


def logistic_map(n: int) -> np.ndarray:
    """``x -> 4 x (1 - x)``, whose exponent is ln 2."""
    x = np.empty(n)
    x[0] = 0.3123
    for k in range(1, n):
        x[k] = 4.0 * x[k - 1] * (1.0 - x[k - 1])
    return x


@pytest.mark.parametrize("dimensions", [1, 2])
def test_the_logistic_map_diverges_by_a_factor_of_two_per_step(dimensions: int) -> None:
    states = embed_delays(logistic_map(6000), dimensions, 1)
    assert divergence_rate(states, separation=5, horizon=4) == pytest.approx(math.log(2.0), rel=0.005)


def test_neighbours_of_a_contracting_system_approach_each_other() -> None:
    """Two transients of ``x -> x / 2``: their distance halves with every step."""
    decay = 0.5 ** np.arange(12)
    track = np.concatenate([decay, np.full(4, 9.0), 1.01 * decay, np.full(4, 99.0)])[:, None]
    states = np.column_stack([track, np.tile(10.0 * np.arange(16.0), 2)])
    assert divergence_rate(states[:28], separation=8, horizon=3) < 0.0


def test_delays_embed_a_track() -> None:
    np.testing.assert_array_equal(embed_delays(np.arange(6.0), 3, 2), [[0.0, 2.0, 4.0], [1.0, 3.0, 5.0]])


def test_with_too_few_strides_there_is_no_exponent() -> None:
    motion, steps = plain_walk(), plain_steps()
    assert len(longest_run_s(motion, steps)) - 1 == 9
    assert local_stability(motion, steps) == []


def test_a_missing_step_ends_the_run() -> None:
    steps = plain_steps()
    gap = (*steps[:8], *(replace(step, prior_strike_s=None) for step in steps[8:9]), *steps[10:])
    assert len(longest_run_s(plain_walk(), gap)) < len(longest_run_s(plain_walk(), steps))


def test_enough_strides_give_one_value_without_a_stated_error() -> None:
    n = 2 * LEAST_STRIDES + 4
    time_s = np.arange(round((n + 1) * STEP_S * 100.0)) / 100.0
    rng = np.random.default_rng(3)
    sway = np.sin(np.pi * time_s / STEP_S) + 0.05 * np.cumsum(rng.normal(size=len(time_s))) / math.sqrt(len(time_s))
    velocity = np.column_stack([np.full_like(time_s, 1.2), sway, np.zeros_like(time_s)])
    still = np.zeros((len(time_s), 3))
    motion = replace(plain_walk(), time_s=time_s, com_m=still, velocity_m_s=velocity, momentum_per_kg=still)
    (measure,) = local_stability(motion, plain_steps(n))
    assert (measure.name, measure.unit, measure.sd, measure.step) == ("local_dynamic_stability", "1/stride", None, None)
    assert math.isfinite(measure.value)
    assert local_stability(motion, plain_steps(2 * LEAST_STRIDES - 2)) == []
