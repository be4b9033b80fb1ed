"""Weights of (4.20a) and their errors on invented people: which columns, motions and people count."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem, Weights
from stridelab.errors import NotFound
from stridelab.reproduction.chapter4 import people_weights
from stridelab.reproduction.studies import inverse_control
from stridelab.reproduction.studies.inverse_control import (
    COMPARATORS,
    FAINT,
    GRID,
    THESIS,
    PredictionError,
    TermWeights,
)
from stridelab.reproduction.studies.recorded_motions import RecordedMotion
from support.reproduction_fixtures import RisingProgress

TERMS = ("com_acceleration", "momentum_rate", "likelihood", "force")


def motion_of(person: str, **parts: Any) -> Mock:
    """A motion of a person."""
    motion = Mock(spec=RecordedMotion)
    motion.person, motion.height_m = person, 0.9
    for name, part in parts.items():
        setattr(motion, name, part)
    return motion


def test_comparators_weigh_what_their_names_say() -> None:
    """A term alone has the weight that it has among equal ones, and the others none."""
    equal = COMPARATORS["equal weights"]
    assert len({getattr(equal, term) for term in TERMS}) == 1
    alone = {"accelerations alone": 0, "momentum rates alone": 1, "densities alone": 2, "forces alone": 3}
    for name, k in alone.items():
        weights = COMPARATORS[name]
        assert getattr(weights, TERMS[k]) == getattr(equal, TERMS[k]), name
        assert all(getattr(weights, term) <= FAINT for term in TERMS if term != TERMS[k]), name
    printed = (THESIS.com_acceleration, THESIS.momentum_rate, THESIS.likelihood, THESIS.surface_force)
    assert printed == (10.0, 10.0, 1.0, FAINT), "section 4.5.1"


def test_candidates_of_a_term_are_half_or_whole_decades_apart() -> None:
    """Those that leave it out aside; 1, the weight among equal ones, is a candidate of each."""
    for term in TERMS:
        decades = np.log10(sorted({getattr(weights, term) for weights in GRID if getattr(weights, term) > FAINT}))
        assert np.abs(decades).min() == pytest.approx(0.0, abs=1e-9), term
        apart = np.diff(decades)
        assert apart == pytest.approx(np.full(len(apart), apart[0] if len(apart) else 0.0)), term
        assert 2.0 * apart == pytest.approx(np.round(2.0 * apart)), term


def test_parts_of_an_error_are_those_of_their_axes() -> None:
    """Squares of 1 to 32 for centre of mass and force, ahead, left and up: sums of the part's own."""
    errors, ones = np.tile(2.0 ** np.arange(6), (2, 1)), np.ones((2, 6))
    squares = {"distance": 7.0 / 3.0, "horizontal": 3.0 / 2.0, "vertical": 4.0, "force": 56.0 / 3.0}
    for part, square in squares.items():
        assert inverse_control.error_ratio(errors, ones, part)[0] == pytest.approx(np.sqrt(square)), part


def test_errors_of_a_person_are_the_mean_of_their_motions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two motions of one person and one of another; the best candidate has the smallest mean over people."""
    squares = iter([1.0, 5.0, 3.0, 6.0, 7.0, 5.0])

    def prediction_error(_motion: object, _weights: object) -> PredictionError:
        square = next(squares)
        return PredictionError((square, 0.0, 0.0), (0.0, 0.0, 2.0 * square))

    monkeypatch.setattr(inverse_control, "prediction_error", prediction_error)
    motions, candidates = [motion_of(name) for name in "bba"], [TermWeights(), TermWeights(1.0)]
    people, errors = inverse_control.errors_of_people(motions, candidates, RisingProgress())
    assert people == ("a", "b")
    assert errors[..., 0] == pytest.approx(np.array([[7.0, 5.0], [2.0, 5.5]]))
    assert errors[..., 5] == pytest.approx(2.0 * errors[..., 0])
    assert inverse_control.best_candidate(errors) == 0, "4.5 on average, though 7 at worst"
    chosen, held_out = inverse_control.held_out_errors(errors)
    assert chosen == [0, 1], "that of the other, of two people"
    assert held_out[:, 0] == pytest.approx([7.0, 5.5])


def test_a_plan_that_does_not_converge_has_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inverse_control, "weighted", lambda *_: None)
    monkeypatch.setattr(inverse_control, "solve", lambda _: Mock(spec=CentroidalPlan, converged=False))
    error = inverse_control.prediction_error(motion_of("a", problem=None), TermWeights())
    assert len(error.com_m2) == len(error.force_share2) == 3
    assert np.isnan([*error.com_m2, *error.force_share2]).all()


def test_the_height_of_a_person_varies_within_each_motion() -> None:
    """Variances of 1 and 4 cm^2 in two motions of one person, about other means."""
    motions = [
        motion_of("b", com_m=np.array([[0.0, 0.0, 0.89], [5.0, 0.0, 0.91]])),
        motion_of("b", com_m=np.array([[0.0, 0.0, 0.98], [5.0, 3.0, 1.02]])),
        motion_of("a", com_m=np.array([[0.0, 0.0, 0.87], [5.0, 0.0, 0.93]])),
    ]
    expected = np.zeros((2, 6))
    expected[:, 2] = [9e-4, 2.5e-4]
    assert people_weights._height_spread(motions) == pytest.approx(expected)


def test_two_adults_are_enough_to_be_judged_on_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two recordings of one adult are not."""
    adults = [motion_of("a", problem=None), motion_of("b", problem=None)]
    predictions = Mock(chosen=TermWeights(), agreeing=2)
    judged: list[list[RecordedMotion]] = []

    def claims_of(_predictions: object, motions: list[RecordedMotion]) -> tuple[()]:
        judged.append(motions)
        return ()

    for name, thing in {
        "_read_motions": lambda _gait, patterns, _seed: (adults if patterns == people_weights.ADULTS else [], []),
        "errors_of_people": lambda *_: (("a", "b"), np.ones((2, 1, 6))),
        "Predictions": lambda *_: predictions,
        "_claims": claims_of,
        "render_svg": lambda *_: "",
    }.items():
        monkeypatch.setattr(people_weights, name, thing)
    for name in ("_by_hand", "_rows", "_talos_table", "_grid_table", "_panels", "_talos_plan", "solve", "weighted"):
        monkeypatch.setattr(people_weights, name, lambda *_: {})
    assert "of 2 adults at two speeds (2 recordings, 0 refused)" in people_weights.run(Path(), RisingProgress()).note
    assert judged == [adults]
    adults[1].person = "a"
    with pytest.raises(NotFound, match="two at least"):
        people_weights.run(Path(), RisingProgress())


def test_the_robot_is_weighed_by_the_height_of_its_centre_of_mass(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = Mock(spec=CentroidalProblem, com_start_m=np.array([0.1, 0.2, 0.85]))
    heights_m: list[float] = []
    plan = Mock(spec=CentroidalPlan)
    monkeypatch.setattr(people_weights, "flat_walk_problem", lambda: problem)
    monkeypatch.setattr(people_weights, "weighted", lambda _problem, height_m, _weights: heights_m.append(height_m))
    monkeypatch.setattr(people_weights, "solve", lambda _: plan)
    assert people_weights._talos_plan(Weights()) is plan
    assert heights_m == [0.85]


def test_comparators_have_the_errors_of_their_own_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    def errors_of(_motions: object, weights: list[object], _tell: object) -> tuple[SimpleNamespace, np.ndarray]:
        of = [float(list(COMPARATORS.values()).index(each)) for each in weights]
        return SimpleNamespace(), np.tile(np.array(of)[None, :, None], (3, 1, 6))

    monkeypatch.setattr(people_weights, "errors_of_people", errors_of)
    by_hand = people_weights._by_hand([])
    assert list(by_hand) == list(COMPARATORS)
    for k, errors in enumerate(by_hand.values()):
        assert errors == pytest.approx(np.full((3, 6), float(k)))
