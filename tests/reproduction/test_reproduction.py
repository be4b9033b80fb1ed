"""What a reproduction yields: claims that can fail, tables of one length, a drawing that is an SVG."""

import re
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from itertools import product
from typing import Any, get_args
from xml.etree import ElementTree

import numpy as np
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import SolverChoice, solve
from stridelab.errors import InvalidInput, NotFound
from stridelab.reproduction import claims as kinds
from stridelab.reproduction.chapter2.table_coverage import SCENARIOS, with_force_bias
from stridelab.reproduction.chapter2.table_partial_force import excerpt_with_single_support
from stridelab.reproduction.chapter4 import fig_4_5, fig_4_8, fig_4_9, numbers, table_4_1
from stridelab.reproduction.claims import Claim, Reproduction
from stridelab.reproduction.common.estimator_errors import GAITS
from stridelab.reproduction.common.estimators import NAMES
from stridelab.reproduction.common.simulated_people import PEOPLE_PER_SEED
from stridelab.reproduction.registry import ITEMS, reproduce_item
from stridelab.reproduction.report.svg_plots import PALETTE, Bars, Curve, Panel, render_svg
from stridelab.reproduction.studies.estimator_study import simulate_trial
from stridelab.schemas.reproduction import (
    ITEMS_WITH_DRAWS,
    ITEMS_WITH_SAMPLE,
    LEAST_DRAWS,
    Evidence,
    Outcome,
    ReproductionItem,
)
from stridelab.schemas.reproduction import Verdict as ContractVerdict
from support.recorded_claims import (
    assert_as_recorded,
    assert_note_as_in_book,
    assert_steps_as_recorded,
    assert_tables_as_recorded,
)
from support.recorded_steps import Steps, recorded_steps
from support.reproduction_fixtures import RisingProgress

SVG = "{http://www.w3.org/2000/svg}"
SMALLER = ("fig-4.5",)
"""Items of whose postures the tests draw fewer than the book."""


class Found(dict[str, Reproduction]):
    """Every item is computed by the first test that asks for it: all of them are minutes of work."""

    def __init__(self) -> None:
        self.steps: dict[str, Steps] = {}

    def __missing__(self, name: str) -> Reproduction:
        with recorded_steps() as self.steps[name]:
            draws = ITEMS[name].min_seeds if ITEMS[name].draws == "many" else None
            self[name] = reproduce_item(name, draws, progress := RisingProgress())
            assert progress.share == 1.0
        return self[name]


def content(thing: Any) -> Hashable:
    """Equal for problems with equal numbers."""
    if isinstance(thing, np.ndarray):
        return thing.shape, thing.dtype.str, thing.tobytes()
    if is_dataclass(thing):
        return type(thing), tuple(content(getattr(thing, field.name)) for field in fields(thing))
    if isinstance(thing, Mapping):
        return tuple((key, content(value)) for key, value in thing.items())
    return tuple(map(content, thing)) if isinstance(thing, (tuple, list)) else thing


@pytest.fixture(scope="module")
def found() -> Iterator[Found]:
    """The items of chapter 4 share their plans here, measure each time once, and draw a quarter of the postures."""
    plans: dict[Hashable, CentroidalPlan] = {}

    def solve_once(problem: CentroidalProblem, solver: SolverChoice = "auto") -> CentroidalPlan:
        key = solver, content(problem)
        if key not in plans:
            plans[key] = solve(problem, solver)
        return plans[key]

    with pytest.MonkeyPatch.context() as patch:
        for module in (fig_4_8, fig_4_9, table_4_1, numbers):
            patch.setattr(module, "solve", solve_once)
        for module in (table_4_1, numbers):
            patch.setattr(module, "REPEATS", 1)
        patch.setattr(fig_4_5, "DRAWS", 40)
        patch.setattr(fig_4_5, "PROBES", 15)
        yield Found()


def test_the_contract_names_what_there_is() -> None:
    assert set(get_args(ReproductionItem)) == set(ITEMS)
    assert set(get_args(ContractVerdict)) == set(get_args(kinds.Verdict)) == set(kinds.VERDICTS)
    assert set(get_args(Evidence)) == set(get_args(kinds.Evidence))
    assert set(get_args(Outcome)) == set(get_args(kinds.Outcome)) == set(kinds.OUTCOMES) == set(kinds.WORDS)
    drawing = {kind: {name for name, item in ITEMS.items() if item.draws == kind} for kind in ("many", "one")}
    assert drawing == {"many": ITEMS_WITH_DRAWS, "one": ITEMS_WITH_SAMPLE}
    assert {name: item.min_seeds for name, item in ITEMS.items() if item.min_seeds > 1} == LEAST_DRAWS


@pytest.mark.parametrize("name", ITEMS)
def test_every_item_has_claims_tables_and_a_drawing(found: Mapping[str, Reproduction], name: str) -> None:
    result = found[name]
    assert len({claim.key for claim in result.claims}) == len(result.claims) > 0
    assert all(np.isfinite(claim.ours) for claim in result.claims)
    assert all(claim.evidence is not None and (claim.n or 0) >= 1 for claim in result.claims)
    assert all(claim.aim == str(claim.thesis).startswith("aim ") for claim in result.claims)
    for claim in result.claims:
        assert claim.has_uncertainty, f"{claim.key}: neither an interval nor a reason"
        assert (claim.interval is None) or claim.no_interval is None, claim.key
        if claim.interval is not None:
            assert claim.interval[0] <= claim.ours <= claim.interval[1], claim.key
        if claim.cases_inside is not None:
            inside = kinds.Criterion(claim.threshold, claim.holds_from, claim.holds_to, claim.strict).contains
            assert (claim.cases_inside == claim.n) == inside(claim.ours), f"{claim.key}: the extreme decides on all"
    for claim in result.claims:
        assert claim.holds_from is not None or claim.holds_to is not None, claim.key
        assert bool(claim.where) != claim.aim, claim.key
        if claim.aim:
            assert claim.threshold == "ours", claim.key
        bounds = kinds.Criterion(claim.threshold, claim.holds_from, claim.holds_to, claim.strict)
        assert bounds.contains(claim.ours) or claim.verdict != "met", claim.key
        if isinstance(claim.thesis, str) and claim.threshold == "thesis":
            assert any(sign.isdigit() for sign in claim.thesis), "words without a number have no threshold of their own"
    for columns in result.tables.values():
        assert len({len(column) for column in columns.values()}) == 1
    root = ElementTree.fromstring(result.drawing)
    assert root.tag == f"{SVG}svg"
    drawn = [*root.findall(f".//{SVG}polyline"), *root.findall(f".//{SVG}rect[@fill='{PALETTE[0]}']")]
    assert len(drawn) >= 3
    labels = [text.text or "" for text in root.findall(f".//{SVG}text")]
    # An axis or the title of bars ends in its unit: "error (mm)".
    assert sum(label.endswith(")") for label in labels) >= 1
    assert "style" not in result.drawing
    assert "script" not in result.drawing


@pytest.mark.parametrize("name", ITEMS)
def test_what_verdicts_stand_on_is_as_recorded(found: Found, name: str) -> None:
    """Numbers, bounds, cases and comparators of one draw; those of table 4.1 are times, which no record holds.

    The sizes of samples, rays and robots that a note states are those of the book.
    """
    if ITEMS[name].draws != "many" and name not in SMALLER:
        assert_note_as_in_book(name, found[name].note)
    assert_as_recorded(name, found[name].claims)
    assert_tables_as_recorded(name, found[name].tables)
    assert_steps_as_recorded(name, found.steps[name])


@pytest.mark.parametrize("name", ["fig-3.6", "fig-3.7", "fig-3.8", "fig-3.9"])
def test_a_simulated_population_gives_no_verdict_on_people(found: Found, name: str) -> None:
    people = PEOPLE_PER_SEED * ITEMS[name].min_seeds
    assert all(claim.aim and claim.n == people for claim in found[name].claims)


def ours(found: Mapping[str, Reproduction], item: str, key: str) -> Claim:
    return next(claim for claim in found[item].claims if claim.key == key)


def test_the_known_misprint_is_seen_and_the_correction_is_exact(found: Mapping[str, Reproduction]) -> None:
    assert ours(found, "fig-2.2", "zmp_2_8_corrected_m").ours < 1e-9
    printed = ours(found, "fig-2.2", "zmp_2_8_printed_m")
    assert printed.ours > 0.003
    assert printed.verdict == "thesis_in_error"
    assert found["fig-2.2"].verdict == "thesis_in_error"


def test_the_bode_diagram_is_that_of_the_formulas(found: Mapping[str, Reproduction]) -> None:
    """(2.24)-(2.26) in continuous time, where the discrete rule is still close."""
    table = found["fig-2.5"].tables["bode"]
    f = table["frequency_hz"]
    s = 2j * np.pi * f
    tau_1, tau_2 = 1 / (2 * np.pi * 4.0), 1 / (2 * np.pi * 0.4)
    h3, h2 = 1 / (1 + s * tau_2) ** 2, (s * tau_1) ** 2 / (1 + s * tau_1) ** 2
    low = f < 20.0
    for name, h in (("h3", h3), ("s2h2", h2), ("h1", 1 - h2 - h3)):
        assert table[f"thesis_{name}_gain_db"][low] == pytest.approx(20 * np.log10(np.abs(h[low])), abs=0.06)


def test_the_filter_beats_the_kalman_filter_and_the_smoother_both(found: Mapping[str, Reproduction]) -> None:
    """One draw; the bars are those of fifty, with room where one walk scatters."""
    for gait in ("robot", "human"):
        assert ours(found, "errors", f"{gait}_filter_over_kalman").ours < 0.6
        assert ours(found, "errors", f"{gait}_auto_over_thesis").ours < 1 / 1.5
        assert ours(found, "errors", f"{gait}_smoother_over_filter").ours < 0.15
        assert ours(found, "errors", f"{gait}_smoother_over_kalman").ours < 0.07
        assert ours(found, "errors", f"{gait}_white_smoother_over_filter").ours < 0.35
        assert ours(found, "fig-2.7", f"{gait}_samples_not_worse").ours < 0.95
    assert ours(found, "errors", "robot_best_height").ours > 0.9


def test_the_table_has_every_estimator_under_every_noise(found: Mapping[str, Reproduction]) -> None:
    table = found["errors"].tables["errors"]
    assert len(table["estimator"]) == len(NAMES) * len(GAITS) * 2
    assert set(table["estimator"]) == set(NAMES)
    flat = np.hypot(table["rms_x_m"], table["rms_y_m"])
    assert table["horizontal_m"] == pytest.approx(flat, rel=1e-9)


def test_the_lag_of_the_kalman_filter_is_explained(found: Mapping[str, Reproduction]) -> None:
    causes = found["lag"].tables["causes"]
    lag_s = {(g, c): v for g, c, v in zip(causes["gait"], causes["case"], causes["lag_y_s"], strict=True)}
    for gait in GAITS:
        whole = lag_s[gait, "as in the thesis"]
        assert whole > 0.02
        assert 0 < lag_s[gait, "axis through the CoM"] < whole
        assert 0 < lag_s[gait, "jerk of 20 m/s³"] < whole
        assert abs(lag_s[gait, "both removed"]) < 0.001
        assert abs(ours(found, "lag", f"{gait}_smoother_s").ours) < 0.001


def test_an_undeclared_bias_is_noticed_and_none_is_invented(found: Mapping[str, Reproduction]) -> None:
    for gait in GAITS:
        assert ours(found, "coverage", f"{gait}_flagged").ours == 1.0
        assert ours(found, "coverage", f"{gait}_false_alarms").ours == 0.0
    table = found["coverage"].tables["coverage"]
    assert len(table["scenario"]) == len(SCENARIOS) * len(GAITS)
    rigid = table["scenario"] == "rigid-table"
    for axis in "xy":
        assert (table[f"coverage_{axis}"][~rigid] > 0.8).all()
        as_it_is = table[f"ratio_{axis}"][table["scenario"] == "thesis"]
        assert (table[f"ratio_{axis}"][rigid] < as_it_is).all()


def test_a_bias_of_the_force_acts_at_the_plate() -> None:
    """Exactly 5 N, and no moment about the centre of pressure, where the plate is."""
    trial = simulate_trial("robot", "none", 0)
    wrong = with_force_bias(trial, np.array([0.6, 0.8, 0.0]))
    extra_n = wrong.wrench.force_n - trial.wrench.force_n
    extra_nm = wrong.wrench.moment_nm - trial.wrench.moment_nm
    assert np.linalg.norm(extra_n, axis=1) == pytest.approx(np.full(len(extra_n), 5.0))
    f, nu = trial.wrench.force_n, trial.wrench.moment_nm
    pressure = np.column_stack([-nu[:, 1], nu[:, 0], 0.0 * f[:, 2]]) / f[:, 2:]
    assert extra_nm == pytest.approx(np.cross(pressure, extra_n), abs=1e-6)


def test_one_second_of_force_takes_most_of_the_error_away(found: Mapping[str, Reproduction]) -> None:
    table = found["partial-force"].tables["errors"]
    for gait in GAITS:
        here = (table["gait"] == gait) & (table["noise"] == "marker-like")
        error_m = dict(zip(table["estimator"][here], table["horizontal_m"][here], strict=True))
        assert error_m["smoother"] < 0.0066
        assert error_m["smoother"] < error_m["complementary-thesis"]
        assert ours(found, "partial-force", f"{gait}_refused").ours == 1.0


def test_a_masked_second_holds_a_full_single_support_and_only_it_has_force() -> None:
    trial, _ = excerpt_with_single_support("robot", "marker-like", 1)
    t, seen = trial.truth.time_s, trial.wrench.complete
    assert t[seen].min() == pytest.approx(0.5)
    assert t[seen].max() == pytest.approx(1.5)
    assert (trial.wrench.force_n[~seen] == 0).all()
    assert (trial.wrench.moment_nm[~seen] == 0).all()
    assert (np.abs(trial.wrench.force_n[seen, 2]) > 100.0).all()


def test_a_late_force_is_taken_for_a_bias_of_the_table(found: Mapping[str, Reproduction]) -> None:
    note = ours(found, "fig-2.8", "bias_left").note
    moved = re.search(r"changes by ([+-][0-9.]+) mm", note)
    assert moved is not None
    assert float(moved.group(1)) == pytest.approx(-1.2 * 18.0, abs=4.0)
    assert ours(found, "fig-2.8", "latency_error_s").ours < 0.003


def test_a_double_pole_settles_when_it_must(found: Mapping[str, Reproduction]) -> None:
    """90 % of 1 - (1 + t / tau) exp(-t / tau) is reached at t = 3.89 tau."""
    assert ours(found, "fig-2.9", "settling_s").ours == pytest.approx(3.89 / (2 * np.pi * 0.4), abs=0.02)


def test_a_bias_is_corrected_but_for_the_time_in_flight(found: Mapping[str, Reproduction]) -> None:
    """Below 0.4 Hz the axis is a mean over steps, in which the geometry stands in for the share of flight."""
    left = ours(found, "fig-2.9", "bias_left").ours
    assert 0.3 < left < 0.45
    assert ours(found, "fig-2.9", "bias_left_predicted").ours < 0.03
    assert abs(ours(found, "fig-2.9", "bias_left_told").ours) < 0.02
    assert ours(found, "fig-2.9", "vertical_left").ours > 0.9


def test_in_flight_only_who_believes_the_plates_falls_with_g(found: Mapping[str, Reproduction]) -> None:
    table = found["flight"].tables["flight"]
    here = table["noise"] == "marker-like"
    share = dict(zip(table["estimator"][here], table["vertical_share"][here], strict=True))
    assert share["smoother"] < 0.02
    assert share["geometry"] > 2 * share["smoother"]


def test_the_log_density_is_compared_with_a_plan_of_the_same_bounds(found: Mapping[str, Reproduction]) -> None:
    verdicts = {claim.key: claim.verdict for claim in found["fig-4.9"].claims}
    assert verdicts["nearer_uniform"] == verdicts["nearer_conditioned"] == "met"
    table, paths = found["fig-4.9"].tables["shares"], found["fig-4.9"].tables["paths"]
    assert (table["highest_m"] <= fig_4_9.COM_HEIGHT_M[1] + 0.1).all(), "none rises out of reach"
    assert table["least_share"][1] < table["least_share"][0]
    for measure, case in product(fig_4_9.MEASURES, fig_4_9.CASES):
        gaps = np.flatnonzero(~np.isfinite(paths[f"{measure}_{case}_x_m"]))
        assert len(gaps) == pytest.approx(6 * 14, abs=2)  # six times 1.4 s in the air


def test_the_verdict_is_that_of_the_worst_claim() -> None:
    def claim(verdict: kinds.Verdict) -> Claim:
        return Claim(verdict, "says", 1.0, 1.0, "1", verdict)

    def verdict(*of: kinds.Verdict) -> kinds.Verdict:
        return Reproduction(tuple(claim(v) for v in of), "", {}, "").verdict

    assert verdict("met", "beaten") == "met"
    assert verdict("met", "thesis_in_error") == "thesis_in_error"
    assert verdict("thesis_in_error", "not_met", "beaten") == "not_met"
    assert kinds.target("k", 0.93, "1", at_least=0.92, at_most=0.99).says("k").verdict == "beaten"
    for outside in (0.91, 1.0, float("nan")):
        assert kinds.target("k", outside, "1", at_least=0.92, at_most=0.99).says("k").verdict == "not_met"
    assert kinds.target("k", 0.003, "m", at_most=0.004).thesis == "aim ≤ 4 mm"
    assert kinds.target("k", 1.0, "1", at_least=0.95).thesis == "aim ≥ 0.95"
    assert kinds.target("k", 0.95, "1", at_least=0.92, at_most=0.99).thesis == "aim 0.92 to 0.99"
    texts = {999.4: "999", 1000.0: "1000", 1234.6: "1235", 999_999.0: "999999", 1.1e6: "1.1e+06", 0.01234: "0.0123"}
    assert {value: kinds.format_three_digits(value) for value in texts} == texts
    at = kinds.at_most(1.0, "words", otherwise="thesis_in_error")
    assert (at.verdict(1.0), at.verdict(1.1)) == ("met", "thesis_in_error")


def test_unknown_items_and_numbers_of_seeds_are_refused() -> None:
    with pytest.raises(NotFound):
        reproduce_item("fig-9.9", 1, lambda _fraction, _message: None)
    for seeds in (0, 201):
        with pytest.raises(InvalidInput):
            reproduce_item("fig-2.6", seeds, lambda _fraction, _message: None)


def test_a_drawing_keeps_to_its_scale_and_its_gaps() -> None:
    x = np.geomspace(0.1, 10.0, 5)
    y = np.array([1.0, 10.0, np.nan, 1000.0, 10000.0])
    text = render_svg(Panel("a < b & c", "Hz", "m", [Curve(x, y, "one")], log_x=True, log_y=True))
    root = ElementTree.fromstring(text)
    runs = [line.get("points") or "" for line in root.findall(f".//{SVG}polyline")]
    assert len(runs) == 2, "a gap interrupts the line"
    points = np.array([[float(v) for v in pair.split(",")] for run in runs for pair in run.split()])
    # A power law is a straight line on logarithmic axes, also across the gap.
    slope = np.diff(points[:, 1]) / np.diff(points[:, 0])
    assert slope == pytest.approx(np.full(3, slope[0]), rel=0.01)
    assert (points >= 0).all()
    assert "a &lt; b &amp; c" in text


def test_bars_are_as_long_as_their_numbers() -> None:
    root = ElementTree.fromstring(
        render_svg(Bars("a & b", "mm", [("one", 2.0), ("two", -1.0), ("none", float("nan"))]))
    )
    bars = root.findall(f".//{SVG}rect[@fill='{PALETTE[0]}']")
    one, two, none = (float(bar.get("width") or "") for bar in bars)
    assert one == pytest.approx(2.0 * two, abs=0.2)
    assert none == 0.0
    start_one, start_two = (float(bar.get("x") or "") for bar in bars[:2])
    assert start_two + two == pytest.approx(start_one, abs=0.2), "the negative bar ends where the positive begins"


def test_no_two_colours_look_alike_without_red_or_green() -> None:
    """Okabe and Ito's colours keep apart in lightness or blue where red and green are one (deuteranopia)."""
    rgb = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in PALETTE]) / 255.0
    linear = np.where(rgb > 0.04045, ((rgb + 0.055) / 1.055) ** 2.4, rgb / 12.92)
    # Machado, Oliveira and Fernandes (2009), severity 1.0.
    seen = linear @ np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]).T
    seen = np.clip(seen, 0.0, 1.0) ** (1 / 2.2)
    apart = np.linalg.norm(seen[:, None] - seen[None], axis=2)[np.triu_indices(len(PALETTE), 1)]
    assert apart.min() > 0.15
