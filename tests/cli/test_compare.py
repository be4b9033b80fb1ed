"""``stridelab compare``: the job's own numbers as a table and as files."""

from pathlib import Path

import pytest

from stridelab.cli.compare import compare_methods
from stridelab.cli.options import Delivery, EstimateRequest, Walk
from stridelab.errors import InvalidInput, UnreadableFile
from stridelab.schemas.comparison import CompareEstimatorsSummary
from stridelab.schemas.jobs import JobResult
from support.command_line import SAMPLE

TRUTH = SAMPLE / "truth.parquet"


def run(out_dir: Path, *, truth: Path | None = TRUTH, as_json: bool = False, server: str | None = None) -> None:
    request = EstimateRequest(Walk(SAMPLE / "recording.c3d"), "complementary")
    compare_methods(request, truth=truth, delivery=Delivery(out_dir, as_json=as_json, server=server))


def test_the_table_shows_errors_and_agreement(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path / "out")
    output = capsys.readouterr().out
    for word in ("geometry", "complementary", "horizontal mm", "held back N", "r of dL/dt", "spectra.parquet"):
        assert word in output
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert {"result.json", "references.bib", "comparison.csv", "bode.csv"} <= names
    assert not any("truth" in name or "trial" in name for name in names)


def test_json_is_the_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path / "out", truth=None, as_json=True)
    result = JobResult.model_validate_json(capsys.readouterr().out)
    assert result.kind == "compare-estimators"
    assert CompareEstimatorsSummary.model_validate(result.summary).reference == "geometry"


def test_a_truth_cannot_be_sent_and_must_exist(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="knows the truth of its own"):
        run(tmp_path / "out", server="http://lab:8000")
    with pytest.raises(UnreadableFile):
        run(tmp_path / "out", truth=tmp_path / "missing.parquet")
    assert list(tmp_path.iterdir()) == []
