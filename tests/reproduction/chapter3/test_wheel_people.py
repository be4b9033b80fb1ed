"""The rolling wheel on real adults: every step counts, and what the walker cannot witness is judged on people."""

from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import NotFound
from stridelab.reproduction.chapter3 import wheel_people
from stridelab.reproduction.claims import Claim
from stridelab.reproduction.registry import ITEMS, reproduce_item

ADULTS = ("2014001", "2014015", "2014019", "2014022")
"""As many as a correlation needs."""


@pytest.fixture(scope="module")
def claims(gait: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Claim]:
    folder = tmp_path_factory.mktemp("gait")
    (folder / "rehazenter-adult-walking").mkdir()
    for person in ADULTS:
        (folder / "rehazenter-adult-walking" / person).symlink_to(
            (gait / "rehazenter-adult-walking" / person).resolve()
        )
    result = wheel_people.run(folder, lambda _fraction, _message: None)
    assert result.tables["speeds"]["people"].tolist() == [4, 4]
    assert result.tables["speeds"]["steps"].tolist() == [8, 8], "two steps each, also that beside the plates"
    return {claim.key: claim for claim in result.claims}


def test_every_claim_says_that_it_is_about_people_and_how_many(claims: dict[str, Claim]) -> None:
    assert {claim.evidence for claim in claims.values()} == {"people"}
    assert claims["below_1_mm"].n == 4
    assert claims["radii_sd_m"].n == 8
    assert claims["over_pendulum"].n == 16


def test_the_existing_models_are_pendula(claims: dict[str, Claim]) -> None:
    claim = claims["over_pendulum"]
    assert claim.comparator == "inverted pendulum"
    assert claim.verdict == "met"
    assert 0.01 < claim.ours < 0.1


def test_a_correlation_of_few_people_has_its_interval(claims: dict[str, Claim]) -> None:
    for letter, printed in (("R", 0.67), ("r", 0.61)):
        claim = claims[f"{letter}_height_r"]
        assert claim.interval is not None
        low, high = claim.interval
        assert low < claim.ours < high
        assert (claim.verdict == "met") == (low <= printed <= high)
    assert claims["z0_height_r"].ours > 0.8


def test_the_spread_is_that_of_the_steps_of_one_trial(gait: Path) -> None:
    path = next((gait / "rehazenter-adult-walking" / ADULTS[0]).glob("*_C4_*.c3d"))
    walk = wheel_people.fit_walk(wheel_people.RecordedWalk.from_file(path))
    one, other = (fit.path.wheel.R_m for fit in walk.fits)
    assert walk.spread_m("R_m") == pytest.approx(abs(one - other) / np.sqrt(2.0))
    assert sum(fit.step.measured for fit in walk.fits) == 1


def test_a_p_of_some_size_is_not_a_p_of_0_83() -> None:
    """r = -0.24 among 50 is nearly significant, and met nothing."""
    rng = np.random.default_rng(0)
    heights = rng.normal(1.7, 0.1, 50)
    steps = [(f"p{k}", height, float(rng.normal(-2.5 * height, 1.0))) for k, height in enumerate(heights)]
    people = [wheel_people.Person(name=name, group="adults", height_m=height) for name, height, _ in steps]
    rows = [
        wheel_people.StepRow(name, name, {"omega_rad_s": omega, "R_m": 0.2, "r_m": 0.02, "z0_m": 1.0})
        for name, _, omega in steps
    ]
    pair = next(
        pair
        for pair in wheel_people.study(people, rows).pairs
        if (pair.parameter, pair.against) == ("omega_rad_s", "height_m")
    )
    claim = wheel_people._omega_claim(pair)
    assert claim.ours < 0.83
    assert claim.verdict == "not_met"


def test_a_simulated_population_gives_no_verdict_on_people() -> None:
    for name in ("fig-3.6", "fig-3.7", "fig-3.8", "fig-3.9"):
        result = reproduce_item(name, None, lambda _fraction, _message: None)
        assert all(claim.aim and claim.n == ITEMS[name].default_seeds for claim in result.claims)


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match="no recording"):
        wheel_people.run(tmp_path, lambda _fraction, _message: None)
