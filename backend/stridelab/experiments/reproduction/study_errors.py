"""Errors of all estimators over many draws of the noise of 2.5.1: the table behind figure 2.7."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.estimation.against_truth import TruthError, error_m, truth_error
from stridelab.estimation.complementary import ComplementaryFilter
from stridelab.estimation.estimate import ComEstimator
from stridelab.estimation.geometry import GeometryOnly
from stridelab.estimation.kalman import KalmanFilter
from stridelab.estimation.rts import RtsSmoother
from stridelab.estimation.smoother import Smoother
from stridelab.estimation.spectra import error_spectrum
from stridelab.experiments.reproduction.item import Column, Tell
from stridelab.experiments.robot_gait import GaitName
from stridelab.experiments.robot_walker import RATE_HZ
from stridelab.experiments.study import StudyTrial, simulate

THESIS, KALMAN, AUTO, SMOOTHER, GEOMETRY = (
    "complementary-thesis",
    "kalman-thesis",
    "complementary",
    "smoother",
    "geometry",
)
ESTIMATORS: Final[Mapping[str, ComEstimator]] = {
    GEOMETRY: GeometryOnly(),
    THESIS: ComplementaryFilter.thesis(),
    AUTO: ComplementaryFilter(),
    KALMAN: KalmanFilter(),
    "kalman": KalmanFilter.tuned(),
    "rts": RtsSmoother.tuned(),
    SMOOTHER: Smoother(),
}
"""By the names they have in ``compare-estimators``."""
NOISY_HZ: Final = 5.0
PerAxis = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Draw:
    """Errors of every estimator on one trial; ``noisy_m`` is the horizontal RMS of the error above 5 Hz.

    ``closer`` is the share of samples at which the thesis' filter is horizontally no further from the truth than the
    thesis' Kalman filter.
    """

    gait: GaitName
    noise: str
    errors: Mapping[str, TruthError]
    noisy_m: Mapping[str, float]
    closer: float


def draw(trial: StudyTrial, noise: str) -> Draw:
    """All estimators on one trial."""
    errors, noisy, distance = {}, {}, {}
    for name, estimator in ESTIMATORS.items():
        estimate = estimator.estimate(trial.geometric, trial.wrench, trial.mass_kg)
        errors[name] = truth_error(estimate, trial.truth.time_s, trial.truth.com_m)
        e = error_m(estimate, trial.truth.time_s, trial.truth.com_m)
        high = error_spectrum(e, RATE_HZ).band_rms(NOISY_HZ, RATE_HZ)
        noisy[name] = float(np.hypot(high[0], high[1]))
        distance[name] = np.hypot(e[:, 0], e[:, 1])
    return Draw(trial.gait, noise, errors, noisy, float(np.mean(distance[THESIS] <= distance[KALMAN])))


def draws(gaits: Sequence[GaitName], noises: Sequence[str], seeds: int, tell: Tell) -> list[Draw]:
    """Every gait under every noise, ``seeds`` times."""
    wanted = [(gait, noise, seed) for gait in gaits for noise in noises for seed in range(seeds)]
    done = []
    for k, (gait, noise, seed) in enumerate(wanted):
        tell(k / len(wanted), f"{gait} gait, {noise} noise, draw {seed + 1} of {seeds}")
        done.append(draw(simulate(gait, noise, seed), noise))
    return done


def horizontal_ratio(found: Sequence[Draw], one: str, other: str) -> float:
    """Horizontal RMS error of one estimator over that of another, both over all draws."""
    return rms([d.errors[one].horizontal_m for d in found]) / rms([d.errors[other].horizontal_m for d in found])


def rms(values: Sequence[float]) -> float:
    """Root mean square of numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


def table(found: Sequence[Draw]) -> dict[str, Column]:
    """One row per gait, noise and estimator: RMS over the draws, mean coverage and lag."""
    rows: dict[str, list[object]] = {}
    for gait, noise in dict.fromkeys((d.gait, d.noise) for d in found):
        group = [d for d in found if (d.gait, d.noise) == (gait, noise)]
        for name in ESTIMATORS:
            errors = [d.errors[name] for d in group]
            row: dict[str, object] = {"gait": gait, "noise": noise, "estimator": name, "draws": len(group)}
            row |= _axes("rms_{}_m", np.sqrt(np.mean([e.rms_m**2 for e in errors], axis=0)))
            row["horizontal_m"] = rms([e.horizontal_m for e in errors])
            row["horizontal_worst_m"] = max(e.horizontal_m for e in errors)
            row |= _axes("coverage_{}", np.mean([e.coverage for e in errors], axis=0))
            row |= _axes("sd_{}_m", np.sqrt(np.mean([e.sd_m**2 for e in errors], axis=0)))
            row |= _axes("lag_{}_s", np.median([e.lag_s for e in errors], axis=0))
            for key, value in row.items():
                rows.setdefault(key, []).append(value)
    return {key: np.array(values) for key, values in rows.items()}


def _axes(pattern: str, values: PerAxis) -> dict[str, object]:
    return {pattern.format(axis): float(value) for axis, value in zip("xyz", values, strict=True)}
