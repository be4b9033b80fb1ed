"""Scores by what an estimator was not given, on drawn people, and their means over people by hand."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from experiments.people.movements import Movement
from experiments.people.sensors import draw_recording
from stridelab.body.geometric_com import GeometricCom
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.evaluation.physics_residuals import assess_flight
from stridelab.estimation.evaluation.unseen_scores import (
    SCORES,
    ScoredInputs,
    ScoreRow,
    hidden_plate_m2,
    mean_scores,
    movement_of,
    score_estimator,
    withheld_flight,
)
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.recordings.recording import WrenchTrack

METHODS = ("geometry", "smoother")


@dataclass(frozen=True)
class Displaced:
    """The geometry, moved aside, with a stated standard deviation."""

    aside_m: float
    sd_m: float
    name: ClassVar[str] = "displaced"

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        result = GeometryOnly().estimate(geometric, wrench, mass_kg)
        moved = result.com_m + np.array([self.aside_m, self.aside_m, 0.0])
        return replace(result, com_m=moved, sd_m=np.full_like(result.sd_m, self.sd_m))


def inputs(movement: Movement, seed: int = 3) -> ScoredInputs:
    """A drawn person over two plates, which carry the body in turn for half a second each."""
    drawn = draw_recording(seed, movement, None, 2.0, 100.0)
    wrench = drawn.wrench_at(0.0)
    first = (wrench.time_s // 0.5).astype(int) % 2 == 0
    return ScoredInputs(
        geometric=drawn.geometric, wrench=wrench, mass_kg=drawn.mass_kg, plate_loaded=np.array([first, ~first])
    )


@pytest.mark.parametrize(("movement", "expected"), [("walk", "grounded"), ("run", "airborne"), ("stand", "standing")])
def test_movement_follows_from_flight_and_speed(movement: Movement, expected: str) -> None:
    assert movement_of(inputs(movement)) == expected


def test_a_hidden_plate_does_not_affect_the_geometry() -> None:
    """Then both halves together are the distance over the whole window, by a mean of two halves of it."""
    walk = inputs("walk")
    hidden = hidden_plate_m2(GeometryOnly(), walk)
    everything = score_estimator(GeometryOnly(), walk)
    assert hidden is not None
    assert hidden[:2] == pytest.approx([everything["force_path_along"], everything["force_path_lateral"]], rel=0.15)
    one_plate = replace(walk, plate_loaded=np.ones((1, len(walk.wrench.time_s)), dtype=bool))
    assert hidden_plate_m2(GeometryOnly(), one_plate) is None
    assert "hidden_plate_along" not in score_estimator(GeometryOnly(), one_plate)


def test_a_displacement_adds_its_square_and_a_band_covers_as_it_states() -> None:
    walk = inputs("walk")
    plain, aside = (score_estimator(Displaced(aside_m, 0.0), walk) for aside_m in (0.0, 0.3))
    for axis in ("along", "lateral"):
        assert aside[f"force_path_{axis}"] - plain[f"force_path_{axis}"] == pytest.approx(0.09, abs=0.02)
        assert aside[f"band_coverage_{axis}"] == 0.0
        assert score_estimator(Displaced(0.0, 1.0), walk)[f"band_coverage_{axis}"] == 1.0
    assert aside["force_path_vertical"] == plain["force_path_vertical"]


def test_flights_are_withheld_from_an_estimator_that_uses_them() -> None:
    run = inputs("run")
    given = ComplementaryFilter().estimate(run.geometric, run.wrench, run.mass_kg)
    free_fall, hidden = assess_flight(given, run.wrench), withheld_flight(ComplementaryFilter(), *data(run))
    assert free_fall is not None
    assert hidden is not None
    assert abs(hidden.vertical_share) > 2 * abs(free_fall.vertical_share)
    assert withheld_flight(GeometryOnly(), *data(inputs("walk"))) is None


def data(given: ScoredInputs) -> tuple[GeometricCom, WrenchTrack, float]:
    return given.geometric, given.wrench, given.mass_kg


def test_standing_has_the_centre_of_pressure_and_a_walk_has_not() -> None:
    assert "standing_offset" not in score_estimator(GeometryOnly(), inputs("walk"))
    near, aside = (score_estimator(Displaced(aside_m, 0.0), inputs("stand")) for aside_m in (0.0, 0.1))
    assert np.sqrt(aside["standing_offset"]) - np.sqrt(near["standing_offset"]) == pytest.approx(0.1414, abs=0.03)


def row(person: str, geometry: float, smoother: float | None, score: str = "force_path_along") -> ScoreRow:
    values = {"geometry": geometry} | ({} if smoother is None else {"smoother": smoother})
    return ScoreRow(person, "grounded", {score: values})


def test_means_count_people_not_recordings() -> None:
    rows = [row("a", 4.0, 1.0), row("a", 8.0, 1.0), row("b", 3.0, 7.0), row("c", 100.0, None)]
    (column,) = mean_scores(rows, METHODS)
    assert (column.people, column.recordings, column.unmatched) == (2, 3, 1)
    assert column.means["geometry"].value == pytest.approx(np.sqrt((6.0 + 3.0) / 2))
    assert column.means["smoother"].value == pytest.approx(np.sqrt((1.0 + 7.0) / 2))
    assert column.means["geometry"].over_best == pytest.approx(np.sqrt(4.5 / 4.0))
    assert column.means["smoother"].over_best == 1.0
    assert column.means["geometry"].ci95 is None  # two people


def test_intervals_are_those_of_a_bootstrap_over_people() -> None:
    """Of n people the bootstrap variance of a mean is that of the sample over n."""
    rng = np.random.default_rng(1)
    values = rng.uniform(0.2, 0.9, 30)
    rows = [row(f"p{k}", v, v, "band_coverage_along") for k, v in enumerate(values)]
    (column,) = mean_scores(rows, METHODS, seed=5)
    mean = column.means["smoother"]
    assert mean.ci95 is not None
    half = 1.96 * values.std() / np.sqrt(30)
    assert mean.ci95 == pytest.approx((values.mean() - half, values.mean() + half), abs=0.1 * half + 0.01)
    assert mean.over_best is None


def test_columns_are_apart_by_movement_and_in_the_order_of_the_scores() -> None:
    standing = ScoreRow("a", "standing", {"force_path_lateral": {"geometry": 1.0, "smoother": 1.0}})
    columns = mean_scores([row("a", 1.0, 1.0, "hidden_plate_along"), row("a", 1.0, 1.0), standing], METHODS)
    assert [(c.movement, c.score) for c in columns] == [
        ("standing", "force_path_lateral"),
        ("grounded", "force_path_along"),
        ("grounded", "hidden_plate_along"),
    ]
    assert set(SCORES) >= {c.score for c in columns}
