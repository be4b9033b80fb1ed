"""Alternative models of the CoM path and motion, compared with the wheel on the same data.

Path, z as a function of x:  sinusoid, two harmonics, inverted-pendulum arcs with a parabola between, and the wheel.
Time, x and z as functions of t:  one harmonic (a moving ellipse), two harmonics, and the wheel with constant speed.

Residuals of a step are smooth, so samples at 200 Hz are not independent. AIC counts ``EFFECTIVE_HZ`` samples per second
as independent, and cross-validation holds out whole blocks of that length instead of samples.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from stridelab.conventions import Mask, Series
from stridelab.walking.curtate_cycloid import FULL_TURN_RAD, Branch, Plane
from stridelab.walking.path_fit import fit_path
from stridelab.walking.timed_fit import fit_in_time

EFFECTIVE_HZ: Final = 12.0
FREQUENCY_RANGE: Final = np.linspace(0.75, 1.25, 41)
"""Search grid of the sinusoids, relative to one wave per step."""
FOLDS: Final = 4

NO_ERROR_M2: Final = 1e-18
"""Floor of the mean square in the likelihood: one nanometre squared."""

Phases = Float[np.ndarray, "k n"]
"""One row per frequency."""
Rows = Float[np.ndarray, "k n p"]
Predict = Callable[[Mask], Plane]
"""Fits a model to the samples of the mask and returns its errors (ahead, up) at all samples."""


@dataclass(frozen=True)
class StepData:
    """Data of one step: the path, its instants, the step period, and the mask of double support."""

    time_s: Series
    path_m: Plane
    period_s: float
    double_support: Mask

    @property
    def effective_samples(self) -> float:
        """Number of independent samples at ``EFFECTIVE_HZ``: about seven in a step."""
        return float(EFFECTIVE_HZ * (self.time_s[-1] - self.time_s[0]))


@dataclass(frozen=True)
class ModelScore:
    """Score of one model: number of parameters, RMS error and cross-validated RMS error in metres, AIC."""

    model: str
    parameters: int
    rms_m: float
    held_out_rms_m: float
    aic: float


def compare_path_models(step: StepData) -> tuple[ModelScore, ...]:
    """Compare sinusoid, two harmonics, arcs, and both branches of the wheel as functions z(x); vertical errors only."""
    models: Sequence[tuple[str, int, Predict]] = (
        ("sinusoid", 4, lambda seen: _waves_of_x(step, seen, 1)),
        ("two-harmonics", 6, lambda seen: _waves_of_x(step, seen, 2)),
        ("pendulum-arcs", 3 * len(_support_phases(step)), lambda seen: _arcs_of_x(step, seen)),
        ("wheel", 4, lambda seen: _wheel_of_x(step, seen, 1)),
        ("wheel-reversed", 4, lambda seen: _wheel_of_x(step, seen, -1)),
    )
    return tuple(_score_model(step, *model, channels=1) for model in models)


def compare_time_models(step: StepData) -> tuple[ModelScore, ...]:
    """Compare one and two harmonics, and both branches of the wheel with constant speed; errors ahead and up."""
    models: Sequence[tuple[str, int, Predict]] = (
        ("one-harmonic", 8, lambda seen: _waves_of_t(step, seen, 1)),
        ("two-harmonics", 12, lambda seen: _waves_of_t(step, seen, 2)),
        ("wheel", 6, lambda seen: _wheel_of_t(step, seen, 1)),
        ("wheel-reversed", 6, lambda seen: _wheel_of_t(step, seen, -1)),
    )
    return tuple(_score_model(step, *model, channels=2) for model in models)


def _score_model(step: StepData, model: str, parameters: int, predict: Predict, *, channels: int) -> ModelScore:
    everything = np.ones(len(step.time_s), dtype=np.bool_)
    error = predict(everything)[:, -channels:]
    held_out = np.empty_like(error)
    for block in _fold_masks(step):
        held_out[block] = predict(~block)[block, -channels:]
    mean_squares = np.mean(error**2, axis=0) + NO_ERROR_M2
    aic = step.effective_samples * float(np.log(mean_squares).sum()) + 2 * parameters
    return ModelScore(model, parameters, _rms_distance(error), _rms_distance(held_out), aic)


def _fold_masks(step: StepData) -> list[Mask]:
    """Masks of the folds: every ``FOLDS``-th block of one independent sample's length, including the step's ends."""
    number = np.floor((step.time_s - step.time_s[0]) * EFFECTIVE_HZ).astype(int)
    return [number % FOLDS == fold for fold in range(FOLDS)]


def _rms_distance(error: Float[np.ndarray, "n channels"]) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def _wave_columns(phase: Phases, harmonics: int) -> Rows:
    each = [wave(k * phase) for k in range(1, harmonics + 1) for wave in (np.cos, np.sin)]
    return np.stack([np.ones_like(phase), *each], axis=-1)


def _fit_errors(rows: Rows, y: Series, seen: Mask) -> Phases:
    """Errors of the least-squares fit to the samples of the mask, one frequency per row."""
    q, r = np.linalg.qr(rows[:, seen])
    coefficients = np.linalg.solve(r, np.swapaxes(q, 1, 2) @ y[seen][:, None])
    return np.asarray((rows @ coefficients)[..., 0] - y)


def _waves_of_x(step: StepData, seen: Mask, harmonics: int) -> Plane:
    """Height a0 + sum of waves of k x; k is searched on a grid around one wave per step length."""
    x, z = step.path_m[:, 0] - step.path_m[0, 0], step.path_m[:, 1]
    length = np.polyfit(step.time_s, x, 1)[0] * step.period_s
    error = _fit_errors(_wave_columns(np.outer(FULL_TURN_RAD / length * FREQUENCY_RANGE, x), harmonics), z, seen)
    best = error[np.argmin(np.sum(error[:, seen] ** 2, axis=1))]
    return np.column_stack([np.zeros_like(best), best])


def _waves_of_t(step: StepData, seen: Mask, harmonics: int) -> Plane:
    """Ahead: a line + waves of t; up: a constant + waves of t; one frequency for both."""
    t = step.time_s - step.time_s[0]
    waves = _wave_columns(np.outer(FULL_TURN_RAD / step.period_s * FREQUENCY_RANGE, t), harmonics)
    line = np.broadcast_to(t[:, None], (*waves.shape[:2], 1))
    ahead = _fit_errors(np.concatenate([waves, line], axis=2), step.path_m[:, 0], seen)
    up = _fit_errors(waves, step.path_m[:, 1], seen)
    cost = sum(np.log(np.mean(error[:, seen] ** 2, axis=1) + NO_ERROR_M2) for error in (ahead, up))
    best = int(np.argmin(cost))
    return np.column_stack([ahead[best], up[best]])


def _support_phases(step: StepData) -> list[Int[np.ndarray, "_"]]:
    """Sample indices of every support phase."""
    return np.split(np.arange(len(step.time_s)), np.flatnonzero(np.diff(step.double_support)) + 1)


def _arcs_of_x(step: StepData, seen: Mask) -> Plane:
    """One parabola per support phase: arcs of an inverted pendulum, joined by those of double support."""
    x, z = step.path_m[:, 0] - step.path_m[0, 0], step.path_m[:, 1]
    error = np.zeros_like(z)
    for part in _support_phases(step):
        inside = part[seen[part]]
        degree = min(2, max(len(inside) - 1, 0))
        known = inside if len(inside) else np.flatnonzero(seen)
        error[part] = np.polyval(np.polyfit(x[known], z[known], degree), x[part]) - z[part]
    return np.column_stack([np.zeros_like(z), error])


def _wheel_of_x(step: StepData, seen: Mask, branch: Branch) -> Plane:
    """Error of the wheel's height where its position ahead equals that of the CoM."""
    fit = fit_path(step.time_s[seen], step.path_m[seen], step.period_s, branch)
    wheel, x = fit.wheel, step.path_m[:, 0]
    theta = np.interp(step.time_s, step.time_s[seen], fit.theta_rad)
    for _ in range(20):  # Newton's method on x(theta) = x, which is monotone while r < R
        slope = wheel.tangent_m(theta)[:, 0]
        safe = np.where(np.abs(slope) > 1e-6, slope, 1e-6)
        theta = theta - np.clip((wheel.position_m(theta)[:, 0] - x) / safe, -0.5, 0.5)
    error = wheel.position_m(theta)[:, 1] - step.path_m[:, 1]
    return np.column_stack([np.zeros_like(error), error])


def _wheel_of_t(step: StepData, seen: Mask, branch: Branch) -> Plane:
    fit = fit_in_time(step.time_s[seen], step.path_m[seen], step.period_s, branch)
    t = step.time_s - step.time_s[seen][0]
    return np.asarray(fit.wheel.position_m(fit.theta0_rad + fit.omega_rad_s * t) - step.path_m)
