"""Infeasible and unreadable scenarios on the command line: phase and effector are named, nothing is written."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.cli.results import EXIT_CODES
from stridelab.errors import InvalidInput
from support.robots.scenario_bodies import one_step, with_contact

Body = dict[str, Any]
FLOOR = one_step()["terrain"][0]
LEFT = one_step()["phases"][0]["contacts"][0]
CRATE = {"name": "crate", "kind": "box", "center_m": [0.35, 0.09, 0.0], "size_m": [0.3, 0.3, 0.3]}
FOOT = "phases[2].contacts[left_foot]"


def twice() -> Body:
    body = one_step()
    body["phases"][0]["contacts"].append(LEFT)
    return body


def lasting(duration_s: float) -> Body:
    body = one_step()
    body["phases"][1]["duration_s"] = duration_s
    return body


BAD: dict[str, tuple[Callable[[], Body], str, str]] = {
    "in the air": (lambda: with_contact(2, 0, position_m=[0.2, 0.09, 0.1]), FOOT, "in the air"),
    "through a box": (lambda: one_step(terrain=[FLOOR, CRATE]), FOOT, "inside 'crate'"),
    "no friction": (lambda: one_step(friction=0.0), "phases[0].contacts[left_foot]", "friction"),
    "friction below 0": (lambda: one_step(friction=-1.0), "phases[0].contacts[left_foot]", "friction"),
    "NaN in a contact": (lambda: with_contact(2, 0, position_m=[float("nan"), 0.09, 0.0]), FOOT, "finite"),
    "NaN friction": (lambda: one_step(friction=float("nan")), "friction", "finite"),
    "phases without duration": (lambda: lasting(0.0), "phases[1].duration_s", "0.05"),
    "phases that last less than nothing": (lambda: lasting(-0.4), "phases[1].duration_s", "0.05"),
    "500 phases": (lambda: one_step(phases=one_step()["phases"][:1] * 500), "phases", "400"),
    "one effector twice": (twice, "phases[0].contacts[left_foot]", "twice"),
    "a foot 150 m high": (lambda: with_contact(2, 0, position_m=[0.2, 0.09, 150.0]), FOOT, "metres"),
    "a stair 150 m high": (
        lambda: one_step(terrain=[FLOOR, {**CRATE, "size_m": [0.3, 0.3, 150.0]}]), "terrain[1]", "metres",
    ),
}  # fmt: skip


def refused(folder: Path, *arguments: str) -> str:
    """What was printed, on one line."""
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == EXIT_CODES[InvalidInput], result.output
    assert [path.name for path in folder.iterdir()] == ["bad.json"]
    return " ".join(result.output.split())


@pytest.mark.parametrize("name", BAD)
def test_a_bad_scenario_is_refused_with_the_place_and_leaves_nothing(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    make, where, word = BAD[name]
    Path("bad.json").write_text(json.dumps(make()), encoding="utf-8")
    for command in ("plan", "export-contacts"):
        output = refused(tmp_path, command, "bad.json")
        assert where in output, output
        assert word in output, output


@pytest.mark.parametrize("name", [name for name in BAD if "phases" not in name])
def test_bad_ends_of_a_task_are_refused_with_the_place(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    make, where, word = BAD[name]
    scenario = make()
    ends = {"start": scenario["phases"][0], "goal": scenario["phases"][-1]}
    task = {key: scenario[key] for key in ("robot", "terrain", "friction")}
    task |= {end: {"contacts": phase["contacts"]} for end, phase in ends.items()}
    Path("bad.json").write_text(json.dumps(task), encoding="utf-8")
    output = refused(tmp_path, "plan-contacts", "bad.json")
    assert where.replace("phases[0]", "start").replace("phases[2]", "goal") in output, output
    assert word in output, output
