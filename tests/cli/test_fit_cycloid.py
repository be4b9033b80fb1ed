"""``stridelab fit-cycloid``: the job's own numbers as tables and as files."""

from pathlib import Path

import pytest

from stridelab.cli.fit_cycloid import fit_steps
from stridelab.cli.options import Delivery, EstimateRequest, Walk
from stridelab.errors import InvalidInput, UnreadableFile
from stridelab.schemas.cycloid import FitCycloidSummary
from stridelab.schemas.jobs import JobResult
from support.command_line import SAMPLE


def run(
    out_dir: Path,
    *,
    as_json: bool = False,
    file: Path = SAMPLE / "recording.c3d",
    method: str = "complementary",
    steps: str = "measured",
) -> None:
    fit_steps(EstimateRequest(Walk(file), method, steps=steps), Delivery(out_dir, as_json=as_json))


def test_the_tables_show_wheel_timing_and_scatter(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path / "out")
    output = capsys.readouterr().out
    for word in ("R mm", "2piR/L", "s=-1", "both down", "(3.3.3)", "sd between", "timed-omega-low", "wheel.parquet"):
        assert word in output
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {"steps.parquet", "steps.csv", "wheel.parquet", "wheel.csv", "result.json", "references.bib"}


def test_json_is_the_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path / "out", as_json=True, steps="all", method="smoother")
    result = JobResult.model_validate_json(capsys.readouterr().out)
    assert result.kind == "fit-cycloid"
    assert result.input["steps"] == "all"
    assert len(FitCycloidSummary.model_validate(result.summary).steps) >= 4


def test_unreadable_files_and_invalid_options_leave_nothing(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFile):
        run(tmp_path / "out", file=tmp_path / "missing.c3d")
    with pytest.raises(InvalidInput):
        run(tmp_path / "out", steps="some")
    assert list(tmp_path.iterdir()) == []
