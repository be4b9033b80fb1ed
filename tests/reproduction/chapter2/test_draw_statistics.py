"""Claims on many draws, from invented draws: one simulated draw cannot tell a mean from a maximum."""

from collections.abc import Iterator
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from stridelab.errors import NotEstimable
from stridelab.estimation.evaluation.error_spectra import ErrorSpectrum
from stridelab.estimation.evaluation.truth_errors import TruthError
from stridelab.reproduction.chapter2 import (
    fig_2_6,
    fig_2_7,
    fig_2_8,
    table_coverage,
    table_errors,
    table_flight,
    table_lag,
    table_partial_force,
)
from stridelab.reproduction.chapter2.table_partial_force import PartialForceErrors
from stridelab.reproduction.common.accepted_draws import accept_draws, own_seeds
from stridelab.reproduction.common.estimator_errors import Draw, horizontal_ratio
from stridelab.reproduction.common.estimators import GEOMETRY, KALMAN, NAMES, SMOOTHER, THESIS
from stridelab.reproduction.common.intervals import interval_of, resampled_interval, rms_ratio, share_interval
from stridelab.reproduction.registry import reproduce_item
from stridelab.reproduction.studies.estimator_study import StudyTrial
from stridelab.simulation.noise import NoisePreset
from support.recorded_claims import assert_as_recorded
from support.reproduction_fixtures import RisingProgress

N = 5


def invented_error(rng: np.random.Generator) -> TruthError:
    x, y, z, mean = rng.uniform(0.002, 0.01, 4)
    rms = np.array([x, y, z])
    return TruthError(
        float(np.hypot(x, y)), float(z), 2.0 * float(x), rms, np.array([0.0, 0.0, mean]), rng.uniform(0.9, 1.0, 3),
        rng.uniform(0.8, 1.5) * rms, rng.uniform(-0.002, 0.003, 3),
    )  # fmt: skip


def invented_draws() -> Iterator[Draw]:
    rng = np.random.default_rng(8)
    for noise in ("thesis", "white"):
        for _ in range(N):
            errors = {name: invented_error(rng) for name in NAMES}
            noisy = dict(zip(NAMES, rng.uniform(0.001, 0.003, len(NAMES)).tolist(), strict=True))
            yield Draw("robot", noise, errors, noisy, float(rng.uniform(0.7, 1.0)))


DRAWS = list(invented_draws())
NOISY = [draw for draw in DRAWS if draw.noise == "thesis"]


def test_an_interval_of_draws_is_that_of_their_scatter() -> None:
    """The mean of n numbers has the standard error s / sqrt(n); one number has none."""
    values = np.random.default_rng(2).normal(3.0, 0.5, 100)
    interval = resampled_interval(lambda chosen: float(values[chosen].mean()), len(values))
    assert interval is not None
    assert np.subtract(*interval[::-1]) == pytest.approx(2 * 1.96 * values.std() / 10.0, rel=0.1)
    assert np.mean(interval) == pytest.approx(values.mean(), abs=0.02)
    assert resampled_interval(lambda _: 0.0, 1) is None
    assert resampled_interval(lambda _: 0.0, 2) == (0.0, 0.0)


def test_an_interval_of_a_share_is_that_of_the_binomial_test() -> None:
    """Without a counted case the upper end is 1 - 0.025^(1/n); elsewhere as scipy's exact test has it."""
    for count, n in ((0, 50), (1, 11), (27, 38), (11, 11)):
        assert share_interval(count, n) == pytest.approx(tuple(binomtest(count, n).proportion_ci(method="exact")))
    assert share_interval(0, 11)[1] == pytest.approx(1.0 - 0.025 ** (1.0 / 11.0))


def test_all_intervals_are_of_one_bootstrap() -> None:
    """A mean, a ratio and a statistic of the chosen cases draw the same samples."""
    values = np.random.default_rng(4).normal(2.0, 0.3, 11)
    by_hand = resampled_interval(lambda chosen: float(np.mean([values[k] for k in chosen])), len(values))
    assert interval_of(values) == pytest.approx(by_hand)
    _, interval = rms_ratio(values**2, np.ones(11))
    assert interval == pytest.approx(interval_of(values, lambda drawn: float(np.sqrt((drawn**2).mean()))))
    assert interval_of(values, np.median) != interval_of(values)
    assert interval_of([3.0]) is None


def test_ratios_are_those_of_root_mean_squares_over_all_draws() -> None:
    claims = {claim.key: claim for claim in table_errors._gait_claims("robot", DRAWS)}
    ours, base = (np.array([d.errors[name].horizontal_m for d in NOISY]) for name in (SMOOTHER, THESIS))
    by_hand = np.sqrt((ours**2).mean() / (base**2).mean())
    assert claims["robot_smoother_over_filter"].ours == pytest.approx(by_hand)
    assert horizontal_ratio(NOISY, SMOOTHER, THESIS) == pytest.approx(by_hand)
    assert_as_recorded("errors of invented draws", claims.values())


def test_the_filter_is_compared_with_the_kalman_filter_draw_by_draw() -> None:
    claims = {claim.key: claim for claim in fig_2_7._gait_claims("robot", NOISY)}
    not_worse = [d.errors[THESIS].horizontal_m <= d.errors[KALMAN].horizontal_m for d in NOISY]
    assert 0 < sum(not_worse) < N, "else it says nothing"
    assert claims["robot_trials_not_worse"].ours == pytest.approx(sum(not_worse) / N)
    assert claims["robot_samples_not_worse"].ours == pytest.approx(np.mean([d.share_closer for d in NOISY]))
    ours, base = (np.array([d.errors[name].vertical_m for d in NOISY]) for name in (THESIS, GEOMETRY))
    assert claims["robot_height_over_geometry"].ours == pytest.approx(np.sqrt((ours**2).mean() / (base**2).mean()))
    assert_as_recorded("figure 2.7 of invented draws", claims.values())


def test_spectra_are_averaged_before_bands_are_compared() -> None:
    rng = np.random.default_rng(3)
    f = np.arange(0.0, 100.0, 0.125)
    shape = {"geometry": 1.0 / (0.1 + f) + 0.02 * f, "force": f**2, "axis": 1.0 / (0.3 + f)}
    noisy = [
        {name: ErrorSpectrum(f, rng.uniform(0.5, 2.0, (1, 3)) * s[:, None] * rng.uniform(0.8, 1.2, (len(f), 3)))
         for name, s in shape.items()}
        for _ in range(3)
    ]  # fmt: skip
    clean = ErrorSpectrum(f, 0.6 * np.tile(shape["axis"][:, None], (1, 3)))
    assert_as_recorded("figure 2.6 of invented spectra", fig_2_6._spectrum_claims(noisy, clean))


def test_spectra_are_those_of_all_draws_and_of_a_walk_without_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    f = np.arange(0.0, 100.0, 0.125)
    walks: list[tuple[str, int]] = []

    def error_spectra(noise: str, seed: int) -> dict[str, ErrorSpectrum]:
        walks.append((noise, seed))
        density = np.tile((1.0 / (0.1 + f) + 0.02 * f)[:, None], (1, 3))
        return dict.fromkeys(fig_2_6.INPUTS, ErrorSpectrum(f, (0.1 if noise == "none" else 1.0 + seed) * density))

    monkeypatch.setattr(fig_2_6, "_error_spectra", error_spectra)
    table = reproduce_item("fig-2.6", 3, RisingProgress(), 4).tables["spectra"]
    assert walks == [("thesis", 4), ("thesis", 5), ("thesis", 6), ("none", 0)]
    assert table["axis_x_m_rthz"] / table["axis_without_noise_x_m_rthz"] == pytest.approx(np.full(len(f), 60.0**0.5))


def test_offsets_of_figure_2_8_are_compared_with_the_bias_of_their_draw() -> None:
    rng = np.random.default_rng(5)
    bias = rng.normal(0.0, 0.006, (N, 3))
    aligned = -bias * [0.7, 0.8, 0.1] + rng.normal(0.0, 0.0003, (N, 3))
    late, corrected = aligned - [0.02, 0.0, 0.0], aligned + rng.normal(0.0, 0.0002, (N, 3))
    latencies_s = fig_2_8.LATENCY_S + rng.normal(0.0, 0.001, N)
    claims = {claim.key: claim for claim in fig_2_8._offset_claims(aligned, late, corrected, bias, latencies_s)}
    left = np.linalg.norm((bias + aligned)[:, :2]) / np.linalg.norm(bias[:, :2])
    assert claims["bias_left"].ours == pytest.approx(left)
    assert claims["latency_error_s"].ours == pytest.approx(np.abs(latencies_s - fig_2_8.LATENCY_S).max())
    assert claims["shift_left_m"].ours == pytest.approx(np.sqrt(np.mean((corrected - aligned)[:, 0] ** 2)))
    assert "by -20.0 mm" in claims["bias_left"].note
    assert_as_recorded("figure 2.8 of invented draws", claims.values())


def test_an_offset_of_equal_size_along_all_axes_is_not_especially_horizontal() -> None:
    offsets = 0.004 * np.sign(np.random.default_rng(9).normal(size=(40, 3)))
    claims = fig_2_8._offset_claims(offsets, offsets, offsets, -offsets, np.full(40, fig_2_8.LATENCY_S))
    assert claims[0].key == "horizontal_over_vertical"
    assert claims[0].ours == pytest.approx(1.0)


def test_lags_are_medians_of_the_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_lag, "_estimator_lag_s", lambda *_: np.zeros(3))
    monkeypatch.setattr(table_lag, "simulate_trial", lambda *_: None)
    causes = {"as in the thesis": 0.03, "axis through the CoM": 0.01, "both removed": -0.0004}
    claims = {claim.key: claim for claim in table_lag._gait_claims("robot", NOISY, causes)}
    lags_s = np.array([d.errors[SMOOTHER].lag_s for d in NOISY])
    assert claims["robot_smoother_s"].ours == pytest.approx(np.abs(np.median(lags_s, axis=0)[:2]).max())
    assert claims["robot_kalman_unexplained_s"].ours == pytest.approx(0.0004)
    assert_as_recorded("lags of invented draws", claims.values())


def test_coverage_is_the_mean_share_and_the_width_that_of_root_mean_squares() -> None:
    errors = [draw.errors[SMOOTHER] for draw in NOISY]
    summary = table_coverage._coverage_summary(errors)
    assert summary["coverage_y"] == pytest.approx(np.mean([e.coverage[1] for e in errors]))
    widths, misses = (np.sqrt(np.mean([getattr(e, of)[2] ** 2 for e in errors])) for of in ("sd_m", "rms_m"))
    assert summary["ratio_z"] == pytest.approx(widths / misses)
    assert summary["rms_z_m"] == pytest.approx(misses)
    claims = table_coverage._coverage_claims("human", table_coverage.SCENARIOS[2], errors)
    assert [claim.key for claim in claims] == ["human_table-40_x", "human_table-40_y"]
    assert_as_recorded("coverage of invented draws", claims)


def test_the_height_is_judged_by_its_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten tables along a walk of two samples: four inside the band, two half of the time, four outside."""
    bias_m = [(0.01, -0.02)] * 4 + [(0.01, 0.05)] * 2 + [(0.05, -0.05)] * 4
    drawn: list[float] = []

    def simulate_trial(_gait: str, noise: NoisePreset, seed: int) -> Mock:
        drawn.append(noise.mass_model)
        geometric = Mock(sd_m=(1.0, 1.0, 0.02))
        return Mock(spec=StudyTrial, bias_m=np.array([(0.0, 0.0, z) for z in bias_m[seed - 20]]), geometric=geometric)

    monkeypatch.setattr(table_coverage, "simulate_trial", simulate_trial)
    claim = table_coverage._table_band_claim(0.4, range(20, 30))
    assert claim.ours == pytest.approx(0.5)
    assert claim.interval == interval_of([1.0] * 4 + [0.5] * 2 + [0.0] * 4)
    assert (claim.key, claim.n, claim.holds_from, claim.outcome) == ("table_40_z", 10, 0.9, "aim_missed")
    assert set(drawn) == {0.4}
    errors = [Mock(spec=TruthError, rms_m=np.array([1.0, 2.0, 0.03])) for _ in range(10)]
    height = table_coverage._height_error_claim("human", range(20, 30), errors)
    assert height.ours == pytest.approx(0.03 / np.sqrt(np.mean(np.square(bias_m))))
    assert height.interval is not None
    assert height.interval[0] < height.ours < height.interval[1]


@given(st.integers(0, 5000), st.integers(1, 200), st.integers(1, 20))
def test_more_draws_than_seeds_are_those_of_no_other_seed(first: int, n: int, per_seed: int) -> None:
    own = [own_seeds(range(seed, seed + 1), per_seed) for seed in range(first, first + n)]
    assert {len(draws) for draws in own} == {per_seed}
    whole = own_seeds(range(first, first + n), per_seed)
    assert [seed for draws in own for seed in draws] == list(whole)


def test_errors_with_a_second_of_force_are_pooled_over_samples() -> None:
    rng = np.random.default_rng(6)
    parts = [
        PartialForceErrors(np.abs(rng.normal(0.0, 0.004, 50)), rng.uniform(0.001, 0.004, 3),
                           np.abs(rng.normal(0.0, 0.006, 40)), invented_error(rng))
        for _ in range(3)
    ]  # fmt: skip
    inside = np.concatenate([part.with_force_m for part in parts])
    claims = {claim.key: claim for claim in table_partial_force._gait_claims("human", parts)}
    assert claims["human_horizontal_m"].ours == pytest.approx(np.sqrt((inside**2).mean()))
    assert (inside <= claims["human_95_m"].ours).mean() == pytest.approx(0.95, abs=0.01)
    assert_as_recorded("partial force of invented draws", claims.values())


def test_flight_is_judged_by_the_root_mean_square_of_its_draws() -> None:
    shares = [0.01, -0.02, 0.03, -0.015]
    claim = table_flight._smoother_claim("thesis", shares)
    assert claim.ours == pytest.approx(np.sqrt(np.mean(np.square(shares))))
    assert (claim.verdict, claim.outcome) == ("undecided", "aim_undecided"), "the aim of 2 % is in the interval"
    larger = table_flight._smoother_claim("thesis", [2.5 * share for share in shares])
    assert (larger.verdict, larger.outcome) == ("not_met", "aim_missed")
    assert "3.00 %" in claim.note, "the worst draw has the larger size, whatever its sign"
    assert_as_recorded("flight of invented draws", [claim])


def test_reports_of_a_bias_are_counted_with_and_without_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forty draws: a bias is reported in thirty of them, and in eight where there is none."""
    trials = {seed: Mock(spec=StudyTrial, seed=seed, mass_kg=90.0) for seed in range(40)}
    directions: list[np.ndarray] = []

    def with_bias(trial: StudyTrial, direction: np.ndarray) -> StudyTrial:
        directions.append(direction)
        return Mock(spec=StudyTrial, seed=trial.seed, mass_kg=1000.0)

    monkeypatch.setattr(table_coverage, "simulate_trial", lambda _gait, _noise, seed: trials[seed])
    monkeypatch.setattr(table_coverage, "with_force_bias", with_bias)
    monkeypatch.setattr(
        table_coverage, "_reports_bias", lambda trial: trial.seed < (30 if trial.mass_kg == 1000.0 else 8)
    )
    claims = {claim.key: claim for claim in table_coverage._bias_detection_claims("human", range(40))}
    flagged, false = claims["human_flagged"], claims["human_false_alarms"]
    assert (flagged.ours, false.ours) == (30 / 40, 8 / 40)
    assert (flagged.interval, false.interval) == (share_interval(30, 40), share_interval(8, 40))
    assert (flagged.holds_from, false.holds_to) == (0.95, 0.05)
    assert (flagged.outcome, false.outcome) == ("aim_missed", "aim_missed")
    assert np.linalg.norm(directions, axis=1) == pytest.approx(np.ones(40))
    assert len(np.unique(np.round(directions, 6), axis=0)) == 40, "another direction in every draw"
    assert np.abs(np.array(directions)[:, 2]).max() == 0.0


def test_windows_that_are_too_short_are_counted_by_their_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    reasons = {0: "window-too-short", 1: "no-single-support", 2: None, 3: "window-too-short"}
    drawn: list[tuple[float, float]] = []

    def excerpt(_gait: str, _noise: str, seed: int, attempt: int, force_s: tuple[float, float]) -> int:
        assert attempt == 0
        drawn.append(force_s)
        return seed

    monkeypatch.setattr(table_partial_force, "_random_excerpt", excerpt)
    monkeypatch.setattr(table_partial_force, "_rejection_code", lambda seed: reasons[seed])
    claim = table_partial_force._short_window_claim("robot", range(4))
    assert claim.ours == 0.5
    assert (claim.cases_inside, claim.interval) == (2, None)
    assert claim.outcome == "aim_missed"
    assert {round(end - start, 6) for start, end in drawn} == {0.35}


def test_a_draw_that_allows_no_estimate_is_counted_and_named() -> None:
    def root_of(seed: int) -> float:
        if seed in (3, 5):
            raise NotEstimable("no-root", "It has none.")
        return float(np.sqrt(seed))

    progress: list[tuple[float, str]] = []
    draws = accept_draws(range(2, 7), root_of, lambda fraction, message: progress.append((fraction, message)))
    assert draws.results == {2: np.sqrt(2.0), 4: 2.0, 6: np.sqrt(6.0)}
    assert draws.describe_refused() == " 3 of 5 draws accepted, refused: seed 3, 5 (It has none: 2)."
    assert progress == [(k / 5, f"draw {k + 1} of 5") for k in range(5)]
    one = accept_draws((3, 4), root_of, ignore_progress)
    assert one.describe_refused() == " 1 of 2 draws accepted, refused: seed 3 (It has none)."
    assert accept_draws((4,), root_of, ignore_progress).describe_refused() == ""
    with pytest.raises(NotEstimable, match=r"Only 1 of 3 draws allow an estimate: It has none: 2\.") as error:
        accept_draws((3, 4, 5), root_of, ignore_progress)
    assert error.value.code == "too-few-draws"
    with pytest.raises(ZeroDivisionError):
        accept_draws((1,), lambda _: 1 // 0, ignore_progress)


def ignore_progress(_fraction: float, _message: str) -> None:
    return None


def test_a_table_that_is_far_off_still_has_a_delay() -> None:
    """The paths of markers and force of this draw have a correlation of 0.79."""
    assert fig_2_8._compare_clocks(2009).latency_s == pytest.approx(fig_2_8.LATENCY_S, abs=0.001)


def test_a_walk_whose_delay_is_unclear_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    compare_clocks = fig_2_8._compare_clocks

    def refuse_one(seed: int) -> fig_2_8._Compared:
        if seed == 7:
            raise NotEstimable("latency-unclear", "Too little motion.")
        return compare_clocks(seed)

    monkeypatch.setattr(fig_2_8, "_compare_clocks", refuse_one)
    result = reproduce_item("fig-2.8", 3, ignore_progress, 7)
    assert {claim.n for claim in result.claims} == {2}
    assert result.tables["offsets"]["draw"].tolist() == [8, 9]
    assert result.note.endswith(" 2 of 3 draws accepted, refused: seed 7 (Too little motion).")


@pytest.mark.parametrize("refused", ["marker-like", "thesis"])
def test_a_run_without_flight_leaves_the_others(monkeypatch: pytest.MonkeyPatch, refused: str) -> None:
    def flights_of_draw(noise: str, seed: int) -> dict[str, table_flight._Flight]:
        if (noise, seed) == (refused, 4):
            raise NotEstimable("no-flight", "Too short.")
        return {name: table_flight._Flight((0.01 * seed, 0.1), (0.001, 0.002)) for name in NAMES}

    monkeypatch.setattr(table_flight, "_flights_of_draw", flights_of_draw)
    result = reproduce_item("flight", 3, ignore_progress, 3)
    other = "thesis" if refused == "marker-like" else "marker-like"
    assert {claim.key: claim.n for claim in result.claims} == {f"{refused}_smoother": 2, f"{other}_smoother": 3}
    mean = {claim.key: claim.ours for claim in result.claims}
    assert mean[f"{refused}_smoother"] == pytest.approx(0.01 * np.sqrt((3**2 + 5**2) / 2))
    assert f"With {refused} noise: 2 of 3 draws accepted, refused: seed 4 (Too short)." in result.note
    assert other not in result.note


def test_fifty_excerpts_without_a_single_support_are_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first that is accepted counts, with the number of those before it."""
    codes: list[str | None] = ["no-single-support"] * 49 + [None]
    attempts: list[int] = []

    def excerpt(_gait: str, _noise: str, _seed: int, attempt: int, _force_s: tuple[float, float]) -> Mock:
        attempts.append(attempt)
        return Mock(spec=StudyTrial, seed=attempt)

    monkeypatch.setattr(table_partial_force, "_random_excerpt", excerpt)
    monkeypatch.setattr(table_partial_force, "_rejection_code", lambda trial: codes[trial.seed])
    trial, rejected = table_partial_force.excerpt_with_single_support("human", "invented", 1)
    assert trial.seed == rejected == 49
    codes[-1] = "no-single-support"
    attempts.clear()
    with pytest.raises(NotEstimable, match="None of 50 excerpts"):
        table_partial_force.excerpt_with_single_support("human", "invented", 2)
    assert attempts == list(range(50))
