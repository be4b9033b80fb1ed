"""Chapter 3 on real adults: every step counts, and what the simulated walker cannot witness is judged on people."""

import re
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from scipy import stats

from stridelab.errors import NotFound
from stridelab.reproduction.chapter3 import people_path_claims, people_walks
from stridelab.reproduction.chapter3.people_figures import PEOPLE_ITEMS
from stridelab.reproduction.chapter3.people_parameter_claims import OMEGA_R, correlation_claim, omega_claim
from stridelab.reproduction.chapter3.people_walks import (
    FittedWalk,
    fit_walk,
    fitted_walks,
    pooled_spread,
)
from stridelab.reproduction.claims import Claim
from stridelab.reproduction.common.intervals import interval_of
from stridelab.reproduction.common.recorded_walks import RecordedWalk
from stridelab.reproduction.registry import ITEMS
from stridelab.reproduction.result_cache import digest_of
from stridelab.reproduction.runner import recipes_of
from stridelab.walking.population.correlations import two_sided_p
from stridelab.walking.population.population import PARAMETERS, Pair, Person, StepRow, study
from support.recorded_claims import assert_as_recorded, assert_steps_as_recorded, assert_tables_as_recorded
from support.recorded_steps import recorded_steps
from support.recordings.walks import cut_recording, link_adults
from support.reproduction_fixtures import RisingProgress

BOOK = Path(__file__).parents[3] / "docs" / "reproduction.md"
ADULTS = ("2014001", "2014015", "2014019", "2014022")
"""As many as a correlation needs."""


def silent(_fraction: float, _message: str) -> None:
    pass


@pytest.fixture(scope="module")
def folder(gait: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four adults, and a fifth one whose recording is cut."""
    folder = link_adults(gait, ADULTS, tmp_path_factory.mktemp("gait"))
    cut_recording(gait, folder, people_walks.SPEEDS["fast"])
    return folder


@pytest.fixture(scope="module")
def claims(folder: Path) -> dict[tuple[str, str], Claim]:
    by_item: dict[tuple[str, str], Claim] = {}
    for item in PEOPLE_ITEMS:
        with recorded_steps() as steps:
            result = item.run(folder, RisingProgress())
        assert_steps_as_recorded(item.name, steps)
        assert result.tables["people"]["people"].tolist() == [4, 4]
        assert result.tables["people"]["steps"].tolist() == [8, 8], "two steps each, also that beside the plates"
        assert "10.6084/m9.figshare.7734767" in result.note, "where the recordings are published"
        assert re.search(r"Left out: cut/2014001_C5_\w+\.c3d \(.*ends in the middle of its frames\)", result.note), (
            "not the whole item fails"
        )
        assert_tables_as_recorded(item.name, result.tables)
        by_item |= {(item.name, claim.key): claim for claim in result.claims}
    return by_item


@pytest.fixture(scope="module")
def walk(gait: Path) -> FittedWalk:
    path = next((gait / "rehazenter-adult-walking" / ADULTS[0]).glob("*_C4_*.c3d"))
    return fit_walk(RecordedWalk.from_file(path))


def test_every_figure_of_chapter_3_has_an_item_on_people() -> None:
    simulated = [name for name in ITEMS if name.startswith(("fig-3", "numbers-3"))]
    assert {item.name for item in PEOPLE_ITEMS} == {f"{name}-people" for name in simulated}


def test_forty_claims_of_the_thesis_in_the_book_stand_on_people_and_all_figures_of_chapter_3_have_one() -> None:
    parts = BOOK.read_text(encoding="utf-8").split("\n## ")[1:]
    rows = {part.partition(":")[0]: re.findall(r"^\| .* \| people, n = .*$", part, re.MULTILINE) for part in parts}
    of_thesis = {name: [row for row in of if " | ours | " not in row] for name, of in rows.items()}
    assert sum(map(len, of_thesis.values())) >= 40
    for item in PEOPLE_ITEMS:
        assert len(rows[item.name]) >= 3, item.name
    assert all(of_thesis[item.name] for item in PEOPLE_ITEMS)


def test_every_claim_says_that_it_is_about_people_and_how_many(claims: dict[tuple[str, str], Claim]) -> None:
    assert {claim.evidence for claim in claims.values()} == {"people"}
    assert len(claims) == 55
    assert claims["fig-3.6-people", "below_1_mm"].n == 4
    assert claims["fig-3.4-people", "events_s"].n == 32
    assert all((claim.n or 0) >= 4 for claim in claims.values())


@pytest.mark.parametrize("name", [item.name for item in PEOPLE_ITEMS])
def test_what_verdicts_on_four_people_stand_on_is_as_recorded(claims: dict[tuple[str, str], Claim], name: str) -> None:
    assert_as_recorded(name, [claim for (item, _), claim in claims.items() if item == name])


def test_the_thresholds_are_those_that_the_thesis_prints(claims: dict[tuple[str, str], Claim]) -> None:
    printed = {
        ("fig-3.5-people", "comfortable_largest_m"): 0.0015,
        ("fig-3.6-people", "comfortable_mean_mm"): 3.5,
        ("fig-3.6-people", "comfortable_sd_mm"): 1.5,
        ("fig-3.7-people", "comfortable_R_sd_m"): 0.005,
        ("fig-3.7-people", "comfortable_r_sd_m"): 0.005,
        ("fig-3.8-people", "comfortable_z0_sd_m"): 0.002,
        ("numbers-3-people", "over_pendulum"): 0.1,
        ("numbers-3-people", "comfortable_distance_mm"): 2.0,
    }
    for key, bound in printed.items():
        assert (claims[key].holds_to, claims[key].threshold, claims[key].thesis) == (bound, "thesis", bound), key
        assert not claims[key].aim


def test_what_is_said_of_a_fast_speed_is_none_of_the_thesis(claims: dict[tuple[str, str], Claim]) -> None:
    """Its people walk at their normal speed; bounds and words are the same."""
    fast = {key: claim for key, claim in claims.items() if key[1].startswith("fast_")}
    assert len(fast) == 21
    for (item, name), claim in fast.items():
        assert (claim.aim, claim.threshold, claim.where) == (True, "ours", ""), name
        assert str(claim.thesis).startswith("aim ")
        assert claim.holds_to == claims[item, name.replace("fast_", "comfortable_")].holds_to


def test_the_existing_models_are_pendula(claims: dict[tuple[str, str], Claim]) -> None:
    claim = claims["numbers-3-people", "over_pendulum"]
    assert claim.comparator == "inverted pendulum"
    assert claim.verdict == "met"
    assert 0.01 < claim.ours < 0.1


def test_the_spread_is_that_of_the_steps_of_one_trial(walk: FittedWalk) -> None:
    one, other = (fit.path.wheel.R_m for fit in walk.fits)
    assert walk.spread_m("R_m") == pytest.approx(abs(one - other) / np.sqrt(2.0))
    assert sum(fit.step.measured for fit in walk.fits) == 1
    assert walk.geometric_spread_m("R_m") == pytest.approx(walk.spread_m("R_m"), abs=0.003)


def test_pairs_of_steps_are_pooled_with_the_interval_of_a_variance() -> None:
    pooled_m, (low_m, high_m) = pooled_spread([0.003, float("nan"), 0.004])
    assert pooled_m == pytest.approx(np.sqrt((0.003**2 + 0.004**2) / 2.0))
    assert stats.chi2.sf(2.0 * (pooled_m / low_m) ** 2, 2) == pytest.approx(0.025)
    assert stats.chi2.cdf(2.0 * (pooled_m / high_m) ** 2, 2) == pytest.approx(0.025)


def test_an_interval_is_over_people() -> None:
    values = np.random.default_rng(3).normal(5.0, 2.0, 40)
    interval = interval_of(values)
    assert interval is not None
    low, high = interval
    assert (low + high) / 2.0 == pytest.approx(values.mean(), abs=0.1)
    assert high - low == pytest.approx(2.0 * 1.96 * values.std() / np.sqrt(40.0), rel=0.1)
    assert interval_of([1.0, 1.0, 1.0]) == (1.0, 1.0)
    assert interval_of([1.0]) is None, "one person says nothing about others"


def test_the_convex_part_is_where_the_height_accelerates_upwards(walk: FittedWalk) -> None:
    """Another way: the sign of the estimate's own vertical acceleration."""
    fit = next(fit for fit in walk.fits if fit.step.measured)
    inside = (walk.estimate.time_s >= fit.step.start_s) & (walk.estimate.time_s <= fit.step.end_s)
    advance = np.gradient(walk.estimate.com_m[inside] @ walk.ahead)
    up = walk.estimate.acceleration_m_s2[inside, 2] > 0.0
    assert walk.convex_share() == pytest.approx(advance[up].sum() / advance.sum(), abs=0.04)


def test_the_convex_part_of_the_curve_bends_upwards(walk: FittedWalk) -> None:
    """By differences of the curve itself."""
    fit = next(fit for fit in walk.fits if fit.step.measured)
    x, z = fit.path.wheel.position_m(np.linspace(fit.path.theta_rad[0], fit.path.theta_rad[-1], 4000)).T
    up = np.gradient(np.gradient(z, x), x) > 0.0
    assert walk.curve_convex_share() == pytest.approx(np.diff(x)[up[1:]].sum() / (x[-1] - x[0]), abs=0.02)


def test_a_curve_that_passes_through_its_step_predicts_as_well_as_the_step(walk: FittedWalk) -> None:
    exact = replace(walk, fits=tuple(
        replace(fit, path_m=fit.path.wheel.position_m(fit.path.theta_rad)) for fit in walk.fits
    ))  # fmt: skip
    assert exact.prediction_error_m() == pytest.approx(exact.height_variability_m())
    assert exact.curve_variability_m() == pytest.approx(exact.height_variability_m())
    assert walk.curve_variability_m() == pytest.approx(exact.curve_variability_m())
    assert abs(walk.prediction_error_m() / exact.prediction_error_m() - 1.0) > 0.001


def test_crossings_are_counted_from_the_start_and_end_of_double_support(walk: FittedWalk) -> None:
    ((start_s, end_s, double_s),) = walk.double_support_errors_s()
    fit = walk.fits[0]
    assert double_s == pytest.approx(np.diff(fit.step.double_support_s)[0])
    crossings = [fit.step.strike_s + start_s, fit.step.next_lift_off_s + end_s]
    heights = np.interp(crossings, walk.estimate.time_s, walk.estimate.com_m[:, 2])
    assert heights == pytest.approx(np.full(2, fit.path.wheel.z0_m), abs=0.006)


def pairs_of(slope: float, people: int) -> dict[str, Pair]:
    rng = np.random.default_rng(0)
    heights = rng.normal(1.7, 0.1, people)
    names = [f"p{k}" for k in range(people)]
    rows = [
        StepRow(name, name, dict.fromkeys(PARAMETERS, 1.0) | {"R_m": float(rng.normal(slope * height, 0.1))}
                | {"omega_rad_s": float(rng.normal(0.0, 1.0)), "r_m": height, "z0_m": height})
        for name, height in zip(names, heights, strict=True)
    ]  # fmt: skip
    group = [Person(name=name, group="adults", height_m=height) for name, height in zip(names, heights, strict=True)]
    return {pair.parameter: pair for pair in study(group, rows).pairs if pair.against == "height_m"}


def test_a_correlation_of_few_people_decides_nothing() -> None:
    few, many = (correlation_claim(pairs_of(0.7, n)["R_m"], "R", 0.67) for n in (8, 60))
    assert few.interval is not None
    assert few.interval[0] < 0.0 < few.interval[1]
    assert (few.verdict, many.verdict) == ("undecided", "met")
    assert correlation_claim(pairs_of(-3.0, 60)["R_m"], "R", 0.67).verdict == "not_met"


def test_a_weak_correlation_is_that_whose_p_the_thesis_prints() -> None:
    assert two_sided_p(OMEGA_R, 14) == pytest.approx(0.83, abs=0.005)
    claim = omega_claim(pairs_of(0.0, 50)["omega_rad_s"])
    assert claim.verdict == "undecided", "50 people cannot tell 0.058 from 0.2"


def test_walks_of_a_folder_are_fitted_once(folder: Path) -> None:
    assert fitted_walks(folder) is fitted_walks(folder)
    walks, left_out = fitted_walks(folder)
    assert set(walks) == set(people_walks.SPEEDS)
    assert [each.file.partition("/")[0] for each in left_out] == ["cut"]


def test_other_recordings_are_computed_anew(tmp_path: Path) -> None:
    """A result on some people is none on others, even where the code is the same."""
    digests = []
    for person in ("one", "two"):
        (tmp_path / "gait" / person).mkdir(parents=True)
        (tmp_path / "gait" / person / "a_C4_1.c3d").write_bytes(b"walk")
        digests += [recipe.source_digest for recipe in recipes_of(["fig-3.6-people"], None, tmp_path)]
    again = recipes_of(["fig-3.6-people", "fig-2.5"], None, tmp_path)
    assert digests[0] != digests[1] == again[0].source_digest
    assert again[1].source_digest == digest_of(again[1].module), "what draws only is computed from no recordings"


def test_three_people_give_all_but_correlations(gait: Path, tmp_path: Path) -> None:
    """Too few people for one claim are no reason to refuse the others."""
    folder = link_adults(gait, ADULTS[:3], tmp_path)
    for item in PEOPLE_ITEMS:
        result = item.run(folder, silent)
        correlated = item.name in ("fig-3.7-people", "fig-3.8-people", "fig-3.9-people")
        assert ("needs 4 people, there are 3" in result.note) == correlated, item.name
        assert {claim.verdict for claim in result.claims} == {"undecided"}, item.name
        assert "4 are needed and 3 are here" in result.note
        assert not any(claim.key.endswith("_height_r") for claim in result.claims)
        assert len(result.claims) >= 2, item.name


def test_one_speed_gives_what_does_not_compare_both(gait: Path, tmp_path: Path) -> None:
    for path in link_adults(gait, ADULTS, tmp_path).glob(people_walks.SPEEDS["fast"]):
        assert path.is_symlink(), "not the recording itself"
        path.unlink()
    for item in PEOPLE_ITEMS:
        result = item.run(tmp_path, silent)
        assert result.tables["people"]["speed"].tolist() == ["comfortable"], item.name
        assert len(result.claims) >= 1, item.name
        assert not any(claim.key.endswith("_change_m") for claim in result.claims)
        assert all(np.isfinite(claim.ours) for claim in result.claims), item.name


def test_recordings_that_all_are_cut_are_refused_by_name(gait: Path, tmp_path: Path) -> None:
    cut = cut_recording(gait, tmp_path, people_walks.SPEEDS["comfortable"])
    with pytest.raises(NotFound, match=rf"Left out: cut/{cut.name} \(.*ends in the middle"):
        PEOPLE_ITEMS[0].run(tmp_path, silent)


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match="no recording"):
        PEOPLE_ITEMS[0].run(tmp_path, silent)


def invented_walk(person: str, measured_mm: tuple[float, float], all_mm: tuple[float, float]) -> FittedWalk:
    """A walk whose mean and standard deviation of the distance are these, with measured steps alone and with all."""
    walk = Mock(spec=FittedWalk, person=person)
    walk.distance_mm.side_effect = lambda *, measured: measured_mm if measured else all_mm
    return walk


def test_people_are_counted_on_both_sides_of_the_printed_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mean below 1 mm and a deviation below 0.5 mm are good; 3.5, 1.5 and again 1.5 mm are bounds of every person."""
    measured_mm = ((0.9, 0.4), (1.1, 0.2), (0.8, 0.6), (0.95, 0.45))
    all_mm = ((3.4, 1.4), (3.6, 1.0), (0.9, 0.4), (2.0, 1.6))
    of = [invented_walk(f"p{k}", *both) for k, both in enumerate(zip(measured_mm, all_mm, strict=True))]
    walks = {"comfortable": of, "fast": of[:2]}
    claims = {claim.key: claim for claim in people_path_claims.distance_claims(walks)}
    good = claims["below_1_mm"]
    assert good.ours == 2.0 / 4.0
    assert "2 of 4 at a comfortable speed with all force on plates" in good.note
    assert "1 of 4 at a comfortable speed with all steps" in good.note
    assert "1 of 2 at a fast speed with all force on plates, 0 of 2 at a fast speed with all steps." in good.note
    assert (claims["comfortable_mean_mm"].ours, claims["comfortable_mean_mm"].cases_inside) == (3.6, 3)
    assert (claims["comfortable_sd_mm"].ours, claims["comfortable_sd_mm"].cases_inside) == (1.6, 3)
    assert (claims["fast_mean_mm"].ours, claims["fast_mean_mm"].cases_inside) == (3.6, 1)
    assert_as_recorded("distances of invented people", claims.values())
    largest_m = dict(zip(of, (0.0010, 0.0014, 0.0016, 0.0018), strict=True))
    up_over_ahead = dict(zip(of, (1.1, 0.9, 2.0, 1.3), strict=True))
    monkeypatch.setattr(people_path_claims, "largest_error_m", largest_m.get)
    monkeypatch.setattr(people_path_claims, "_up_over_ahead", up_over_ahead.get)
    claims = {claim.key: claim for claim in people_path_claims.one_step_claims(walks)}
    assert "below 1.5 mm in 2 of 4." in claims["comfortable_largest_m"].note
    assert claims["comfortable_largest_m"].ours == pytest.approx(0.0015)
    assert (claims["comfortable_up"].ours, claims["comfortable_up"].cases_inside) == (0.9, 3)
    assert_as_recorded("largest errors of invented people", claims.values())
