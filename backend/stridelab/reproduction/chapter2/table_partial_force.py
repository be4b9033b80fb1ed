"""Two seconds of walking with force in the middle second: reduction of the error by one second of force."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Progress
from stridelab.errors import NotEstimable
from stridelab.estimation.evaluation.truth_errors import TruthError, error_m, truth_error
from stridelab.estimation.smoother import Smoother
from stridelab.reproduction.claims import Claim, Reproduction, reproduces, target
from stridelab.reproduction.common.estimator_errors import GAITS, as_columns, rms
from stridelab.reproduction.common.estimators import NAMES, SMOOTHER, study_estimators, true_noise_priors
from stridelab.reproduction.common.intervals import resampled_interval
from stridelab.reproduction.common.matching_samples import matching_samples
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.reproduction.studies.estimator_study import StudyTrial, simulate_trial
from stridelab.simulation.robot.gait_plan import WALKS, GaitName
from stridelab.simulation.robot.walker import RATE_HZ

NOISES: Final = ("marker-like", "thesis")
CLAIM_NOISE: Final = "marker-like"
LENGTH_S, FORCE_S = 2.0, (0.5, 1.5)
TOO_SHORT_S: Final = 0.35
MAX_ATTEMPTS: Final = 50
MAX_HORIZONTAL_RMS_M: Final = {"human": 0.0035, "robot": 0.0040}
MAX_HORIZONTAL_95_M: Final = 0.0066
MAX_AROUND_M: Final = 0.005
Distances = Float[np.ndarray, "_"]


@dataclass(frozen=True)
class PartialForceErrors:
    """Horizontal distances from the truth and RMS per axis in the second with force; ``around_m`` outside of it.

    ``whole`` is the error over the whole estimate.
    """

    with_force_m: Distances
    rms_m: Float[np.ndarray, "3"]
    around_m: Distances
    whole: TruthError


@lru_cache(maxsize=1000)
def excerpt_with_single_support(gait: GaitName, noise: str, seed: int) -> tuple[StudyTrial, int]:
    """Two seconds of a walk with a random start, and the number of rejected starts.

    The second with force must contain a complete single support; a start that the smoother rejects is drawn again.
    Raises ``NotEstimable`` (``no-single-support``) after ``MAX_ATTEMPTS`` rejections.
    """
    for attempt in range(MAX_ATTEMPTS):
        trial = _random_excerpt(gait, noise, seed, attempt, FORCE_S)
        if _rejection_code(trial) is None:
            return trial, attempt
    raise NotEstimable("no-single-support", f"None of {MAX_ATTEMPTS} excerpts contains a complete single support.")


@lru_cache(maxsize=2000)
def partial_force_errors(gait: GaitName, noise: str, seed: int, name: str) -> PartialForceErrors:
    """Errors of one estimator on one draw."""
    trial, _ = excerpt_with_single_support(gait, noise, seed)
    estimate = study_estimators(trial, beyond_window=True)[name].estimate(trial.geometric, trial.wrench, trial.mass_kg)
    error = error_m(estimate, trial.truth.time_s, trial.truth.com_m)
    seen = trial.wrench.complete[matching_samples(trial.wrench.time_s, estimate.time_s)]
    distance = np.hypot(error[:, 0], error[:, 1])
    whole = truth_error(estimate, trial.truth.time_s, trial.truth.com_m)
    return PartialForceErrors(distance[seen], np.sqrt(np.mean(error[seen] ** 2, axis=0)), distance[~seen], whole)


def _random_excerpt(gait: GaitName, noise: str, seed: int, attempt: int, force_s: tuple[float, float]) -> StudyTrial:
    walk = WALKS[gait]
    latest_s = walk.duration_s - walk.rest_s - LENGTH_S
    start_s = round(np.random.default_rng([seed, 23, attempt]).uniform(walk.rest_s, latest_s) * RATE_HZ) / RATE_HZ
    return simulate_trial(gait, noise, seed).excerpt_between(start_s, start_s + LENGTH_S, force_s=force_s)


def _rejection_code(trial: StudyTrial) -> str | None:
    """Error code with which the smoother rejects the trial, or None."""
    try:
        Smoother(priors=true_noise_priors(trial), learn=False).estimate(trial.geometric, trial.wrench, trial.mass_kg)
    except NotEstimable as error:
        return error.code
    return None


@reproduces("partial-force", "One second of force in two", draws="many", default_seeds=4, printed=("errors",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Both gaits with marker and plate noise and with the thesis' noise, one draw per seed of each."""
    rows: list[dict[str, object]] = []
    claims: list[Claim] = []
    for k, (gait, noise) in enumerate((g, n) for g in GAITS for n in NOISES):
        tell(k / 4, f"{gait} gait, {noise} noise")
        parts = {name: [partial_force_errors(gait, noise, seed, name) for seed in seeds] for name in NAMES}
        rows += [{"gait": gait, "noise": noise, "estimator": name, **_error_summary(parts[name])} for name in NAMES]
        if noise == CLAIM_NOISE:
            claims += _gait_claims(gait, parts[SMOOTHER])
    tell(0.95, "testing short windows")
    claims += [_short_window_claim(gait, seeds) for gait in GAITS]
    rejections = {
        gait: sum(excerpt_with_single_support(gait, CLAIM_NOISE, seed)[1] for seed in seeds) for gait in GAITS
    }
    rejected = " and ".join(f"{n} of {n + len(seeds)} ({gait} gait)" for gait, n in rejections.items())
    return Reproduction(
        claims=tuple(claims),
        note=f"{len(seeds)} draws each. Errors over the second with force, norm of both horizontal axes; for "
        "estimators that extend beyond it, the last column contains the half seconds before and after. No estimator is "
        "given the angular momentum. A second without a complete single support is rejected (no-single-support) and "
        f"drawn again: {rejected}.",
        tables={"errors": as_columns(rows)},
        drawing=render_svg(
            *(
                Bars(
                    f"Horizontal RMS error in the second with force, {gait} gait, {noise} noise",
                    "mm",
                    [
                        (str(row["estimator"]), 1e3 * float(str(row["horizontal_m"])))
                        for row in rows
                        if (row["gait"], row["noise"]) == (gait, noise)
                    ],
                )
                for gait in GAITS
                for noise in NOISES
            )
        ),
        references=("carpentier2017thesis", "stasse2017talos"),
    )


def _error_summary(parts: Sequence[PartialForceErrors]) -> dict[str, float]:
    x, y, z = np.sqrt(np.mean([p.rms_m**2 for p in parts], axis=0)).tolist()
    inside = np.concatenate([p.with_force_m for p in parts])
    around = np.concatenate([p.around_m for p in parts])
    return {
        "rms_x_m": x,
        "rms_y_m": y,
        "rms_z_m": z,
        "horizontal_m": rms(inside.tolist()),
        "horizontal_95_m": float(np.percentile(inside, 95)),
        "around_m": rms(around.tolist()) if len(around) else float("nan"),
    }


def _gait_claims(gait: GaitName, parts: Sequence[PartialForceErrors]) -> list[Claim]:
    def error_claim(key: str, of: str, limit_m: float, says: str) -> Claim:
        def summarise_error(chosen: Sequence[int]) -> float:
            return _error_summary([parts[k] for k in chosen])[of]

        return target(f"{gait}_{key}", summarise_error(range(len(parts))), "m", at_most=limit_m).says(
            f"{gait} gait: {says}", interval=resampled_interval(summarise_error, len(parts))
        )

    return [
        error_claim(
            "horizontal_m", "horizontal_m", MAX_HORIZONTAL_RMS_M[gait],
            "the smoother's horizontal error (RMS) with a second of force",
        ),
        error_claim("95_m", "horizontal_95_m", MAX_HORIZONTAL_95_M, "its 95th percentile"),
        error_claim(
            "around_m", "around_m", MAX_AROUND_M, "its horizontal error (RMS) in the half seconds before and after"
        ),
    ]  # fmt: skip


def _short_window_claim(gait: GaitName, seeds: range) -> Claim:
    """Share of windows of ``TOO_SHORT_S`` that are rejected with ``window-too-short``."""
    force_s = (0.8, 0.8 + TOO_SHORT_S)
    refusals = [_rejection_code(_random_excerpt(gait, CLAIM_NOISE, seed, 0, force_s)) for seed in seeds]
    refused = refusals.count("window-too-short")
    return target(f"{gait}_refused", refused / len(seeds), "1", at_least=1.0).says(
        f"{gait} gait: {TOO_SHORT_S} s of force are rejected", cases_inside=refused
    )
