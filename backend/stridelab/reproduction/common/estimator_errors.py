"""Errors of all estimators on simulated walks, shared by several items, and their means.

A draw takes about a second, most of it in the smoother; draws are cached in the process and shared between items.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from stridelab.conventions import PerAxis, Progress
from stridelab.estimation.evaluation.error_spectra import error_spectrum
from stridelab.estimation.evaluation.truth_errors import TruthError, error_m, truth_error
from stridelab.reproduction.claims import Column
from stridelab.reproduction.common.estimators import KALMAN, NAMES, THESIS, study_estimators
from stridelab.reproduction.studies.estimator_study import simulate_trial
from stridelab.simulation.robot.gait_plan import GaitName
from stridelab.simulation.robot.walker import RATE_HZ

GAITS: Final[tuple[GaitName, ...]] = ("robot", "human")
NOISY_HZ: Final = 5.0


@dataclass(frozen=True)
class Draw:
    """Errors of every estimator on one trial; ``noisy_m`` is the horizontal RMS error above 5 Hz.

    ``share_closer`` is the share of samples at which the horizontal error of the thesis' filter does not exceed that of
    the thesis' Kalman filter.
    """

    gait: GaitName
    noise: str
    errors: Mapping[str, TruthError]
    noisy_m: Mapping[str, float]
    share_closer: float


@lru_cache(maxsize=1000)
def errors_of_draw(gait: GaitName, noise: str, seed: int) -> Draw:
    """Errors of all estimators on one trial."""
    trial = simulate_trial(gait, noise, seed)
    errors, noisy, distance = {}, {}, {}
    for name, estimator in study_estimators(trial).items():
        estimate = estimator.estimate(trial.geometric, trial.wrench, trial.mass_kg)
        errors[name] = truth_error(estimate, trial.truth.time_s, trial.truth.com_m)
        e = error_m(estimate, trial.truth.time_s, trial.truth.com_m)
        high = error_spectrum(e, RATE_HZ).band_rms(NOISY_HZ, RATE_HZ)
        noisy[name] = float(np.hypot(high[0], high[1]))
        distance[name] = np.hypot(e[:, 0], e[:, 1])
    return Draw(gait, noise, errors, noisy, float(np.mean(distance[THESIS] <= distance[KALMAN])))


def compute_draws(gaits: Sequence[GaitName], noises: Sequence[str], seeds: range, tell: Progress) -> list[Draw]:
    """One draw per seed of every combination of gait and noise."""
    wanted = [(gait, noise, seed) for gait in gaits for noise in noises for seed in seeds]
    done = []
    for k, (gait, noise, seed) in enumerate(wanted):
        tell(k / len(wanted), f"{gait} gait, {noise} noise, seed {seed}")
        done.append(errors_of_draw(gait, noise, seed))
    return done


def horizontal_ratio(draws: Sequence[Draw], one: str, other: str) -> float:
    """Horizontal RMS error of one estimator over that of another, both over all draws."""
    return rms([d.errors[one].horizontal_m for d in draws]) / rms([d.errors[other].horizontal_m for d in draws])


def rms(values: Sequence[float]) -> float:
    """Root mean square of numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


def error_table(draws: Sequence[Draw]) -> dict[str, Column]:
    """One row per gait, noise and estimator: RMS over the draws, mean coverage and median lag."""
    rows: list[dict[str, object]] = []
    for gait, noise in dict.fromkeys((d.gait, d.noise) for d in draws):
        group = [d for d in draws if (d.gait, d.noise) == (gait, noise)]
        for name in NAMES:
            errors = [d.errors[name] for d in group]
            row: dict[str, object] = {"gait": gait, "noise": noise, "estimator": name, "draws": len(group)}
            row |= per_axis("rms_{}_m", np.sqrt(np.mean([e.rms_m**2 for e in errors], axis=0)))
            row["horizontal_m"] = rms([e.horizontal_m for e in errors])
            row["horizontal_worst_m"] = max(e.horizontal_m for e in errors)
            row |= per_axis("coverage_{}", np.mean([e.coverage for e in errors], axis=0))
            row |= per_axis("sd_{}_m", np.sqrt(np.mean([e.sd_m**2 for e in errors], axis=0)))
            row |= per_axis("lag_{}_s", np.median([e.lag_s for e in errors], axis=0))
            rows.append(row)
    return as_columns(rows)


def select_columns(
    columns: Mapping[str, Column], keys: Sequence[str], keep: Callable[[int], bool]
) -> dict[str, Column]:
    """Columns ``keys`` of a table, restricted to the rows for whose index ``keep`` is True."""
    rows = [k for k in range(len(next(iter(columns.values())))) if keep(k)]
    return {key: columns[key][rows] for key in keys}


def as_columns(rows: Sequence[Mapping[str, object]]) -> dict[str, Column]:
    """Convert rows with the same keys to columns."""
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def per_axis(pattern: str, values: PerAxis) -> dict[str, object]:
    """Dictionary such as ``{"rms_x_m": ...}`` from the values of three axes."""
    return {pattern.format(axis): float(value) for axis, value in zip("xyz", values, strict=True)}
