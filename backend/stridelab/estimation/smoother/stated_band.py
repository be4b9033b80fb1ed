"""Band that the smoother states: of its errors, whose sizes are not those by which it weighs its inputs.

Sizes that give the smallest error on people are robust ones: a varying table error and a rest of the angular momentum
that are larger than they are, moments that err with every foot. The band that follows from them is too wide. An
estimator that weighs with the covariance Q and meets errors of the covariance R keeps its gains, and a linear estimator
with fixed gains has an error covariance that is linear in R. Since its gains are the best for Q, the derivative of its
covariance P by Q is the one with fixed gains, so that

    P(Q; R) = P(Q) + dP(Q + e (R - Q)) / de   at e = 0,

one more covariance recursion, no further estimate. (The considered height has no optimal gain and is left out of it.)
The sizes R and how they were found are in docs/theory/smoother.md, *The band states other sizes*.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.smoother.kalman_rts import (
    ForwardPass,
    Signals,
    compute_gains,
    filter_forward,
    smooth_backward,
)
from stridelab.estimation.smoother.measurements import AIRBORNE_N, MIN_LEARNT_SHARE, Walk
from stridelab.estimation.smoother.noise_levels import (
    HORIZONTAL,
    RUN_FACTOR,
    SmootherPriors,
    adult_momentum_m_s,
    is_airborne,
    is_walk,
)
from stridelab.estimation.smoother.state_space import ACCELERATION, MOMENT, SEGMENTS, TABLE, Sizes, state_space

STEP: Final = 1e-4
"""Share of the way to the other squares for the derivative; at 0.01 an error ten times as large was 18 % too small."""
LONGEST: Final = 600
"""Samples up to which each has its own variance; over a minute that would take a third of the time of the estimate."""
VARYING_SHARE: Final = 0.4
"""Variance of the table's varying error over that of its weight."""
REST_SHARE: Final = np.array([1.0, 0.2, 1.0])
"""The same of what the segments leave of the angular momentum, per axis: laterally most of it repeats with the stride.
In runs and jumps that of the lateral axis holds for both, since the angular momentum does not change in flight."""
WALKING_SHARE: Final = 0.1
"""The same of the further error of the moments in walking."""
LEVEL_PRIOR: Final = 2.0
"""Observations that the prior of the constants' variance is worth."""
UNEXPLAINED: Final = 0.3
"""Share of an adult's angular momentum that the segments do not explain."""
INDEPENDENT_PER_S: Final = 4.0
"""Independent values of the angular momentum per second."""
FEWEST_INDEPENDENT: Final = 3.0


def stated_variance_m2(
    sizes: Sizes, errors: Sizes, data: Signals, rate_hz: float, variance_m2: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Variance of the position per axis of the walking frame if the horizontal errors have the sizes ``errors``.

    ``variance_m2`` is that of the smoother with ``sizes``, by which it weighs. A recording of more than ``LONGEST``
    samples has one ratio of both in each direction, that of those with force among ``LONGEST`` around the middle of it.
    """
    first = max(0, min(int(np.median(np.flatnonzero(data.seen))) - LONGEST // 2, len(data) - LONGEST))
    both = data.slice_samples(first, first + LONGEST).select_axes(HORIZONTAL)
    ends = (1.0, 1.0) if len(data) > LONGEST else sizes.ends
    weighed, met = (replace(one, ends=ends).select_axes(HORIZONTAL) for one in (sizes, errors))

    def towards(old: Float[np.ndarray, "2 *c"], new: Float[np.ndarray, "2 *c"]) -> Float[np.ndarray, "4 *c"]:
        return np.concatenate([old, np.sqrt((1.0 - STEP) * old**2 + STEP * new**2)])

    moved = replace(
        weighed.repeat_batch(2),
        table_varying_m=towards(weighed.table_varying_m, met.table_varying_m),
        swing_m_s=towards(weighed.swing_m_s, met.swing_m_s),
        overtone_m_s=towards(weighed.overtone_m_s, met.overtone_m_s),
        bias=towards(weighed.bias, met.bias),
    )
    space = state_space(moved, rate_hz)
    gain_sets = compute_gains(space, both)
    forward = filter_forward(space, both, gain_sets)
    _, known = smooth_backward(gain_sets, replace(forward, height_sd=np.zeros(2 * len(HORIZONTAL))), 1)
    change_m2 = (known[:, 2:, 0, 0] - known[:, :2, 0, 0]) / STEP
    stated_m2 = variance_m2.copy()
    if len(data) > LONGEST:
        change_m2, before_m2 = (one[both.seen].mean(axis=0) for one in (change_m2, known[:, :2, 0, 0]))
        stated_m2[:, HORIZONTAL] *= 1.0 + change_m2 / before_m2
    else:
        stated_m2[:, HORIZONTAL] += change_m2
    return np.asarray(np.maximum(stated_m2, 0.0))


def error_sizes(
    sizes: Sizes, priors: SmootherPriors, walk: Walk, data: Signals, forward: ForwardPass, mass_kg: float
) -> Sizes:
    """Sizes of the errors to be expected, where ``sizes`` are those by which the inputs are weighed."""
    weight = mass_kg * GRAVITY_M_S2
    airborne = is_airborne(walk, mass_kg)
    rest = np.where(sizes.bias[:, SEGMENTS] > 0.0, np.sqrt(REST_SHARE[1] if airborne else REST_SHARE), 1.0)
    varying_m = np.sqrt(VARYING_SHARE) * sizes.table_varying_m
    bias = sizes.bias.copy()
    moment_m2 = bias[:2, MOMENT] ** 2
    if is_walk(walk, mass_kg):
        moment_m2 -= (1.0 - WALKING_SHARE) * (np.array(priors.walking_moment_nm) / weight) ** 2
    if airborne:
        share = contact_share(walk, data)
        moment_m2 -= (1.0 - share**2) * (priors.plate_moment_nm / weight) ** 2
        bias[:2, ACCELERATION] *= share
        varying_m /= RUN_FACTOR
    level = level_factor(sizes, forward)
    moment_m2 = level * np.maximum(moment_m2, 0.0)
    if is_walk(walk, mass_kg):
        moment_m2 += misplaced_plates_m(sizes, walk, data, mass_kg) ** 2
    bias[:2, TABLE] *= np.sqrt(level)
    bias[:2, MOMENT] = np.sqrt(moment_m2)
    return replace(
        sizes,
        table_varying_m=varying_m,
        swing_m_s=rest * sizes.swing_m_s,
        overtone_m_s=rest * sizes.overtone_m_s,
        bias=bias,
    )


def level_factor(sizes: Sizes, forward: ForwardPass) -> float:
    """Variance of the constants over that of their sizes, from how far geometry and moments are apart.

    Its prior mean of 1 counts as ``LEVEL_PRIOR`` observations, each direction as one: the posterior mean b of the
    table's error satisfies b ~ N(0, P0 - V) if the sizes are true. So the constants have heavy tails.
    """
    prior_m2 = sizes.bias[:2, TABLE] ** 2
    learnt_m2 = prior_m2 - forward.constants_cov[:2, TABLE, TABLE]
    informative = learnt_m2 > MIN_LEARNT_SHARE * prior_m2
    squares = forward.constants[:2, TABLE] ** 2 / np.where(informative, learnt_m2, 1.0)
    return float((LEVEL_PRIOR + squares[informative].sum()) / (LEVEL_PRIOR + informative.sum()))


def contact_share(walk: Walk, data: Signals) -> float:
    """Time on the ground over the mean vertical force in weights.

    A constant error of a plate acts as long as it is loaded, not in proportion to the load, as in the model.
    """
    loaded = np.mean(walk.force_n[walk.seen, 2] > AIRBORNE_N)
    return float(min(1.0, loaded / np.mean(data.phi[data.seen])))


def misplaced_plates_m(sizes: Sizes, walk: Walk, data: Signals, mass_kg: float) -> Float[np.ndarray, "2"]:
    """Error of the moments, in metres, that a drift between moments and geometry shows; 0 where there is none.

    The angular momentum is bounded, so the integral of the difference y2 - phi y1 is a parabola up to it:

        int (y2 - phi y1) dt = l0 + int phi (mu + rho t) dt + k int d dt + l

    Plates whose moments refer to points that are s away from the stated ones, independently, each loaded for a step of
    duration T, let the difference drift by rho = sqrt(2) s / T. What exceeds the variance of rho is evidence of s.
    """
    at = np.flatnonzero(data.turning)
    t = (at - at.mean()) / walk.rate_hz
    phi = data.phi[at]
    momentum = np.max(adult_momentum_m_s(mass_kg, sizes.height_m)) * np.where(
        sizes.bias[:2, SEGMENTS] > 0.0, UNEXPLAINED, 1.0
    )
    independent = max(INDEPENDENT_PER_S * len(at) / walk.rate_hz, FEWEST_INDEPENDENT)
    found = np.zeros(2)
    for axis in range(2):
        segments = data.segments_m[at, axis]
        columns = np.column_stack([np.ones(len(at)), np.cumsum(phi) / walk.rate_hz, np.cumsum(phi * t) / walk.rate_hz])
        target = np.cumsum(data.moment_m[at, axis] - phi * data.geometry_m[at, axis]) / walk.rate_hz
        prior = np.zeros(3)
        if segments.any():
            columns = np.column_stack([columns, np.cumsum(segments) / walk.rate_hz])
            prior = np.append(prior, sizes.bias[axis, SEGMENTS] ** -2)
        per_value = independent / (len(at) * momentum[axis] ** 2)
        information = per_value * columns.T @ columns + np.diag(prior)
        posterior = np.linalg.inv(information)
        rho = posterior[2] @ (per_value * columns.T @ target)
        found[axis] = np.sqrt(max(rho**2 - posterior[2, 2], 0.0)) / (np.sqrt(2.0) * sizes.swing_hz[0])
    return found
