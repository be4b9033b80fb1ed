"""``stridelab learn-reachability``: the output of a local run, and refused arguments."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.reachability import store
from stridelab.schemas.jobs import JobResult

FILES = {
    "mixtures.json",
    "cloud.npz",
    "card.json",
    "reachability.json",
    "samples.parquet",
    "samples.csv",
    "result.json",
    "references.bib",
}


def typed(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["learn-reachability", *arguments])
    return result.exit_code, result.output


def test_the_files_are_those_of_the_job_and_the_same_again(tmp_path: Path) -> None:
    options = ["--samples", "500", "--seed", "3", "--effector", "left_foot", "--effector", "right_hand"]
    code, output = typed("talos", *options, "--out", str(tmp_path / "one"))
    assert code == 0, output
    assert "left_foot" in output
    assert "few-samples" in output
    assert {path.name for path in (tmp_path / "one").iterdir()} == FILES
    code, printed = typed("talos", *options, "--out", str(tmp_path / "two"), "--json")
    result = JobResult.model_validate(json.loads(printed[printed.index("{") :]))
    assert result.summary["effectors"].keys() == {"left_foot", "right_hand"}
    one, two = (store.read_card(tmp_path / name / "mixtures.json") for name in ("one", "two"))
    assert replace(two, learned_on=one.learned_on) == one
    assert (tmp_path / "one" / "cloud.npz").read_bytes() == (tmp_path / "two" / "cloud.npz").read_bytes()


@pytest.mark.parametrize(("option", "value"), [("--samples", "3"), ("--seed", "-1"), ("--measure", "gaussian")])
def test_an_invalid_option_is_named(tmp_path: Path, option: str, value: str) -> None:
    code, output = typed("talos", option, value, "--out", str(tmp_path / "out"))
    assert code == 2
    assert option in output
    assert not (tmp_path / "out").exists()


def test_an_unknown_robot_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, output = typed("../marvin")
    assert (code, "robot-not-found" in output) == (5, True), output
    assert list(tmp_path.iterdir()) == []
