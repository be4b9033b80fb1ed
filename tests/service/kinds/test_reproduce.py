"""``reproduce``: claims, tables and the drawing in the job's folder; the same from the command line."""

import asyncio
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from stridelab.cli.options import Delivery
from stridelab.cli.reproduce import reproduce_item
from stridelab.errors import InvalidInput
from stridelab.reproduction.registry import ITEMS, seeds_of
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.reproduction import ReproduceInput, ReproduceSummary, ReproduceTask
from stridelab.service.kinds.provenance import known_references
from stridelab.service.kinds.registry import KINDS
from stridelab.service.kinds.reproduce import run as kind
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.processes.sandbox import KernelFeatures
from support.command_line import RecordedProgress


def test_an_item_leaves_numbers_tables_and_a_drawing(tmp_path: Path) -> None:
    progress = RecordedProgress()
    outcome = kind.run(ReproduceTask(input=ReproduceInput(item="fig-2.6", seeds=1)), tmp_path, progress)
    summary = ReproduceSummary.model_validate(outcome.summary)
    assert progress.fractions[-1] == 1.0
    assert (summary.seeds, summary.seed, summary.sampling) == (1, 0, "Seed 0.")
    assert {(claim.evidence, claim.n, claim.aim) for claim in summary.claims} == {("simulated", 1, False)}
    assert summary.thesis["axis_worse_from_hz"] == 0.4
    assert set(summary.ours) == set(summary.thesis) == {claim.key for claim in summary.claims}
    assert outcome.artifacts[0].name == "fig-2.6.svg"
    assert outcome.artifacts[0].media_type == "image/svg+xml"
    assert {a.name for a in outcome.artifacts} == {p.name for p in tmp_path.iterdir()}
    assert set(outcome.references) <= known_references()
    assert "geometry_x_m_rthz" in pq.read_schema(tmp_path / "spectra.parquet").names


def test_the_command_line_shows_the_claims(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    reproduce_item("fig-2.5", None, None, Delivery(tmp_path / "a"))
    output = capsys.readouterr().out
    for word in (
        "fig-2.5",
        "thesis",
        "ours",
        "met",
        "simulated,",
        "deterministic, n = 1",
        "Draws nothing",
        "bode.parquet",
        "fig-2.5.svg",
    ):
        assert word in output
    reproduce_item("fig-2.6", 1, 4, Delivery(tmp_path / "b", as_json=True))
    assert JobResult.model_validate_json(capsys.readouterr().out).input == {"item": "fig-2.6", "seeds": 1, "seed": 4}


def test_an_unknown_item_names_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refusal:
        reproduce_item("fig-7", None, None, Delivery(tmp_path / "x"))
    assert refusal.value.faults[0].where == "ITEM"
    assert "fig-2.2" in refusal.value.faults[0].message


def test_another_seed_draws_other_noise(tmp_path: Path) -> None:
    ours = []
    for seed in (None, 0, 7):
        request, folder = ReproduceInput(item="fig-2.6", seeds=1, seed=seed), tmp_path / str(seed)
        folder.mkdir()
        ours.append(kind.run(ReproduceTask(input=request), folder, RecordedProgress()).summary["ours"])
    assert ours[0] == ours[1] != ours[2]


@pytest.mark.parametrize(
    "refused",
    [
        {"item": "fig-2.5", "seeds": 3},
        {"item": "table-4.1", "seed": 1},
        {"item": "fig-4.5", "seeds": 3},
    ],
)
def test_draws_are_refused_where_none_are_made(refused: dict[str, object]) -> None:
    field = "seeds" if "seeds" in refused else "seed"
    with pytest.raises(ValidationError, match=f"{field}: {refused['item']} draws"):
        ReproduceInput.model_validate(refused)
    with pytest.raises(InvalidInput) as unlike:
        seeds_of(ITEMS[str(refused["item"])], *(refused.get(name) for name in ("seeds", "seed")))  # type: ignore[arg-type]
    assert (unlike.value.code, unlike.value.faults[0].where) == ("nothing-drawn", field)


def test_fewer_draws_than_an_item_needs_are_refused_not_raised() -> None:
    with pytest.raises(ValidationError, match=r"seeds: fig-3\.7 needs 2 draws at least, not 1"):
        ReproduceInput.model_validate({"item": "fig-3.7", "seeds": 1})
    assert seeds_of(ITEMS["fig-3.7"], 2, None) == range(2)
    with pytest.raises(InvalidInput) as refused:
        seeds_of(ITEMS["fig-3.7"], 1, None)
    assert refused.value.code == "seeds-out-of-range"


@pytest.mark.skipif(bool(KernelFeatures.detect_features().missing_layers), reason="the kernel lacks a layer")
@pytest.mark.parametrize("item", ["fig-2.5", "fig-4.3"])
def test_a_reproduction_needs_nothing_but_its_folder(item: str, tmp_path: Path) -> None:
    """Of a chapter without and of one with robots, solvers and their libraries."""
    job_kind = KINDS["reproduce"]

    async def inside() -> IsolatedOutcome:
        async with IsolatedPool() as pool:
            task = {"input": {"item": item}}
            return await pool.run(
                job_kind.run, task, tmp_path, timeout_s=300.0, memory_mb=4096, sandbox=job_kind.sandbox
            )

    outcome = asyncio.run(inside())
    assert outcome.state == "ok", outcome.log_tail
    assert outcome.value["summary"]["item"] == item
