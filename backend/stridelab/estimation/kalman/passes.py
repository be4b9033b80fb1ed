"""Forward and backward passes over a record: prediction, filter (2.28)-(2.31) and smoother.

The filter combines each prediction with its measurement. The smoother of Rauch, Tung and Striebel gives the state from
all measurements. It is computed here from the prediction (x, P) and the information (h, J) of the later measurements:

    P_s = (P^-1 + J)^-1 = (1 + P J)^-1 P,        x_s = x + P_s (h - J x),

the same state and covariance as the backward recursion. Several sets of signals use the same gains: the record, and
each error signal to be propagated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.estimation.complementary.forward_backward import FilterInputs
from stridelab.estimation.differentiation import Span, low_pass, smoothed_derivatives
from stridelab.estimation.error_band import FusedStretch, propagated_sd_m
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.kalman.jerk_model import C, JerkModel, Stretch, backward_model, forward_model
from stridelab.estimation.kalman.riccati import Square, Squares, Starts, States

Inputs = Float[np.ndarray, "sets n 3"]
"""(2.30) for one axis: geometry, acceleration, axis point; unmeasured values are not used."""


@dataclass(frozen=True)
class Track:
    """Mean of each set and the common covariance of all sets, per sample."""

    mean: States
    covariance: Squares


@dataclass(frozen=True)
class Axis:
    """One axis of a record: model, row of R, measured stretches and initial covariance."""

    model: JerkModel
    variance: tuple[float, ...]
    stretches: Sequence[Stretch]
    start_covariance: Square

    def predict_states(self, y: Inputs, start: Starts) -> Track:
        """Predict the state at each sample from the measurements before it."""
        mean, covariance = start, self.start_covariance
        means, covariances = np.empty_like(y), np.empty((y.shape[1], 3, 3))
        for s in self.stretches:
            predictor = forward_model(self.model, self.variance, s.rows).predictor(covariance, s.stop - s.first)
            predicted = predictor.predict_means(mean, y[:, s.first : s.stop, list(s.rows)])
            means[:, s.first : s.stop], covariances[s.first : s.stop] = (
                predicted[:, :-1],
                predictor.covariance[:-1],
            )
            mean, covariance = predicted[:, -1], predictor.covariance[-1]
        return Track(means, covariances)

    def filter_states(self, y: Inputs, start: Starts) -> Track:
        """Filter: state at each sample from the measurements up to it."""
        predicted = self.predict_states(y, start)
        means, covariances = predicted.mean.copy(), predicted.covariance.copy()
        for s in self.stretches:
            at = slice(s.first, s.stop)
            steady = forward_model(self.model, self.variance, s.rows)
            H, P = steady.H, predicted.covariance[at]
            seen = H @ P
            K = np.linalg.solve(seen @ H.T + steady.R, seen).transpose(0, 2, 1)
            innovation = y[:, at, list(s.rows)] - predicted.mean[:, at] @ H.T
            means[:, at] += np.einsum("kim,skm->ski", K, innovation)
            covariances[at] -= K @ seen
        return Track(means, covariances)

    def smooth_states(self, y: Inputs, start: Starts) -> Track:
        """Smooth: state at each sample from all measurements (Rauch-Tung-Striebel)."""
        predicted, later = self.predict_states(y, start), self._later_information(y)
        P, J = predicted.covariance, later.covariance
        covariance = np.linalg.solve(np.eye(3) + P @ J, P)
        unexpected = later.mean - np.einsum("kij,skj->ski", J, predicted.mean)
        return Track(predicted.mean + np.einsum("kij,skj->ski", covariance, unexpected), covariance)

    def lag_s(self, frequency_hz: float) -> float:
        """Steady-state delay of the filter for a motion of this frequency on which all three inputs agree."""
        steady = forward_model(self.model, self.variance, (0, 1, 2))
        w = 2 * np.pi * frequency_hz
        z = np.exp(1j * w * self.model.dt_s)
        y = np.array([1.0, -(w**2), 1.0])
        predicted = np.linalg.solve(z * np.eye(3) - steady.Phi, steady.L @ y)
        K = steady.P @ steady.H.T @ np.linalg.inv(steady.S)
        c = (predicted + K @ (y - steady.H @ predicted))[0]
        return float(-np.angle(c) / w)

    def _later_information(self, y: Inputs) -> Track:
        """Information h and J about the state at each sample from this and all later measurements."""
        h, J = np.zeros((len(y), 3)), np.zeros((3, 3))
        means, covariances = np.empty_like(y), np.empty((y.shape[1], 3, 3))
        for s in reversed(self.stretches):
            at, n, rows = slice(s.first, s.stop), s.stop - s.first, list(s.rows)
            information = y[:, at, rows] / np.array(self.variance)[rows] @ C[rows]
            predictor = backward_model(self.model, self.variance, s.rows).predictor(J, n)
            predicted = predictor.predict_means(h, np.zeros((len(y), n, 1)), information[:, ::-1])
            means[:, at], covariances[at] = predicted[:, :0:-1], predictor.covariance[:0:-1]
            h, J = predicted[:, -1], predictor.covariance[-1]
        return Track(means, covariances)


Pass = Callable[[Axis, Inputs, Starts], Track]
"""``Axis.filtered`` or ``Axis.smoothed``."""


@dataclass(frozen=True)
class JerkRecord:
    """The three inputs over the gap-free geometry and an ``Axis`` for each of x, y, z.

    Outside the window only the geometry of ``inputs`` is used.
    """

    geometric: GeometricCom
    span: Span
    inputs: FilterInputs
    stretch: FusedStretch
    axes: tuple[Axis, Axis, Axis]
    priors: ErrorPriors

    def estimate_window(self, run_axis: Pass, method: str, references: tuple[str, ...]) -> ComEstimate:
        """Estimate over the window.

        ``sd_m`` combines the input errors, propagated through the pass, and the distortion of a motion on which all
        inputs agree, with the low-passed geometry as the true motion. ``model_sd_*_m`` in the diagnostics is the
        standard deviation of the model itself.
        """
        within, rate_hz = self.stretch.within, self.span.rate_hz
        motion = low_pass(self.inputs.geometry_m, rate_hz)
        agreed = FilterInputs(motion, smoothed_derivatives(motion, rate_hz)[1], motion)
        tracks = self._run_pass(run_axis, [self.inputs, agreed])
        left_behind = (_stack_positions(tracks)[1] - motion)[within]
        stated = propagated_sd_m(
            lambda errors: list(_stack_positions(self._run_pass(run_axis, errors))),
            self.stretch,
            self.geometric.sd_m,
            self.priors,
        )
        c, v, a = np.stack([t.mean[0, within] for t in tracks], axis=-1).transpose(1, 0, 2)
        believed = np.sqrt([t.covariance[within, 0, 0].mean() for t in tracks]).tolist()
        return ComEstimate(
            method=method,
            time_s=self.geometric.time_s[self.span.inside],
            com_m=c,
            velocity_m_s=v,
            acceleration_m_s2=a,
            sd_m=np.hypot(stated, left_behind),
            window=self.span.window,
            references=references,
            diagnostics={
                "sigma_jerk_m_s3": self.axes[0].model.sigma_jerk_m_s3,
                **{f"model_sd_{name}_m": sd for name, sd in zip("xyz", believed, strict=True)},
            },
        )

    def _run_pass(self, run_axis: Pass, inputs: Sequence[FilterInputs]) -> list[Track]:
        """Run one pass of every axis over several sets of inputs; each starts at its first geometry, at rest."""
        tracks = []
        for j, axis in enumerate(self.axes):
            y = np.array([[i.geometry_m[:, j], i.acceleration_m_s2[:, j], i.axis_point_m[:, j]] for i in inputs])
            start = np.zeros((len(y), 3))
            start[:, 0] = y[:, 0, 0]
            tracks.append(run_axis(axis, np.ascontiguousarray(y.transpose(0, 2, 1)), start))
        return tracks


def _stack_positions(tracks: Sequence[Track]) -> Float[np.ndarray, "sets n 3"]:
    return np.stack([t.mean[:, :, 0] for t in tracks], axis=-1)
