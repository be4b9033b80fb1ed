"""Exchange of potential and kinetic energy of the CoM in a stride (Cavagna, Thys and Zamboni 1976).

    E_f = v_ahead^2 / 2,    E_v = g z + v_z^2 / 2,    E = g z + |v|^2 / 2       per kilogram
    W = sum of the positive increments over the stride
    recovery = 1 - W_ext / (W_f + W_v)

An ideal pendulum has a recovery of 1. The standard deviation is propagated to first order from the
error of the mean speed and the errors of the ranges of the speed ahead, the vertical velocity and the height.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Int

from stridelab.conventions import GRAVITY_M_S2, Points, Series
from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import AHEAD, LEFT, UP, WalkMotion, strides
from stridelab.walking.steps import MAX_MISSING_SHARE, GaitStep

MAX_VELOCITY_SD_M_S: Final = 0.01
"""Largest error of the vertical velocity in a stride. Where the force is not measured the smoother's is 0.045 m/s, and
the positive increments of that noise alone are up to twice the work of a walk."""

STEP_ERRORS: Final[Mapping[str, tuple[float, float]]] = {
    "step_energy_recovery": (0.40, 0.36),
    "step_external_work": (0.087, 1.2),
}
"""Factor of the propagated deviation of a single step, as in ``stated_errors``, and the deviation per missing share of
the step, of the work as a share of it. Factors: 68 simulated walks with odd seeds below 136 over three plates; missing
ends: the exact motion of ten walks with odd seeds below 20, of which up to 8 % was left out. Other seeds test both. By
the markers alone nothing is missing, and the factor is that of a stride (``stated_errors.FACTORS``)."""


def energy_exchange(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    """``energy_recovery`` (a share) and ``external_work`` (J/kg) per stride, from strike to strike of one foot.

    Strides in which the velocity is too uncertain are left out: work adds up the positive increments of its noise.
    Without any stride, as over two plates, ``step_energies`` are given if the error of the velocity is stated.
    """
    return _of_strides(motion, steps) or ([] if motion.covariance is None else step_energies(motion, steps))


def step_energies(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    """``step_energy_recovery`` and ``step_external_work`` of single steps from lift-off to lift-off.

    Up to 8 % of a step, at its ends, may be missing, which adds to the error; all of it is used if no error of the
    velocity is stated.
    """
    measures: list[Measure] = []
    for number, step in enumerate(steps):
        span = motion.samples(step.lift_off_s, step.next_lift_off_s)
        if not motion.covers(step.lift_off_s, step.next_lift_off_s):
            continue
        known = np.ones(span.stop - span.start, dtype=bool)
        if motion.covariance is not None and not motion.by_markers:
            known = motion.covariance[span, UP, 1, 1] <= MAX_VELOCITY_SD_M_S**2
        missing = 1.0 - float(np.mean(known))
        if missing <= MAX_MISSING_SHARE:
            samples = np.arange(span.start, span.stop)[known]
            of_step = _energies(motion, samples, "step_", step, number)
            measures += of_step if motion.by_markers else [_with_missing_ends(one, missing) for one in of_step]
    return [measure for measure in measures if math.isfinite(measure.value)]


def _with_missing_ends(measure: Measure, missing: float) -> Measure:
    """The measure of a step with its calibrated deviation, to which the ``missing`` share of the step adds."""
    if measure.sd is None:
        return measure
    factor, per_missing = STEP_ERRORS[measure.name]
    scale = abs(measure.value) if measure.unit == "J/kg" else 1.0
    return replace(measure, sd=math.hypot(factor * measure.sd, per_missing * missing * scale))


def _of_strides(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    measures: list[Measure] = []
    for number, step, following in strides(steps):
        span = motion.samples(step.strike_s, following.strike_s)
        if motion.covers(step.strike_s, following.strike_s) and not _is_velocity_uncertain(motion, span):
            measures += _energies(motion, np.arange(span.start, span.stop), "", step, number)
    return [measure for measure in measures if math.isfinite(measure.value)]


def _energies(
    motion: WalkMotion, samples: Int[np.ndarray, " k"], prefix: str, step: GaitStep, number: int
) -> tuple[Measure, Measure]:
    """Recovery and work over ``samples``, with their errors if that of the state is stated."""
    v, z = motion.velocity_m_s[samples], motion.com_m[samples, UP]
    base = _recovery_and_work(v, z)
    recovery_sd = work_sd = None
    if motion.covariance is not None:
        sd_v = np.sqrt(np.maximum(motion.covariance[samples, :, 1, 1].mean(axis=0), 0.0))
        changes = [_recovery_and_work(v + sd_v * [1.0, 0.0, 0.0], z)]
        changes += [_recovery_and_work(v + _stretched(v, axis, sd_v[axis]), z) for axis in (AHEAD, UP)]
        changes.append(_recovery_and_work(v, z + _swing(z, motion.varying_sd_m)))
        recovery_sd, work_sd = (math.hypot(*(change[k] - base[k] for change in changes)) for k in (0, 1))
    return (
        Measure(f"{prefix}energy_recovery", base[0], recovery_sd, "1", step.side, number),
        Measure(f"{prefix}external_work", base[1], work_sd, "J/kg", step.side, number),
    )


def _is_velocity_uncertain(motion: WalkMotion, span: slice) -> bool:
    """Whether the vertical velocity has an error above ``MAX_VELOCITY_SD_M_S`` anywhere in the stride."""
    if motion.covariance is None or motion.by_markers:
        return False
    return bool(motion.covariance[span, UP, 1, 1].max() > MAX_VELOCITY_SD_M_S**2)


def _stretched(v: Points, axis: int, sd_m_s: float) -> Points:
    """Change of the velocity along one axis: its variation grows by an error at both ends of its range."""
    change = np.zeros_like(v)
    change[:, axis] = _swing(v[:, axis], sd_m_s)
    return change


def _swing(track: Series, sd: float) -> Series:
    """Change of a track whose range grows by two independent errors of ``sd``."""
    return np.asarray((track - track.mean()) * math.sqrt(2.0) * sd / max(float(np.ptp(track)), sd))


def _recovery_and_work(v: Points, z: Series) -> tuple[float, float]:
    forward = 0.5 * v[:, AHEAD] ** 2
    vertical = GRAVITY_M_S2 * z + 0.5 * v[:, UP] ** 2
    whole = forward + vertical + 0.5 * v[:, LEFT] ** 2
    w_f, w_v, w_ext = (float(np.maximum(np.diff(energy), 0.0).sum()) for energy in (forward, vertical, whole))
    return (1.0 - w_ext / (w_f + w_v) if w_f + w_v > 0.0 else math.nan), w_ext
