"""Scores of estimators on recordings without a known truth, and their means over people.

Each score compares an estimate with a measurement that it was not given, or whose shared errors are accounted for:
the path of the force (``force_path``), withheld blocks of force, a hidden plate, withheld flights, and the centre of
pressure in standing. Which of them order estimators as the truth does is derived and measured in
docs/theory/judging-estimators.md. Residuals of the force that an estimator was given are no scores: following the force
makes them small.

A score is a mean square, so that it can be averaged over recordings and people, or a share of samples.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, PerAxis
from stridelab.dynamics.wrench import Wrench
from stridelab.errors import NotEstimable
from stridelab.estimation.differentiation import smoothed_derivatives, walk_frame, window_span
from stridelab.estimation.estimator import ComEstimator
from stridelab.estimation.evaluation.force_path import (
    PlateErrors,
    distance_from_force_m,
    force_path_m,
    momentum_of_segments_nms,
    path_error,
)
from stridelab.estimation.evaluation.holdout_force import BLOCK_S, withheld_estimates, withhold_samples
from stridelab.estimation.evaluation.physics_residuals import (
    FLIGHT_N,
    Flight,
    assess_flight,
    assess_standing,
    force_residual_track_n,
)
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.recordings.recording import WrenchTrack

Movement = Literal["standing", "grounded", "airborne"]
"""Standing still; moving with a foot always on a plate; with phases of flight."""
AXES: Final = ("along", "lateral", "vertical")
RESAMPLES: Final = 2000
FEWEST_PEOPLE: Final = 5
"""Fewer people give no interval."""


@dataclass(frozen=True)
class Score:
    """One score: its unit, whether the value is a mean square, and whether it orders estimators as the truth does."""

    unit: Literal["m", "1"]
    is_square: bool = True
    orders: bool = False


SCORES: Final[Mapping[str, Score]] = {
    "force_path_along": Score("m", orders=True),
    "force_path_lateral": Score("m"),
    "force_path_vertical": Score("m", orders=True),
    "hidden_plate_along": Score("m", orders=True),
    "hidden_plate_lateral": Score("m"),
    "standing_offset": Score("m", orders=True),
    "held_back_force_along": Score("1"),
    "held_back_force_lateral": Score("1"),
    "held_back_force_vertical": Score("1"),
    "withheld_flight_vertical": Score("1"),
    "band_coverage_along": Score("1", is_square=False),
    "band_coverage_lateral": Score("1", is_square=False),
}
"""All scores in the order of the table. Forces and accelerations are shares of body weight and of g."""


@dataclass(frozen=True, kw_only=True)
class ScoredInputs:
    """What the estimators receive, and what the scores need besides.

    ``plate_loaded`` states for every plate and sample of the wrench whether the plate carries force; ``clock_s`` is the
    standard deviation of the corrected latency, ``floor_height_m`` the height of the plates.
    """

    geometric: GeometricCom
    wrench: WrenchTrack
    mass_kg: float
    plate_loaded: Bool[np.ndarray, "plates n"]
    clock_s: float = PlateErrors().clock_s
    floor_height_m: float = 0.0


def movement_of(inputs: ScoredInputs) -> Movement:
    """Movement in the window of a recording. Raises as the geometric estimator does."""
    geometry = GeometryOnly().estimate(inputs.geometric, inputs.wrench, inputs.mass_kg)
    if assess_standing(geometry, inputs.geometric, inputs.wrench, inputs.floor_height_m) is not None:
        return "standing"
    return "airborne" if assess_flight(geometry, inputs.wrench) is not None else "grounded"


def score_estimator(estimator: ComEstimator, inputs: ScoredInputs) -> dict[str, float]:
    """Scores of one estimator by name; those that do not apply are absent. Raises as the estimator does."""
    geometric, wrench, mass_kg = inputs.geometric, inputs.wrench, inputs.mass_kg
    judged = path_error(estimator, geometric, wrench, mass_kg, PlateErrors(clock_s=inputs.clock_s))
    scores = {f"force_path_{axis}": float(v) for axis, v in zip(AXES, judged.square_m2, strict=True)}
    coverage = zip(AXES[:2], judged.coverage_95, strict=False)
    scores |= {f"band_coverage_{axis}": float(v) for axis, v in coverage}
    hidden = hidden_plate_m2(estimator, inputs)
    if hidden is not None:
        scores |= {f"hidden_plate_{axis}": float(v) for axis, v in zip(AXES[:2], hidden, strict=False)}
    held_back = _held_back_shares(estimator, inputs)
    if held_back is not None:
        scores |= {f"held_back_force_{axis}": float(v) for axis, v in zip(AXES, held_back, strict=True)}
    flight = withheld_flight(estimator, geometric, wrench, mass_kg)
    if flight is not None:
        scores["withheld_flight_vertical"] = flight.vertical_share**2
    estimate = estimator.estimate(geometric, wrench, mass_kg)
    standing = assess_standing(estimate, geometric, wrench, inputs.floor_height_m)
    if standing is not None:
        scores["standing_offset"] = standing.horizontal_m**2
    return scores


def hidden_plate_m2(estimator: ComEstimator, inputs: ScoredInputs) -> PerAxis | None:
    """Mean square distance from the force path while each plate in turn is hidden; None with a single loaded plate.

    The force of every sample at which the hidden plate carries weight is withheld.
    """
    geometric, wrench, mass_kg = inputs.geometric, inputs.wrench, inputs.mass_kg
    span = window_span(geometric, wrench)
    inside, rate_hz = span.inside, span.rate_hz
    total = Wrench(wrench.force_n[inside], wrench.moment_nm[inside])
    known = momentum_of_segments_nms(geometric, inside, mass_kg, rate_hz)
    path = force_path_m(total, geometric.com_m[inside, 2], known, mass_kg, rate_hz)
    turn = walk_frame(smoothed_derivatives(geometric.com_m[span.around], rate_hz)[0])
    squares = []
    for loaded in inputs.plate_loaded[:, inside]:
        if not loaded.any() or loaded.all():
            continue
        try:
            estimate = estimator.estimate(geometric, withhold_samples(geometric, wrench, mass_kg, loaded), mass_kg)
        except NotEstimable:
            return None
        distance = distance_from_force_m(estimate.com_m, path, total.force_n, mass_kg, rate_hz)[loaded]
        squares.append(np.mean((distance @ turn.T) ** 2, axis=0))
    return np.asarray(np.mean(squares, axis=0)) if squares else None


def _held_back_shares(estimator: ComEstimator, inputs: ScoredInputs) -> PerAxis | None:
    """Mean square of the residual at withheld force over the weight; None if half of the force is not enough."""
    span = window_span(inputs.geometric, inputs.wrench)
    velocity, _ = smoothed_derivatives(inputs.geometric.com_m[span.around], span.rate_hz)
    weight_n = inputs.mass_kg * GRAVITY_M_S2
    try:
        squares = [
            (force_residual_track_n(estimate, inputs.wrench, inputs.mass_kg)[held] @ walk_frame(velocity).T) ** 2
            for held, estimate in withheld_estimates(
                estimator, inputs.geometric, inputs.wrench, inputs.mass_kg, BLOCK_S
            )
        ]
    except NotEstimable:
        return None
    return np.asarray(np.nanmean(np.concatenate(squares), axis=0) / weight_n**2)


def withheld_flight(
    estimator: ComEstimator, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float
) -> Flight | None:
    """Acceleration of the estimate in flight with the force of all flights withheld; None without a flight.

    Raises as the estimator does.
    """
    aloft = wrench.force_n[window_span(geometric, wrench).inside, 2] < FLIGHT_N
    if not aloft.any():
        return None
    withheld = withhold_samples(geometric, wrench, mass_kg, aloft)
    return assess_flight(estimator.estimate(geometric, withheld, mass_kg), wrench)


@dataclass(frozen=True)
class ScoreRow:
    """Scores of all estimators on one recording of a person: ``scores[score][method]``."""

    person: str
    movement: Movement
    scores: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class MeanScore:
    """Mean over people of one estimator; a mean square is shown as its root.

    ``ci95`` is the bootstrap interval over people, None for fewer than ``FEWEST_PEOPLE``; ``over_best`` the ratio to
    the best estimator of the column, None for a coverage.
    """

    value: float
    ci95: tuple[float, float] | None
    over_best: float | None


@dataclass(frozen=True)
class ScoreColumn:
    """One score in one movement. ``unmatched`` recordings have the score for some of the ``methods`` only; not used."""

    movement: Movement
    score: str
    people: int
    recordings: int
    unmatched: int
    means: Mapping[str, MeanScore]


def mean_scores(rows: Sequence[ScoreRow], methods: Sequence[str], seed: int = 0) -> tuple[ScoreColumn, ...]:
    """Means over people of every score by movement, of recordings in which all ``methods`` have it.

    People count equally, whatever the number of their recordings.
    """
    columns = []
    for movement in ("standing", "grounded", "airborne"):
        of_movement = [row for row in rows if row.movement == movement]
        for name, score in SCORES.items():
            having = [row for row in of_movement if row.scores.get(name)]
            matched = [row for row in having if all(method in row.scores[name] for method in methods)]
            if having:
                means = _means_over_people(matched, name, score, methods, seed)
                people = len({row.person for row in matched})
                columns.append(ScoreColumn(movement, name, people, len(matched), len(having) - len(matched), means))
    return tuple(columns)


def _means_over_people(
    rows: Sequence[ScoreRow], name: str, score: Score, methods: Sequence[str], seed: int
) -> dict[str, MeanScore]:
    people = sorted({row.person for row in rows})
    if not people:
        return {}
    own = [[row.scores[name] for row in rows if row.person == person] for person in people]
    table = np.array([[np.mean([scores[m] for scores in of_one]) for m in methods] for of_one in own])
    drawn = np.random.default_rng(seed).integers(0, len(people), (RESAMPLES, len(people)))
    means, resampled = table.mean(axis=0), table[drawn].mean(axis=1)
    if score.is_square:  # a penalised square may be negative on one person, hardly over many
        means, resampled = (np.sqrt(np.maximum(x, 0.0)) for x in (means, resampled))
    low, high = np.quantile(resampled, (0.025, 0.975), axis=0)
    best = means.min()
    comparable = score.is_square and best > 0.0
    return {
        method: MeanScore(
            float(means[k]),
            (float(low[k]), float(high[k])) if len(people) >= FEWEST_PEOPLE else None,
            float(means[k] / best) if comparable else None,
        )
        for k, method in enumerate(methods)
    }
