"""``stridelab sweep``: what is typed becomes the job's input, the result a folder and a few lines."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.cli.sweep import SweepRequest, parse_ranges
from stridelab.errors import InvalidInput
from stridelab.service.kinds.sweep import run as sweep
from support.robots.plans import short_walk


@pytest.mark.parametrize(
    "typed", ["stride", "stride=1", "stride=1:2", "stride=1:2:x", "stride=a:2:3", "stride=1:2:3:4"]
)
def test_an_invalid_range_is_named(typed: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        parse_ranges([typed])
    assert refusal.value.faults[0].where == "--vary"
    assert typed in refusal.value.faults[0].message


def test_ranges_become_the_jobs_input() -> None:
    request = SweepRequest("walk", ["stride=0.6:1.05:50", "friction=0.3:0.8:6"], solver="casadi", node_rate_hz=20.0)
    job_input = request.to_input(short_walk())
    assert job_input.vary == {"stride": (0.6, 1.05, 50), "friction": (0.3, 0.8, 6)}
    assert (job_input.points, job_input.solver, job_input.node_rate_hz) == (300, "casadi", 20.0)
    with pytest.raises(InvalidInput) as refusal:
        SweepRequest("walk", ["mass=1:2:3"]).to_input(short_walk())
    assert refusal.value.faults[0].where == "--vary"
    assert refusal.value.faults[0].message.startswith("mass: Input should be 'stride'")


def test_a_sweep_from_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        sweep, "map_isolated", lambda work, items, **_options: ((k, work(item)) for k, item in enumerate(items))
    )
    file = tmp_path / "walk.json"
    file.write_text(short_walk().model_dump_json(exclude_unset=True))
    out = tmp_path / "out"
    command = ["sweep", str(file), "--vary", "timing=0.9:1.1:2", "--solver", "ipopt", "--node-rate", "5"]
    result = CliRunner().invoke(app, [*command, "--out", str(out)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert (
        "2 of 2 scenarios have a motion (centre of mass only: whether the body can follow was not computed)"
        in " ".join(result.output.split())
    )
    assert sorted(path.name for path in out.iterdir()) == [
        "references.bib",
        "result.json",
        "sweep.csv",
        "sweep.parquet",
    ]
    assert json.loads((out / "result.json").read_text())["summary"]["feasible"] == 2
    again = CliRunner().invoke(app, [*command, "--out", str(out)])
    assert again.exit_code != 0
