"""Which score that needs no truth orders the estimators as the truth does, on drawn people.

Every draw is a recording of ``experiments.people``. All estimators run on it; each candidate score is a mean square per
axis, and so is the true error. A score that is used to choose a default is a mean over people, so the agreement is
counted for groups of draws: in how many groups do score and truth put every pair in the same order whose true mean
squares differ by more than ``TIED``?
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import stats

from experiments.people.movements import Movement
from experiments.people.sensors import DrawnRecording, SensorErrors, draw_recording
from stridelab.conventions import GRAVITY_M_S2, Points
from stridelab.dynamics.wrench import Wrench, com_acceleration
from stridelab.errors import NotEstimable
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.differentiation import low_pass, window_span
from stridelab.estimation.estimator import ComEstimate, ComEstimator
from stridelab.estimation.evaluation.force_path import (
    PlateErrors,
    distance_from_force_m,
    force_path_m,
    momentum_of_segments_nms,
    path_error,
)
from stridelab.estimation.evaluation.holdout_force import BLOCK_S, withheld_estimates
from stridelab.estimation.evaluation.physics_residuals import force_residual_track_n
from stridelab.estimation.evaluation.unseen_scores import withheld_flight
from stridelab.estimation.kalman.filter import KalmanFilter, RtsSmoother
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.smoother import Smoother, SmootherPriors
from stridelab.recordings.recording import WrenchTrack

ESTIMATORS: Final[Mapping[str, ComEstimator]] = {
    "geometry": GeometryOnly(),
    "complementary": ComplementaryFilter(),
    "kalman": KalmanFilter.tuned(),
    "rts": RtsSmoother.tuned(),
    "smoother": Smoother(learn=False, priors=SmootherPriors(walking_moment_nm=(0.0, 0.0))),
}
TURNS: Final[Sequence[Movement]] = ("walk", "walk", "run", "stand", "walk", "run", "hop")
"""Movement of the draws, in turn."""
DURATION_S, FRAME_HZ = 2.5, 50.0
SPLIT_HZ: Final = 2.5
IMPULSE_S: Final = 0.5
PLATE_S: Final = 1.0
HIDDEN_EVERY: Final = 4
"""Every which draw also has long blocks withheld, which costs as much as all other scores together."""
TIED: Final = 0.1
"""Relative difference of two mean squares (5 % of the RMS) below which estimators count as equal."""

MeanSquares = Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class ScoredDraw:
    """Mean squares per axis (along, lateral, vertical) of truth and scores, by estimator.

    "truth" is in m^2; vertically without its constant part, which no force shows. ``path_m2`` is the true error of the
    force path.
    """

    seed: int
    movement: Movement
    loaded: bool
    path_m2: Sequence[float]
    scores: Mapping[str, MeanSquares]


def score_draw(seed: int, errors: SensorErrors | None = None) -> ScoredDraw:
    """Draw a person and score all estimators; the latency is estimated and corrected as a user's would be.

    Raises as the estimators do.
    """
    movement = TURNS[seed % len(TURNS)]
    drawn = draw_recording(seed, movement, errors, DURATION_S, FRAME_HZ)
    latency_s, clock_s = _latency_s(drawn)
    wrench = drawn.wrench_at(latency_s)
    span = window_span(drawn.geometric, wrench)
    inside, rate_hz = span.inside, span.rate_hz
    total = Wrench(wrench.force_n[inside], wrench.moment_nm[inside])
    known = momentum_of_segments_nms(drawn.geometric, inside, drawn.mass_kg, rate_hz)
    height_m = drawn.geometric.com_m[inside, 2]
    path, plain = (force_path_m(total, height_m, part, drawn.mass_kg, rate_hz) for part in (known, None))
    scores = {}
    for name, estimator in ESTIMATORS.items():
        estimate = estimator.estimate(drawn.geometric, wrench, drawn.mass_kg)
        error = estimate.com_m - drawn.com_m[inside]
        of_path = path_error(estimator, drawn.geometric, wrench, drawn.mass_kg, PlateErrors(clock_s=clock_s), seed=seed)
        scores[name] = {
            "truth": [*_mean_squares(error)[:2], float(error[:, 2].var())],
            "force residual": _mean_squares(_residual_share(estimate, wrench, drawn.mass_kg)),
            "impulse": _mean_squares(_impulse_misses(estimate, total, drawn.mass_kg, rate_hz)),
            **_withheld_scores(estimator, drawn, wrench, path, hidden=seed % HIDDEN_EVERY == 0),
            **_flight_score(estimator, drawn, wrench),
            "force path, all momentum": _mean_squares(
                distance_from_force_m(estimate.com_m, plain, total.force_n, drawn.mass_kg, rate_hz)
            ),
            "force path": of_path.distance_m2.tolist(),
            "force path, penalty": of_path.square_m2.tolist(),
        }
    return ScoredDraw(seed, movement, drawn.loaded, _mean_squares(path - drawn.com_m[inside, :2]), scores)


def _latency_s(drawn: DrawnRecording) -> tuple[float, float]:
    """Corrected latency and the standard deviation of its error; a body that stands has neither."""
    try:
        latency = estimate_latency(drawn.geometric, drawn.wrench_at, drawn.mass_kg)
    except NotEstimable:
        return 0.0, PlateErrors().clock_s
    return (latency.latency_s if latency.significant else 0.0), latency.sd_s


def _withheld_scores(
    estimator: ComEstimator,
    drawn: DrawnRecording,
    wrench: WrenchTrack,
    path: Float[np.ndarray, "n 2"],
    *,
    hidden: bool,
) -> MeanSquares:
    """Held-back force over weight, by band, and in metres; blocks of 0.15 s, and half of the window or 1 s."""
    span = window_span(drawn.geometric, wrench)
    force, rate_hz = wrench.force_n[span.inside], span.rate_hz
    blocks = {"held-back force": BLOCK_S}
    if hidden:
        blocks["one plate hidden"] = min(PLATE_S, len(force) / rate_hz / 2 + 1e-6)
    out = {}
    for label, block_s in blocks.items():
        every, slow, metres = [], [], []
        for held, estimate in withheld_estimates(estimator, drawn.geometric, wrench, drawn.mass_kg, block_s):
            residual = _residual_share(estimate, wrench, drawn.mass_kg)
            low = np.full_like(residual, np.nan)
            inner = np.isfinite(residual).all(axis=1)
            low[inner] = low_pass(residual[inner], rate_hz, SPLIT_HZ)
            every.append(residual[held])
            slow.append(low[held])
            metres.append(distance_from_force_m(estimate.com_m, path, force, drawn.mass_kg, rate_hz)[held])
        out[label] = _mean_squares(np.concatenate(every))
        out[f"{label}, metres"] = _mean_squares(np.concatenate(metres))
        if block_s == BLOCK_S:
            out[f"{label} below {SPLIT_HZ} Hz"] = _mean_squares(np.concatenate(slow))
            out[f"{label} above {SPLIT_HZ} Hz"] = _mean_squares(np.concatenate(every) - np.concatenate(slow))
    return out


def _flight_score(estimator: ComEstimator, drawn: DrawnRecording, wrench: WrenchTrack) -> MeanSquares:
    """Acceleration in flight minus g, with the force of all flights withheld; nothing without flights."""
    flight = withheld_flight(estimator, drawn.geometric, wrench, drawn.mass_kg)
    if flight is None:
        return {}
    horizontal = (flight.horizontal_m_s2 / GRAVITY_M_S2) ** 2 / 2
    return {"flights withheld": [horizontal, horizontal, flight.vertical_share**2]}


def _residual_share(estimate: ComEstimate, wrench: WrenchTrack, mass_kg: float) -> Points:
    return force_residual_track_n(estimate, wrench, mass_kg) / (mass_kg * GRAVITY_M_S2)


def _impulse_misses(estimate: ComEstimate, total: Wrench, mass_kg: float, rate_hz: float) -> Points:
    """Change of the velocity over ``IMPULSE_S`` minus the impulse over the mass, in m/s."""
    n = round(IMPULSE_S * rate_hz)
    gained = np.cumsum(com_acceleration(total.force_n, mass_kg), axis=0) / rate_hz
    return np.asarray((estimate.velocity_m_s - gained)[n:] - (estimate.velocity_m_s - gained)[:-n])


def _mean_squares(x: Float[np.ndarray, "n k"]) -> list[float]:
    return [float(v) for v in np.nanmean(x**2, axis=0)]


@dataclass(frozen=True)
class Agreement:
    """Agreement of one score with the truth: over single draws, and over groups of them.

    ``rank_correlation`` is Spearman's, mean over the draws. ``pairs`` is the share of pairs of estimators in single
    draws in the order of the truth (NaN without pairs), ``same_order`` the share of groups with all pairs so; ties are
    left out of both. ``same_best`` is the share of groups whose best estimator by the score is within the tie of the
    truly best.
    """

    score: str
    draws: int
    rank_correlation: float
    pairs: float
    same_order: Mapping[int, float]
    same_best: Mapping[int, float]


GROUPS: Final = (1, 5, 10, 20, 40)
RESAMPLES: Final = 1000


def score_agreement(draws: Sequence[ScoredDraw], score: str, axes: Sequence[int]) -> Agreement:
    """Agreement over the sum of ``axes``, of the draws that have the score; groups are drawn with replacement."""
    draws = [draw for draw in draws if all(score in of_one for of_one in draw.scores.values())]
    true, scored = (
        np.array([[sum(s[key][axis] for axis in axes) for s in draw.scores.values()] for draw in draws])
        for key in ("truth", score)
    )
    rng = np.random.default_rng(0)
    order, best = {}, {}
    for size in GROUPS:
        members = np.arange(len(draws))[:, None] if size == 1 else rng.integers(0, len(draws), (RESAMPLES, size))
        a, b = true[members].mean(axis=1), scored[members].mean(axis=1)
        right, counted = _pairs_in_order(a, b)
        order[size] = float(np.mean(right.sum(axis=1) == counted.sum(axis=1)))
        chosen = a[np.arange(len(a)), b.argmin(axis=1)]
        best[size] = float(np.mean(chosen <= a.min(axis=1) * (1 + TIED)))
    right, counted = _pairs_in_order(true, scored)
    ranks = [stats.spearmanr(a, b)[0] for a, b in zip(true, scored, strict=True)]
    pairs = float(right.sum() / counted.sum()) if counted.any() else float("nan")
    return Agreement(score, len(draws), float(np.mean(ranks)), pairs, order, best)


def _pairs_in_order(
    true: Float[np.ndarray, "n k"], scored: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, "n pairs"], Float[np.ndarray, "n pairs"]]:
    """Per pair of estimators, whether both agree and whether the pair counts, as 0 and 1."""
    i, j = np.triu_indices(true.shape[1], 1)
    counted = np.abs(np.log(true[:, i] / true[:, j])) > np.log(1 + TIED)
    agree = (true[:, i] < true[:, j]) == (scored[:, i] < scored[:, j])
    return (agree & counted).astype(float), counted.astype(float)
