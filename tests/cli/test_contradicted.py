"""A result whose sensors contradict each other: exit code 3, a warning before any number, and all files."""

import json
from pathlib import Path

import pytest

from support.command_line import SAMPLE, Run

TRIAL = SAMPLE / "recording.c3d"
A_QUARTER_TOO_MUCH = 75
"""Kilograms; the sample's person weighs 60."""


@pytest.mark.parametrize("command", ["estimate", "compare", "fit-cycloid"])
def test_a_mass_a_quarter_too_large_ends_with_exit_code_3(run: Run, tmp_path: Path, command: str) -> None:
    ran = run(command, TRIAL, "--mass", A_QUARTER_TOO_MUCH, "--method", "smoother", "--out", "out")
    assert ran.code == 3, ran.err
    assert ran.out.startswith("contradicted: The sensors contradict each other")
    assert "the plates' vertical force and the mass contradict each other" in ran.out
    summary = json.loads((tmp_path / "out" / "result.json").read_text())["summary"]
    assert summary["quality"]["verdict"] == "contradicted"
    assert summary["warnings"][0]["code"] == "contradicted"
    (check,) = [one for one in summary["quality"]["checks"] if one["name"] == "mass_from_motion"]
    assert check["value"] > check["contradicted_above"]
    assert not check["passed"]


def test_a_good_result_ends_with_0_and_the_geometry_alone_lists_the_missing_checks(run: Run, tmp_path: Path) -> None:
    ran = run("estimate", TRIAL, "--method", "geometry", "--out", "out")
    assert ran.code == 0, ran.err
    quality = json.loads((tmp_path / "out" / "result.json").read_text())["summary"]["quality"]
    assert quality["verdict"] == "good"
    assert {one["name"] for one in quality["checks"]} == {
        "body_axis",
        "outside_body",
        "leg_length_change",
        "body_proportions",
    }
    assert quality["not_checked"]["force_residual"] == "no force was used"
