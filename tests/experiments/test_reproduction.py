"""What a reproduction yields: claims that can fail, tables of one length, a drawing that is an SVG."""

import re
from collections.abc import Mapping
from typing import get_args
from xml.etree import ElementTree

import numpy as np
import pytest

from stridelab.errors import InvalidInput, NotFound
from stridelab.experiments.reproduction import item as kinds
from stridelab.experiments.reproduction.drawing import Curve, Panel, svg
from stridelab.experiments.reproduction.item import Claim, Reproduction
from stridelab.experiments.reproduction.registry import ITEMS, reproduce
from stridelab.schemas.reproduction import ReproductionItem
from stridelab.schemas.reproduction import Verdict as ContractVerdict

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def found() -> Mapping[str, Reproduction]:
    return {name: reproduce(name, 1, lambda _fraction, _message: None) for name in ITEMS}


def test_the_contract_names_what_there_is() -> None:
    assert set(get_args(ReproductionItem)) == set(ITEMS)
    assert set(get_args(ContractVerdict)) == set(get_args(kinds.Verdict)) == set(kinds.VERDICTS)


@pytest.mark.parametrize("name", ITEMS)
def test_every_item_has_claims_tables_and_a_drawing(found: Mapping[str, Reproduction], name: str) -> None:
    result = found[name]
    assert len({claim.key for claim in result.claims}) == len(result.claims) > 0
    assert all(np.isfinite(claim.ours) for claim in result.claims)
    for columns in result.tables.values():
        assert len({len(column) for column in columns.values()}) == 1
    root = ElementTree.fromstring(result.drawing)
    assert root.tag == f"{SVG}svg"
    assert len(root.findall(f".//{SVG}polyline")) >= 3
    assert "style" not in result.drawing
    assert "script" not in result.drawing


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
    for gait in ("robot", "human"):
        assert ours(found, "fig-2.7", f"{gait}_filter_over_kalman").ours < 0.7
        assert ours(found, "fig-2.7", f"{gait}_smoother_over_filter").ours < 0.3
        assert ours(found, "fig-2.7", f"{gait}_samples_not_worse").ours < 0.95


def test_a_late_force_is_taken_for_a_bias_of_the_table(found: Mapping[str, Reproduction]) -> None:
    note = ours(found, "fig-2.8", "bias_left_late").note
    moved = re.search(r"moves by ([+-][0-9.]+) mm", note)
    assert moved is not None
    assert float(moved.group(1)) == pytest.approx(-1.2 * 18.0, abs=4.0)
    assert ours(found, "fig-2.8", "latency_error_s").ours < 0.003


def test_a_double_pole_settles_when_it_must(found: Mapping[str, Reproduction]) -> None:
    """90 % of 1 - (1 + t / tau) exp(-t / tau) is reached at t = 3.89 tau."""
    assert ours(found, "fig-2.9", "settling_s").ours == pytest.approx(3.89 / (2 * np.pi * 0.4), abs=0.02)
    assert ours(found, "fig-2.9", "flight_share").ours < 0.02


def test_the_verdict_is_that_of_the_worst_claim() -> None:
    def claim(verdict: kinds.Verdict) -> Claim:
        return Claim(verdict, "says", 1.0, 1.0, "1", verdict)

    def verdict(*of: kinds.Verdict) -> kinds.Verdict:
        return Reproduction(tuple(claim(v) for v in of), "", {}, "").verdict

    assert verdict("met", "beaten") == "met"
    assert verdict("met", "thesis_in_error") == "thesis_in_error"
    assert verdict("thesis_in_error", "not_met", "beaten") == "not_met"
    assert kinds.judged(1.0, at_most=0.9) == kinds.judged(0.8, at_least=0.9) == "not_met"


def test_unknown_items_and_numbers_of_seeds_are_refused() -> None:
    with pytest.raises(NotFound):
        reproduce("fig-9.9", 1, lambda _fraction, _message: None)
    for seeds in (0, 201):
        with pytest.raises(InvalidInput):
            reproduce("fig-2.5", seeds, lambda _fraction, _message: None)


def test_a_drawing_keeps_to_its_scale_and_its_gaps() -> None:
    x = np.geomspace(0.1, 10.0, 5)
    y = np.array([1.0, 10.0, np.nan, 1000.0, 10000.0])
    text = svg([Panel("a < b & c", "Hz", "m", [Curve(x, y, "one")], log_x=True, log_y=True)])
    root = ElementTree.fromstring(text)
    runs = [line.get("points") or "" for line in root.findall(f".//{SVG}polyline")]
    assert len(runs) == 2, "a gap interrupts the line"
    points = np.array([[float(v) for v in pair.split(",")] for run in runs for pair in run.split()])
    # A power law is a straight line on logarithmic axes, also across the gap.
    slope = np.diff(points[:, 1]) / np.diff(points[:, 0])
    assert slope == pytest.approx(np.full(3, slope[0]), rel=0.01)
    assert (points >= 0).all()
    assert "a &lt; b &amp; c" in text
