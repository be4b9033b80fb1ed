"""Chapter 3 on invented people and steps that lie on both sides of what no recording comes near."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import NotEstimable
from stridelab.estimation.estimator import ComEstimate
from stridelab.reproduction.chapter3 import (
    fig_3_3,
    height_people,
    numbers,
    people_parameter_claims,
    people_path_claims,
    people_walks,
)
from stridelab.reproduction.chapter3.height_people import Hierarchy, WalkMeans
from stridelab.reproduction.chapter3.people_walks import FittedWalk
from stridelab.reproduction.common import simulated_people
from stridelab.reproduction.common.recorded_walks import RecordedWalk
from stridelab.walking.population.mixed_model import MixedModel
from stridelab.walking.population.population import Population
from stridelab.walking.step_fit import StepFit


def invented_fit(**parts: Any) -> Mock:
    """A fitted step with these parts."""
    fit = Mock(spec=StepFit)
    for name, part in parts.items():
        setattr(fit, name, part)
    return fit


def wheel_of(R_m: float, r_m: float) -> SimpleNamespace:
    """A fitted path with this wheel."""
    return SimpleNamespace(wheel=SimpleNamespace(R_m=R_m, r_m=r_m))


def invented_walk(person: str, *fits: Mock, **others: Any) -> Mock:
    """A walk of a person with these steps."""
    walk = Mock(spec=FittedWalk)
    walk.person, walk.fits = person, fits
    for name, part in others.items():
        setattr(walk, name, part)
    return walk


def test_a_person_is_curtate_if_all_steps_at_both_speeds_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """r over R of three people: 0.3 and 0.2, 0.4 and 1.1, and 1.2 at one speed alone."""
    monkeypatch.setattr(people_path_claims, "mean_claim", lambda *_: [])
    ratios = {"comfortable": {"a": (0.3, 0.1), "b": (0.4,), "c": (1.2,)}, "fast": {"a": (0.2,), "b": (0.5, 1.1)}}
    walks = {
        speed: [invented_walk(name, *(invented_fit(path=wheel_of(0.1, 0.1 * ratio)) for ratio in steps))
                for name, steps in of.items()]
        for speed, of in ratios.items()
    }  # fmt: skip
    (claim,) = people_path_claims.shape_claims(walks)
    assert claim.ours == pytest.approx(1.2)
    assert (claim.cases_inside, claim.verdict) == (1, "not_met")


def test_successive_steps_change_by_the_mean_of_their_differences() -> None:
    """Of three numbers, 1, 2 and 4: 1.5 over 7/3; a single step has no change."""
    steps = [invented_fit(step=SimpleNamespace(end_s=end_s)) for end_s in (1.0, 2.0, 4.0)]
    three, one = (
        people_path_claims._relative_change(invented_walk("a", *of), lambda fit: fit.step.end_s)
        for of in (steps, steps[:1])
    )
    assert three == pytest.approx(1.5 / (7.0 / 3.0))
    assert np.isnan(one)


def test_the_largest_error_is_that_of_all_measured_steps() -> None:
    errors_m = ((True, 0.002, 0.001), (True, 0.0005, 0.003), (False, 0.009, 0.0))
    fits = [
        invented_fit(path=SimpleNamespace(distance_m=np.array(of)), step=SimpleNamespace(measured=measured))
        for measured, *of in errors_m
    ]
    assert people_path_claims.largest_error_m(invented_walk("a", *fits)) == 0.003
    assert people_path_claims.largest_error_m(invented_walk("a", *fits[:1])) == 0.002


def test_a_pendulum_rises_by_its_arc_over_the_length_of_the_step() -> None:
    """1 m over a step of 1.2 m: 1 - sqrt(1 - 0.6^2); a step of unknown length has no rise."""
    path_m = np.column_stack([np.linspace(0.0, 1.2, 5), np.ones(5)])
    known, unknown = (invented_fit(path_m=path_m, step=SimpleNamespace(length_m=length_m)) for length_m in (1.2, None))
    assert numbers.pendulum_rise_m(known) == pytest.approx(0.2)
    assert numbers.pendulum_rise_m(unknown) == 0.0


def test_a_person_of_one_step_takes_no_claim_on_the_spread_away() -> None:
    """Of three people one has no spread; where none has one, there is no claim."""
    spreads_m = (0.003, float("nan"), 0.007)
    of = [
        invented_walk("abc"[k], spread_m=lambda _, s=s: s, geometric_spread_m=lambda _, s=s: 2.0 * s)
        for k, s in enumerate(spreads_m)
    ]
    walks = {"comfortable": of, "fast": of[1:2]}
    (claim,) = people_parameter_claims.spread_claims(walks, "R_m", "R", 0.005)
    assert claim.ours == pytest.approx(np.sqrt((0.003**2 + 0.007**2) / 2.0))
    assert "1 of 3 people are below; the largest has 7.0 mm" in claim.note
    assert f"{2e3 * claim.ours:.1f} mm." in claim.note, "by the geometry"


def test_a_change_with_the_speed_is_that_of_people_with_both() -> None:
    radii_m = {"comfortable": {"a": 0.10, "b": 0.12, "c": 0.5}, "fast": {"a": 0.11, "b": 0.15, "d": 0.9}}
    walks = {
        speed: [invented_walk(name, mean_of=lambda _, R_m=R_m: R_m) for name, R_m in of.items()]
        for speed, of in radii_m.items()
    }
    (claim,) = people_parameter_claims._speed_claims(walks, "R_m", "R", 0.005)
    assert claim.ours == pytest.approx(0.02)
    assert claim.n == 2
    assert claim.threshold == "ours", "the thesis has no bound of it"
    apart = {"comfortable": walks["comfortable"][:1], "fast": walks["fast"][1:]}
    for without_both in (apart, {"comfortable": walks["comfortable"]}, {"fast": walks["fast"]}):
        assert people_parameter_claims._speed_claims(without_both, "R_m", "R", 0.005) == []


def test_double_support_needs_both_crossings() -> None:
    """Of three steps one has no end: it counts neither for the start nor for the share of time enclosed."""
    rows = [(-0.06, 0.05, 0.1), (-0.5, float("nan"), 0.1), (-0.02, 0.07, 0.2)]
    of = [invented_walk("a", double_support_errors_s=lambda: rows), invented_walk("b", double_support_errors_s=list)]
    claims = {claim.key: claim for claim in people_parameter_claims.double_support_claims({"fast": of})}
    assert claims["fast_start_s"].ours == pytest.approx(-0.04)
    assert claims["fast_end_s"].ours == pytest.approx(0.06)
    assert claims["fast_enclosed"].ours == pytest.approx((2.1 + 1.45) / 2.0)
    assert "both crossings exist in 2 of 3 steps" in claims["fast_end_s"].note
    assert people_parameter_claims.double_support_claims({"fast": of[1:]}) == []
    halves = [invented_walk("c", double_support_errors_s=lambda: rows[1:2])]
    assert people_parameter_claims.double_support_claims({"fast": halves}) == []
    assert people_parameter_claims.start_error_ms(of[0]) == pytest.approx(-580.0 / 3.0)
    assert np.isnan(people_parameter_claims.start_error_ms(of[1]))


@pytest.mark.parametrize(("significant", "latency_s"), [(True, 0.018), (False, 0.0)])
@pytest.mark.parametrize("stated", [np.array([0.0, 1.0, 0.0]), None])
def test_a_walk_is_corrected_by_a_delay_that_is_significant(
    monkeypatch: pytest.MonkeyPatch, significant: bool, latency_s: float, stated: np.ndarray | None
) -> None:
    """Ahead is where the recording says, else where the centre of mass goes."""
    seen: dict[str, Any] = {"read": []}
    walk = Mock(spec=RecordedWalk)
    walk.recording = SimpleNamespace(markers_m={}, walking_direction=stated)
    walk.geometric, walk.windows, walk.mass_kg = None, (), 70.0
    walk.total_wrench = seen["read"].append
    estimate = Mock(spec=ComEstimate, velocity_m_s=np.tile([0.0, -1.2, 0.1], (4, 1)))

    def find_steps(*_: object, latency_s: float) -> tuple[()]:
        seen["steps"] = latency_s
        return ()

    def fit_steps(_estimate: object, _steps: object, ahead: np.ndarray, _windows: object) -> tuple[()]:
        seen["ahead"] = ahead
        return ()

    for name, thing in {
        "estimate_latency": lambda *_: SimpleNamespace(latency_s=0.018, significant=significant),
        "Smoother": lambda **_: SimpleNamespace(estimate=lambda *_: estimate),
        "identify": lambda _: SimpleNamespace(landmarks={}),
        "find_steps": find_steps,
        "fit_steps": fit_steps,
    }.items():
        monkeypatch.setattr(people_walks, name, thing)
    fitted = people_walks.fit_walk(walk)
    assert (fitted.latency_s, seen["steps"], seen["read"]) == (latency_s, latency_s, [latency_s])
    assert fitted.ahead == pytest.approx([0.0, -1.0, 0.0] if stated is None else [0.0, 1.0, 0.0])
    assert seen["ahead"] is fitted.ahead


def walks_of_heights(*heights_m: float) -> list[WalkMeans]:
    """One walk each of people in one laboratory."""
    return [WalkMeans("lab", f"p{k}", h, 1.2, {"R": 0.1, "r": 0.02}) for k, h in enumerate(heights_m)]


@pytest.fixture
def drawn_adults(monkeypatch: pytest.MonkeyPatch) -> list[list[float]]:
    """Froude numbers of the adults of each refit, where every model fits."""
    froude: list[list[float]] = []
    fits: list[int] = []

    def fit_model(groups: object, _letter: str) -> Mock:
        fits.append(0)
        assert len(fits) < 500, "no drawn people are enough"
        model = Mock(spec=MixedModel, subject_sd=0.03, step_sd=0.02)
        model.effect = lambda name: SimpleNamespace(value={"height": 1.0, "froude": 0.2}[name])
        return model

    def predicted(b: float, c: float, tau: float, sigma: float, of: list[float], _rng: object) -> np.ndarray:
        assert (b, c, tau, sigma) == (1.0, 0.2, 0.03, 0.02)
        froude.append(of)
        return np.full(2, 0.5)

    monkeypatch.setattr(height_people, "_fit_model", fit_model)
    monkeypatch.setattr(height_people, "_predicted_coefficients", predicted)
    monkeypatch.setattr(height_people, "DRAWS", 20)
    return froude


def test_three_adults_are_enough_and_are_in_every_refit(drawn_adults: list[list[float]]) -> None:
    """Children are drawn beside them, and are none; two adults are too few."""
    walks = walks_of_heights(1.5, 1.6, 1.7, 1.2, 1.3)
    hierarchy = height_people.fit_hierarchy(walks, "R")
    assert hierarchy.refits == pytest.approx(np.tile([1.0, 0.2, 0.03, 0.02], (20, 1)))
    adults = {walk.froude_number for walk in walks[:3]}
    assert len(drawn_adults) == 20
    assert all(set(of) == adults for of in drawn_adults), "all three"
    with pytest.raises(NotEstimable, match="Three adults are needed, 2 have a walk"):
        height_people.fit_hierarchy(walks_of_heights(1.49, 1.6, 1.7, 1.2), "R")


def test_a_probability_ends_at_one() -> None:
    """The printed coefficient is the median of the drawn ones."""
    drawn = np.concatenate([np.full((30, 2), 0.6), np.full((30, 2), 0.7)])
    hierarchy = Hierarchy("R", Mock(spec=MixedModel), np.zeros((60, 4)), drawn)
    assert hierarchy.two_sided_probability == 1.0
    low, high = hierarchy.probability_interval
    assert 0.7 < low < 1.0
    assert high == 1.0


def test_cycloids_are_drawn_over_two_whole_turns() -> None:
    """With the point where it is lowest at both ends and in between, and highest halfway."""
    turns = fig_3_3.THETA_RAD / (2.0 * np.pi)
    assert turns[[0, len(turns) // 2, -1]] == pytest.approx([0.0, 1.0, 2.0])
    assert np.abs(turns - 0.5).min() == pytest.approx(0.0, abs=1e-12)
    assert len(turns) % 2 == 1
    assert len(turns) // 2 >= 90, "smooth"


def test_a_quarter_of_the_simulated_people_are_women_of_ordinary_build(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the thesis (3.2.1), among sixteen; the body mass index is that of a normal weight."""
    built: list[dict[str, Any]] = []

    class Walker:
        def __init__(self, **body: Any) -> None:
            built.append(body)

        def walk(self) -> SimpleNamespace:
            return SimpleNamespace(plan=None)

    truth = SimpleNamespace(com_m=np.zeros((1, 3)), time_s=np.zeros(1))
    monkeypatch.setattr(simulated_people, "HumanWalker", Walker)
    monkeypatch.setattr(simulated_people, "record", lambda *_, **__: SimpleNamespace(truth=truth))
    monkeypatch.setattr(simulated_people, "true_steps", lambda _: ())
    monkeypatch.setattr(simulated_people, "study", lambda *_: Mock(spec=Population))
    people = simulated_people._simulate_people(range(5000, 5016))
    assert len(people.fits) == 16
    assert [body["sex"] for body in built].count("female") == 4
    for body in built:
        assert 18.5 < body["mass_kg"] / body["height_m"] ** 2 < 25.0
        assert 0.5 < body["speed_m_s"] ** 2 / (GRAVITY_M_S2 * 0.53 * body["height_m"]) / 0.175 < 2.0, "an ordinary walk"


def test_steps_are_compared_at_every_percent() -> None:
    assert people_walks.PERCENT.tolist() == pytest.approx([0.01 * k for k in range(101)])
