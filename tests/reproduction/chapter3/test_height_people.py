"""The hierarchical model of R and r: exponents that made the data are estimated, laboratories and people are units."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import NotEstimable, NotFound, UnreadableFile
from stridelab.reproduction.chapter3 import height_people
from stridelab.reproduction.chapter3.height_people import LEG_SHARE, WalkMeans, fit_hierarchy
from stridelab.reproduction.chapter3.people_walks import FittedWalk
from stridelab.reproduction.common.recorded_walks import RecordedWalk, left_out_text
from support.recorded_claims import assert_as_recorded

TAU, SIGMA = 0.03, 0.02


def simulated_walks(
    b: float, c: float, seed: int, *, people: int = 24, shift: float = 0.0, tau: float = TAU
) -> list[WalkMeans]:
    """Two walks each of adults in one laboratory and of children in another, whose values are ``shift`` larger."""
    rng = np.random.default_rng(seed)
    walks = []
    for laboratory, mean_m, raised in (("adults", 1.73, 0.0), ("children", 1.35, shift)):
        for k in range(people // 2):
            h, u = rng.normal(mean_m, 0.07), rng.normal(0.0, tau)
            for froude in np.exp(rng.normal(np.log([0.2, 0.35]), 0.15)):
                v = float(np.sqrt(froude * GRAVITY_M_S2 * LEG_SHARE * h))
                noise = rng.normal(0.0, SIGMA, 2)
                scale = np.exp(raised + u) * (h / 1.73) ** b * froude**c
                values = {"R": 0.1 * scale * np.exp(noise[0]), "r": 0.02 * scale * np.exp(noise[1])}
                walks.append(WalkMeans(laboratory, f"{laboratory}{k}", h, v, values))
    return walks


@pytest.fixture(autouse=True)
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(height_people, "DRAWS", 60)


def test_the_exponents_that_made_the_walks_lie_in_their_intervals() -> None:
    held = {0: 0, 1: 0}
    for seed in range(6):
        hierarchy = fit_hierarchy(simulated_walks(1.0, 0.25, seed), "R")
        for column, truth in ((0, 1.0), (1, 0.25)):
            low, high = hierarchy.exponent_interval(column)
            held[column] += low <= truth <= high
    assert min(held.values()) >= 5, "of six"


def test_what_differs_between_laboratories_is_no_effect_of_the_height() -> None:
    """Children of the other laboratory have values 30 % larger; a model without laboratories would see b near 0."""
    plain, shifted = (fit_hierarchy(simulated_walks(1.0, 0.25, 3, shift=shift), "R") for shift in (0.0, 0.3))
    assert shifted.model.effect("height").value == pytest.approx(plain.model.effect("height").value, abs=1e-6)


def test_predicted_coefficients_follow_the_exponent_and_the_scatter_between_people() -> None:
    none = fit_hierarchy(simulated_walks(0.0, 0.0, 1, people=60), "R")
    alike = fit_hierarchy(simulated_walks(1.0, 0.0, 1, people=60, tau=0.005), "R")
    assert abs(float(np.median(none.predicted_r))) < 0.2
    assert float(np.median(alike.predicted_r)) > 0.7
    between = fit_hierarchy(simulated_walks(1.0, 0.0, 1, people=60, tau=0.02), "R")
    assert max(none.two_sided_probability, alike.two_sided_probability) < 0.1 < between.two_sided_probability, (
        "0.67 lies between both"
    )


def test_too_few_adults_are_refused(tmp_path: Path) -> None:
    children = [walk for walk in simulated_walks(1.0, 0.2, 0) if walk.laboratory == "children"]
    with pytest.raises(NotEstimable) as error:
        fit_hierarchy(children, "R")
    assert error.value.code == "no-adults"
    with pytest.raises(NotFound) as missing:
        height_people.run(tmp_path, lambda _share, _text: None)
    assert missing.value.code == "recordings-missing"


@pytest.mark.parametrize(("rare_refits", "verdict"), [(116, "undecided"), (168, "met"), (60, "not_met")])
def test_the_refits_leave_the_probability_of_a_coefficient_open(rare_refits: int, verdict: str) -> None:
    """Of 2000 refits some have half of their coefficients on the side where the printed one is rare."""
    fitted = fit_hierarchy(simulated_walks(1.0, 0.2, 0), "R")
    for side in (1.0, -1.0):
        predicted = np.full((2000, 2), 0.67 - 0.01 * side)
        predicted[:rare_refits, 0] = 0.67 + 0.01 * side
        hierarchy = replace(fitted, refits=np.zeros((2000, 4)), predicted_r=predicted)
        assert hierarchy.two_sided_probability == pytest.approx(rare_refits / 2000)
        share = rare_refits / 2000
        half = 1.96 * np.sqrt(share * (1.0 - share) / 1999)
        assert hierarchy.probability_interval == pytest.approx((share - half, share + half))
        _, claim = height_people._claims(hierarchy, [], 0)
        assert (claim.verdict, claim.interval) == (verdict, hierarchy.probability_interval)
        assert claim.note.endswith("Its interval is that of 2000 refits.")


def test_another_seed_draws_other_people() -> None:
    walks = simulated_walks(1.0, 0.2, 0)
    first, again, other = (fit_hierarchy(walks, "R", seed) for seed in (0, 0, 1))
    assert (first.predicted_r == again.predicted_r).all()
    assert (first.predicted_r != other.predicted_r).any()
    assert first.predicted_r.shape == (60, height_people.PREDICTIONS)


def test_what_verdicts_on_invented_people_stand_on_is_as_recorded() -> None:
    """The thesis' words need an exponent above zero; its number, to be possible among sixteen people."""
    for letter in height_people.LETTERS:
        walks = simulated_walks(1.2, 0.2, 5)
        hierarchy = fit_hierarchy(walks, letter)
        assert_as_recorded(f"height-people, {letter} of invented people", height_people._claims(hierarchy, walks, 24))


def fitted_walk(
    turn_deg: float = 0.0, *, steps: int = 2, height_m: float | None = 1.7, heading_deg: float = 0.0
) -> Any:
    """Two steps at 1.2 m/s that begin with a heading and end ``turn_deg`` to its left, with double support.

    Before and after them the person stands still, in all directions.
    """
    t = np.round(np.arange(-1.0, 3.5, 0.01), 9)
    heading = np.radians(heading_deg + turn_deg * (t >= 1.0))
    velocity = 1.2 * np.column_stack([np.cos(heading), np.sin(heading), 0.0 * t])
    velocity[(t < 0.0) | (t > 2.0)] = [-0.3, 0.4, 0.1]
    wheels = [SimpleNamespace(R_m=0.10, r_m=0.02), SimpleNamespace(R_m=0.14, r_m=0.03)][:steps]
    fits = tuple(
        SimpleNamespace(
            path=SimpleNamespace(wheel=wheel),
            step=SimpleNamespace(start_s=float(k), end_s=k + 1.0, strike_s=k + 0.8, next_lift_off_s=k + 0.9),
        )
        for k, wheel in enumerate(wheels)
    )
    estimate = SimpleNamespace(time_s=t, velocity_m_s=velocity)
    walk = Mock(spec=FittedWalk)
    walk.fits, walk.height_m, walk.estimate, walk.ahead = fits, height_m, estimate, np.array([1.0, 0.0, 0.0])
    walk.person = "a"
    return walk


def test_a_walk_is_the_mean_of_its_steps() -> None:
    walk = height_people.walk_means(fitted_walk(), "lab")
    assert (walk.laboratory, walk.person, walk.height_m) == ("lab", "a", 1.7)
    assert walk.speed_m_s == pytest.approx(1.2)
    assert walk.values_m == pytest.approx({"R": 0.12, "r": 0.025})
    leg_m = 0.53 * 1.7
    assert walk.froude_number == pytest.approx(1.2**2 / (9.81 * leg_m), rel=1e-3)
    turned = height_people.walk_means(fitted_walk(14.0), "lab")
    expected = (100.0 + 101.0 * np.cos(np.radians(14.0))) / 201.0
    assert turned.speed_m_s == pytest.approx(1.2 * expected), "along the whole walk, both ends included"


@pytest.mark.parametrize("heading_deg", [0.0, 50.0, 90.0, 140.0, -130.0])
def test_a_turn_is_that_between_both_halves_whatever_the_heading(heading_deg: float) -> None:
    """A straight walk across the laboratory turns by nothing; 14 degrees are straight, 16 are not."""
    for turn_deg in (0.0, 14.0, -14.0):
        height_people.walk_means(fitted_walk(turn_deg, heading_deg=heading_deg), "lab")
    for turn_deg in (16.0, -16.0, 90.0, 170.0):
        with pytest.raises(NotEstimable, match=f"by {abs(turn_deg):.0f} degrees"):
            height_people.walk_means(fitted_walk(turn_deg, heading_deg=heading_deg), "lab")


def test_a_walk_that_sways_is_straight() -> None:
    """Each half goes to both sides, by up to 30 degrees, and ahead on average."""
    walk = fitted_walk()
    walk.estimate.velocity_m_s[:, 1] = 0.7 * np.sin(2.0 * np.pi * walk.estimate.time_s) * (walk.estimate.time_s < 0.99)
    walk.estimate.velocity_m_s[:, 0] *= 1.0 + 0.5 * np.cos(2.0 * np.pi * walk.estimate.time_s)
    assert height_people.walk_means(walk, "lab").speed_m_s == pytest.approx(1.2, rel=0.01)


def test_what_is_no_straight_walk_of_a_known_person_is_refused() -> None:
    run = fitted_walk()
    run.fits[1].step.strike_s = run.fits[1].step.next_lift_off_s
    cases = {"not-straight": fitted_walk(-16.0), "no-whole-step": fitted_walk(steps=0),
             "no-stature": fitted_walk(height_m=None), "no-double-support": run}  # fmt: skip
    for code, walk in cases.items():
        with pytest.raises(NotEstimable) as error:
            height_people.walk_means(walk, "lab")
        assert error.value.code == code


def test_unreadable_recordings_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lab" / "p1").mkdir(parents=True)
    (tmp_path / "lab" / "p1" / "walk.c3d").touch()

    def refuse(_path: Path, _folder: Path) -> None:
        raise UnreadableFile("truncated-file", "The file is truncated.")

    monkeypatch.setattr(RecordedWalk, "from_file", refuse)
    _, counted, unreadable = height_people.collect_walks(tmp_path, lambda _share, _text: None)
    assert counted == {"truncated-file": 1}
    assert left_out_text(unreadable) == " Left out: p1/walk.c3d (The file is truncated)."


def test_recordings_without_a_walk_are_counted_by_their_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a/p1/walk1.c3d", "a/p1/walk2.c3d", "a/p1/Static01.c3d", "b/p2/walk1.c3d"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    tried: list[str] = []

    def refuse(path: Path, folder: Path) -> None:
        tried.append(f"{folder.name}/{path.name}")
        raise NotEstimable("not-straight" if path.name == "walk1.c3d" else "no-stature", "It turns.")

    monkeypatch.setattr(RecordedWalk, "from_file", refuse)
    counted = {"not-straight": 2, "no-stature": 1}
    assert height_people.collect_walks(tmp_path, lambda _share, _text: None) == ([], counted, [])
    assert tried == ["p1/walk1.c3d", "p1/walk2.c3d", "p2/walk1.c3d"], "who stands does not walk"
