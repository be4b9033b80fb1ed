"""The hierarchical model of R and r: exponents that made the data are estimated, laboratories and people are units."""

from pathlib import Path

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import NotEstimable, NotFound
from stridelab.reproduction.chapter3 import height_people
from stridelab.reproduction.chapter3.height_people import LEG_SHARE, WalkMeans, fit_hierarchy
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


def test_what_verdicts_on_invented_people_stand_on_is_as_recorded() -> None:
    """The thesis' words need an exponent above zero; its number, to be possible among sixteen people."""
    for letter in height_people.LETTERS:
        walks = simulated_walks(1.2, 0.2, 5)
        hierarchy = fit_hierarchy(walks, letter)
        assert_as_recorded(f"height-people, {letter} of invented people", height_people._claims(hierarchy, walks, 24))


def test_recordings_without_a_walk_are_counted_by_their_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a/p1/walk1.c3d", "a/p1/walk2.c3d", "a/p1/Static01.c3d", "b/p2/walk1.c3d"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    tried: list[str] = []

    def refuse(path: Path, folder: Path) -> None:
        tried.append(f"{folder.name}/{path.name}")
        raise NotEstimable("not-straight" if path.name == "walk1.c3d" else "no-stature", "It turns.")

    monkeypatch.setattr(height_people.RecordedWalk, "from_file", refuse)
    assert height_people.collect_walks(tmp_path, lambda _share, _text: None) == (
        [],
        {"not-straight": 2, "no-stature": 1},
    )
    assert tried == ["p1/walk1.c3d", "p1/walk2.c3d", "p2/walk1.c3d"], "who stands does not walk"
