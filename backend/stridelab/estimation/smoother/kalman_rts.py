"""Kalman filter and fixed-interval smoother for all axes of a walk, with unknown constants as regression coefficients.

The states have several columns: the data, and the response of the filter to one unit of each unknown constant (de Jong
1991, the augmented Kalman filter). Every innovation is then linear in the constants, e(beta) = e0 - E beta, and

    beta = (sum E' S^-1 E + P0^-1)^-1 sum E' S^-1 e0

The error of the height is *considered*, not estimated (Schmidt 1966): the sway of a walk is in phase with its angular
momentum, so that a regression would give spurious heights. Its effect is included in the standard deviation.

The gains depend only on the model and on which samples have a force, so they are computed once per constant stretch
after they have converged. The backward pass (de Jong 1989; Durbin & Koopman, 4.4) does not invert covariances:

    r_{k-1} = H' S^-1 e + F' r_k,   N_{k-1} = H' S^-1 H + F' N_k F,   F = A - K H
    x_{k|T} = x_k + P_k r_{k-1},    P_{k|T} = P_k - P_k N_{k-1} P_k
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from stridelab.conventions import Mask, Series
from stridelab.estimation.smoother.state_space import (
    ACCELERATION,
    CONSTANTS,
    HEIGHT,
    MEASURED,
    MOMENT,
    SEGMENTS,
    STATES,
    TABLE,
    C,
    L,
    Matrices,
    StateSpace,
    V,
    observation_matrix,
)

COLUMNS = 1 + CONSTANTS
SETTLED = 1e-9
"""Relative change of the predicted covariance below which the gains count as converged."""

Table = Float[np.ndarray, "g a 10 10"]


@dataclass(frozen=True)
class Signals:
    """Data per axis of the walking frame, metres: y1, y2 (0 where not measured), and the acceleration from k to k + 1.

    ``turning`` marks the samples whose moment is used; ``bridged`` the steps, from k to k + 1, in a short gap of the
    force: there the acceleration is interpolated.
    ``phi`` and ``sway`` are the noise-free vertical and horizontal force over the weight (``state_space``);
    ``segments_m`` is the rate of the segments' angular momentum over the weight, zeros where it is not used;
    ``velocity_m_s`` is the initial velocity of the filter.
    """

    geometry_m: Float[np.ndarray, "n axes"]
    moment_m: Float[np.ndarray, "n axes"]
    acceleration_m_s2: Float[np.ndarray, "n axes"]
    seen: Mask
    turning: Mask
    bridged: Mask
    phi: Series
    sway: Float[np.ndarray, "n axes"]
    segments_m: Float[np.ndarray, "n axes"]
    velocity_m_s: Float[np.ndarray, "axes"]

    def __len__(self) -> int:
        return len(self.geometry_m)

    def slice_samples(self, first: int, stop: int) -> "Signals":
        """Samples ``first`` to ``stop`` (exclusive)."""
        part = {name: value[first:stop] for name, value in vars(self).items() if name != "velocity_m_s"}
        return replace(self, **part)

    def select_axes(self, axes: Int[np.ndarray, "_"]) -> "Signals":
        """Signals of some axes, in this order."""
        return replace(
            self,
            geometry_m=self.geometry_m[:, axes],
            moment_m=self.moment_m[:, axes],
            acceleration_m_s2=self.acceleration_m_s2[:, axes],
            sway=self.sway[:, axes],
            segments_m=self.segments_m[:, axes],
            velocity_m_s=self.velocity_m_s[axes],
        )


@dataclass(frozen=True)
class Gains:
    """Distinct gain sets, and the index of the set of each sample; ``loop`` is F = A - G H - K H."""

    use: Int[np.ndarray, "n"]
    predicted: Table
    loop: Table
    gain: Float[np.ndarray, "g a 10 2"]
    observe: Float[np.ndarray, "g a 2 10"]
    information: Float[np.ndarray, "g a 2 2"]
    log_det: Float[np.ndarray, "g a"]
    final: Float[np.ndarray, "a 10 10"]


@dataclass(frozen=True)
class Rest:
    """The final measurement at rest (``StateSpace.rest_variance``): innovation of the swing states, S^-1, log det S."""

    innovation: Float[np.ndarray, "a 4 6"]
    information: Float[np.ndarray, "a 4 4"]
    log_det: Float[np.ndarray, "a"]


@dataclass(frozen=True)
class ForwardPass:
    """Result of the forward pass: predicted states and innovations in columns, and the constants from all samples.

    ``constants`` is beta per axis (table, acceleration, moment, segments), ``constants_cov`` its posterior covariance.
    ``height_leak`` is the effect of a height error of one metre on beta. ``rest`` is the final measurement at rest.
    """

    states: Float[np.ndarray, "n a 10 6"]
    innovations: Float[np.ndarray, "n a 2 6"]
    constants: Float[np.ndarray, "a 4"]
    constants_cov: Float[np.ndarray, "a 4 4"]
    information: Float[np.ndarray, "a 4 4"]
    score: Float[np.ndarray, "a 4"]
    height_leak: Float[np.ndarray, "a 4"]
    height_sd: Float[np.ndarray, "a"]
    rest: "Rest"


def regimes_of(signals: Signals) -> Int[np.ndarray, "n"]:
    """Regime per sample; 0: force measured here and at the next sample, 1: here only, 2: not measured.

    3 and 4 are 1 and 2 with the acceleration of the step interpolated; 5 is 0 without the moment.
    """
    driven = signals.seen & np.append(signals.seen[1:], False)
    with_moment = np.where(driven, 0, 1 + 2 * signals.bridged)
    without = np.where(driven, 5, 2 + 2 * signals.bridged)
    return np.asarray(np.where(signals.turning, with_moment, without))


def compute_gains(space: StateSpace, signals: Signals, settling: float = SETTLED) -> Gains:
    """Riccati recursion over all samples; samples of equal regime and phi share a gain once it has converged."""
    regime, phi, n = regimes_of(signals), signals.phi, len(signals)
    use = np.empty(n, dtype=np.int64)
    predicted, loops, gain_list, observed, weights = [], [], [], [], []
    p = space.start_covariance
    last_kind: tuple[int, float] | None = None
    settled = False
    for k in range(n):
        kind = (int(regime[k]), float(phi[k]))
        if kind != last_kind:
            last_kind, settled = kind, False
            now, h = space.regimes[kind[0]], observation_matrix(kind[1], space.turned)
            base = now.transition - now.feed @ h
            ht = np.swapaxes(h, 1, 2)
            base_t = np.swapaxes(base, 1, 2)
        if not settled:
            pht = p @ ht
            s = h @ pht
            w = _inverse_innovation(s, now.noise_m2)
            gain = base @ pht @ w
            loop = base - gain @ h
            predicted.append(p)
            loops.append(loop)
            gain_list.append(gain + now.feed)
            observed.append(h)
            weights.append(w)
            following = loop @ p @ base_t + now.process
            following = (following + np.swapaxes(following, 1, 2)) / 2
            largest = np.abs(following).max(axis=(1, 2), keepdims=True)
            settled = bool((np.abs(following - p) <= settling * largest).all())
            p = following
        use[k] = len(predicted) - 1
    information = np.array(weights)
    return Gains(
        use=use,
        predicted=np.array(predicted),
        loop=np.array(loops),
        gain=np.array(gain_list),
        observe=np.array(observed),
        information=information,
        log_det=-np.log(np.linalg.det(information)),
        final=p,
    )


def filter_forward(space: StateSpace, signals: Signals, gain_sets: Gains) -> ForwardPass:
    """Run the forward pass; models beyond the number of axes are further candidates for the same axes."""
    n, models = len(signals), len(space.turned)
    axis = np.arange(models) % signals.geometry_m.shape[1]
    inputs = np.zeros((n, models, STATES, COLUMNS))
    driven = np.isin(regimes_of(signals), (0, 5)) | signals.bridged
    inputs[driven, :, :, 0] = signals.acceleration_m_s2[driven][:, axis, None] * space.drive
    inputs[driven, :, :, 1 + ACCELERATION] = -space.drive
    measured = np.zeros((n, models, MEASURED, COLUMNS))
    measured[:, :, 0, 0] = signals.geometry_m[:, axis]
    measured[:, :, 1, 0] = signals.moment_m[:, axis] * signals.turning[:, None]
    measured[:, :, 0, 1 + TABLE] = -1.0
    with_moment = signals.turning[:, None] & space.turned
    loaded = signals.phi[:, None] * with_moment
    measured[:, :, 1, 1 + ACCELERATION] = -space.lever_s2 * loaded
    measured[:, :, 1, 1 + MOMENT] = -loaded
    measured[:, :, 1, 1 + SEGMENTS] = -signals.segments_m[:, axis] * with_moment
    measured[:, :, 1, 1 + HEIGHT] = signals.sway[:, axis] * with_moment

    x = np.zeros((models, STATES, COLUMNS))
    x[:, C, 0], x[:, V, 0] = signals.geometry_m[0, axis], signals.velocity_m_s[axis]
    inputs += gain_sets.gain[gain_sets.use] @ measured
    states = np.empty_like(inputs)
    for k, (i, u) in enumerate(zip(gain_sets.use.tolist(), inputs, strict=True)):
        states[k] = x
        x = gain_sets.loop[i] @ x + u
    e = measured - gain_sets.observe[gain_sets.use] @ states
    weighted = gain_sets.information[gain_sets.use] @ e
    rest = _rest_measurement(space, gain_sets.final, x)
    gram = np.einsum("kamc,kamd->acd", e, weighted)
    gram += np.swapaxes(rest.innovation, 1, 2) @ rest.information @ rest.innovation
    sought = slice(1, HEIGHT + 1)
    information, score = gram[:, sought, sought], -gram[:, sought, 0]
    cov, constants = _constant_posterior(space.constant_sd[:, :HEIGHT], information, score)
    leak = -np.einsum("acd,ad->ac", cov, gram[:, sought, HEIGHT + 1])
    return ForwardPass(states, e, constants, cov, information, score, leak, space.constant_sd[:, HEIGHT], rest)


def smooth_backward(
    gain_sets: Gains, forward: ForwardPass, rows: int
) -> tuple[Float[np.ndarray, "n a r"], Float[np.ndarray, "n a r r"]]:
    """Mean and covariance of the first ``rows`` states at every sample, from all samples."""
    use = gain_sets.use
    observe_t = np.swapaxes(gain_sets.observe, 2, 3)
    push = observe_t[use] @ (gain_sets.information[use] @ forward.innovations)
    gained = observe_t @ gain_sets.information @ gain_sets.observe
    loop_t = np.swapaxes(gain_sets.loop, 2, 3)
    n = len(use)
    r = np.zeros(push.shape[1:])
    big = np.zeros(gain_sets.loop.shape[1:])
    r[:, L:] = forward.rest.information @ forward.rest.innovation
    big[:, L:, L:] = forward.rest.information
    rs = np.empty_like(push)
    covariance = np.empty((n, len(forward.constants), rows, rows))
    previous, settled, last = -1, False, covariance[0]
    for k in range(n - 1, -1, -1):
        i = int(use[k])
        r = push[k] + loop_t[i] @ r
        rs[k] = r
        if i != previous or not settled:
            big = gained[i] + loop_t[i] @ big @ gain_sets.loop[i]
            following = _smoothed_covariance(gain_sets.predicted[i], big, rows)
            # The information itself may grow for ever: that of the memory of white noise, which has no variance.
            sd = np.sqrt(np.abs(np.diagonal(following, axis1=1, axis2=2)))
            scale = sd[:, :, None] * sd[:, None, :]
            settled = i == previous and bool((np.abs(following - last) <= SETTLED * scale).all())
            previous, last = i, following
        covariance[k] = last
    states = forward.states[:, :, :rows] + gain_sets.predicted[use, :, :rows] @ rs
    sensitivity = states[..., 1 : HEIGHT + 1]
    mean = states[..., 0] + np.einsum("karc,ac->kar", sensitivity, forward.constants)
    covariance += sensitivity @ forward.constants_cov @ np.swapaxes(sensitivity, 2, 3)
    height = states[..., HEIGHT + 1] + np.einsum("karc,ac->kar", sensitivity, forward.height_leak)
    height = height * forward.height_sd[:, None]
    covariance += height[..., :, None] * height[..., None, :]
    return mean, covariance


def _smoothed_covariance(predicted: Matrices, information: Matrices, rows: int) -> Float[np.ndarray, "a r r"]:
    """Covariance of the first ``rows`` states from their predicted one and the information N of all later samples."""
    top = predicted[:, :rows]
    return np.asarray(top[:, :, :rows] - top @ information @ np.swapaxes(top, 1, 2))


def log_likelihood(space: StateSpace, gain_sets: Gains, forward: ForwardPass) -> Float[np.ndarray, "a"]:
    """Log-likelihood per model with the constants marginalised, up to a term that depends on the data size only."""
    e0, last = forward.innovations[..., 0], forward.rest
    quadratic = np.einsum("kam,kamn,kan->a", e0, gain_sets.information[gain_sets.use], e0)
    quadratic += np.einsum("am,amn,an->a", last.innovation[..., 0], last.information, last.innovation[..., 0])
    explained = np.einsum("ac,ac->a", forward.score, forward.constants)
    shrunk = np.eye(HEIGHT) + _scale_information(space.constant_sd[:, :HEIGHT], forward.information)
    dets = gain_sets.log_det[gain_sets.use].sum(axis=0) + last.log_det
    return np.asarray(-0.5 * (quadratic - explained + dets + np.linalg.slogdet(shrunk)[1]))


def _rest_measurement(space: StateSpace, p: Matrices, x: Float[np.ndarray, "a 10 6"]) -> Rest:
    """Measurement at rest against the prediction (x, P) after the last sample; no information in mid-walk."""
    innovation = -x[:, L:]
    if space.rest_variance is None:
        return Rest(innovation, np.zeros((len(x), 4, 4)), np.zeros(len(x)))
    s = p[:, L:, L:] + space.rest_variance[:, :, None] * np.eye(4)
    return Rest(innovation, np.linalg.inv(s), np.linalg.slogdet(s)[1] * space.turned)


def _constant_posterior(
    sd: Float[np.ndarray, "a 4"], information: Float[np.ndarray, "a 4 4"], score: Float[np.ndarray, "a 4"]
) -> tuple[Float[np.ndarray, "a 4 4"], Float[np.ndarray, "a 4"]]:
    """Posterior covariance and mean of the constants; a prior of zero switches a constant off."""
    core = np.linalg.inv(np.eye(HEIGHT) + _scale_information(sd, information))
    cov = sd[:, :, None] * core * sd[:, None, :]
    return cov, np.einsum("acd,ad->ac", cov, score)


def _scale_information(
    sd: Float[np.ndarray, "a 4"], information: Float[np.ndarray, "a 4 4"]
) -> Float[np.ndarray, "a 4 4"]:
    return np.asarray(sd[:, :, None] * information * sd[:, None, :])


def _inverse_innovation(
    s: Float[np.ndarray, "a 2 2"], noise_m2: Float[np.ndarray, "a 2"]
) -> Float[np.ndarray, "a 2 2"]:
    """Inverse of S + diag(noise), written out because calls dominate the cost of small batches."""
    a, d, b = s[:, 0, 0] + noise_m2[:, 0], s[:, 1, 1] + noise_m2[:, 1], s[:, 0, 1]
    out = np.empty_like(s)
    det = a * d - b * b
    out[:, 0, 0], out[:, 1, 1] = d / det, a / det
    out[:, 0, 1] = out[:, 1, 0] = -b / det
    return out
