"""``reproduce``: claims, tables and the drawing in the job's folder; the same from the command line."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from stridelab.cli.options import Delivery
from stridelab.cli.reproduce import reproduce_item
from stridelab.errors import InvalidInput
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.reproduction import ReproduceInput, ReproduceSummary, ReproduceTask
from stridelab.service.kinds.reproduce import run as kind
from stridelab.service.kinds.result_tables import known_references
from support.command_line import Told


def test_an_item_leaves_numbers_tables_and_a_drawing(tmp_path: Path) -> None:
    told = Told()
    outcome = kind.run(ReproduceTask(input=ReproduceInput(item="fig-2.6", seeds=1)), tmp_path, told)
    summary = ReproduceSummary.model_validate(outcome.summary)
    assert told.fractions[-1] == 1.0
    assert summary.seeds == 1
    assert summary.thesis["axis_worse_from_hz"] == 0.4
    assert set(summary.ours) == set(summary.thesis) == {claim.key for claim in summary.claims}
    assert outcome.artifacts[0].name == "fig-2.6.svg"
    assert outcome.artifacts[0].media_type == "image/svg+xml"
    assert {a.name for a in outcome.artifacts} == {p.name for p in tmp_path.iterdir()}
    assert set(outcome.references) <= known_references()
    assert "geometry_x_m_rthz" in pq.read_schema(tmp_path / "spectra.parquet").names


def test_the_command_line_shows_the_claims(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    reproduce_item("fig-2.5", None, Delivery(tmp_path / "a"))
    shown = capsys.readouterr().out
    for word in ("fig-2.5", "thesis", "ours", "met", "bode.parquet", "fig-2.5.svg"):
        assert word in shown
    reproduce_item("fig-2.5", 3, Delivery(tmp_path / "b", as_json=True))
    assert JobResult.model_validate_json(capsys.readouterr().out).input == {"item": "fig-2.5", "seeds": 3}


def test_an_unknown_item_names_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refusal:
        reproduce_item("fig-7", None, Delivery(tmp_path / "x"))
    assert refusal.value.faults[0].where == "ITEM"
    assert "fig-2.2" in refusal.value.faults[0].message
