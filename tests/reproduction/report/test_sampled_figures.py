"""What verdicts of sampled figures stand on beyond their records: seeds, missing crossings, stated sizes."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.estimation.complementary.transfer_functions import THESIS_LOW_HZ
from stridelab.reproduction.chapter2 import fig_2_5
from stridelab.reproduction.chapter3 import fig_3_10
from stridelab.reproduction.chapter3.people_parameter_claims import correlation_claim, omega_claim
from stridelab.reproduction.chapter4 import fig_4_5
from stridelab.reproduction.claims import format_three_digits
from stridelab.reproduction.common import simulated_people
from stridelab.reproduction.common.simulated_people import HEIGHT_M
from stridelab.reproduction.registry import reproduce_item
from stridelab.walking.population.population import PARAMETERS, Person, StepRow, study

BOOK = Path(__file__).parents[3] / "docs" / "reproduction.md"


def silent(_fraction: float, _message: str) -> None:
    pass


def test_other_seeds_are_other_people(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose steps are not looked at: all have those of one of them."""
    steps = simulated_people._simulate_and_fit(HEIGHT_M["male"][0], "male", 1.2, 8)
    monkeypatch.setattr(simulated_people, "_simulate_and_fit", lambda *_: steps)
    one, other = (
        simulated_people.simulated_people(seeds, silent).population.subjects for seeds in (range(8, 10), range(9, 11))
    )
    heights = [np.array([subject.value("height_m") for subject in people]) for people in (one, other)]
    assert (np.abs(heights[0] - heights[1]) > 1e-6).all()
    for values in heights:
        assert np.abs(values - HEIGHT_M["male"][0]).max() < 5.0 * HEIGHT_M["male"][1]


def test_a_step_without_a_crossing_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    found = iter([np.array([-0.06, np.nan]), *[np.array([-0.06, 0.05])] * 5])
    monkeypatch.setattr(fig_3_10, "_prediction_errors_s", lambda _steps, _fit: next(found))
    monkeypatch.setattr(fig_3_10, "_height_at_crossings_m", lambda _steps, _fit, _errors: 0.001)
    claims = {claim.key: claim for claim in reproduce_item("fig-3.10", None, silent).claims}
    assert claims["double_pair"].ours == pytest.approx(5.0 / 6.0)
    assert claims["double_pair"].outcome == "aim_missed"
    assert (claims["double_pair"].cases_inside, claims["double_pair"].n) == (5, 6)
    assert claims["crossing_height_m"].cases_inside == 6


def test_a_correlation_without_an_interval_can_be_anything() -> None:
    people = [Person(name=f"p{k}", group="adults", height_m=1.6 + 0.02 * k) for k in range(8)]
    values = np.random.default_rng(0).normal(0.2, 0.05, 8).tolist()
    rows = [StepRow(p.name, p.name, dict.fromkeys(PARAMETERS, 1.0) | {"R_m": value, "omega_rad_s": value})
            for p, value in zip(people, values, strict=True)]  # fmt: skip
    pairs = {pair.parameter: pair for pair in study(people, rows).pairs if pair.against == "height_m"}
    bare = {name: replace(pair, pearson=replace(pair.pearson, ci95=None)) for name, pair in pairs.items()}
    for claim in (correlation_claim(bare["R_m"], "R", 0.67), omega_claim(bare["omega_rad_s"])):
        assert claim.interval == (-1.0, 1.0)
        assert claim.verdict == "undecided"


def test_the_filters_are_drawn_at_the_rate_of_the_plates() -> None:
    """H3 at 100 Hz by the bilinear rule at 1 kHz: 2 fs tan(pi f / fs) in place of 2 pi f."""
    table = reproduce_item("fig-2.5", None, silent).tables["bode"]
    assert table["frequency_hz"][-1] == pytest.approx(100.0)
    assert table["frequency_hz"][0] == pytest.approx(0.01)
    warped = 2.0 * 1000.0 * np.tan(np.pi * 100.0 / 1000.0) / (2.0 * np.pi * THESIS_LOW_HZ)
    assert table["thesis_h3_gain_db"][-1] == pytest.approx(-20.0 * np.log10(1.0 + warped**2), abs=0.01)
    assert fig_2_5.RATE_HZ == 1000.0


@pytest.mark.parametrize(
    ("value", "text"),
    [(999.4, "999"), (1000.0, "1000"), (1234.0, "1234"), (-1234.0, "-1234"), (999999.0, "999999"), (1.2e6, "1.2e+06")],
)
def test_numbers_have_three_digits_and_no_exponent_up_to_a_million(value: float, text: str) -> None:
    assert format_three_digits(value) == text


def test_the_page_states_the_sample_of_figure_4_5() -> None:
    part = re.search(r"\n## fig-4\.5:.*?\n## ", BOOK.read_text(encoding="utf-8"), re.DOTALL)
    assert part is not None
    assert f"{fig_4_5.DRAWS} " in part.group()
    assert f"density of {2 * fig_4_5.DRAWS} postures" in part.group()
