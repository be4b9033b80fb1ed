"""``sweep``: a scenario at many values, each planned or refused, as a table and a summary."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from stridelab.contacts.scenarios.variations import current_value
from stridelab.errors import InvalidInput, NotEstimable, StridelabError
from stridelab.pipelines import plan_problem
from stridelab.pipelines.sweep_scenarios import plan_chunk, sweep_axes
from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.sweeps import MAX_POINTS, SweepInput, SweepSummary, SweepTask
from stridelab.service.kinds.registry import KINDS
from stridelab.service.kinds.sweep import run as sweep
from support.command_line import RecordedProgress
from support.robots.plans import changed, short_walk


def task(vary: dict[str, Any], scenario: Scenario | None = None, **options: Any) -> SweepTask:
    body = scenario or short_walk()
    options = {"solver": "ipopt", "node_rate_hz": 5.0, **options}
    return SweepTask(scenario=body, input=SweepInput(scenario=body, vary=vary, **options))


def test_the_registry_names_it() -> None:
    assert KINDS["sweep"].run == f"{sweep.run.__module__}:{sweep.run.__name__}"


def test_strides_by_friction(tmp_path: Path) -> None:
    """What is out of reach is refused, what slips has no motion, and what is left has one, on two processes."""
    progress = RecordedProgress()
    vary = {"stride": (0.5, 5.0, 2), "friction": (0.002, 0.4, 2)}
    outcome = sweep.run(task(vary), tmp_path, progress, 2)
    summary = SweepSummary.model_validate(outcome.summary)
    table = pq.read_table(tmp_path / "sweep.parquet")
    assert {item.name for item in outcome.artifacts} == {"sweep.parquet", "sweep.csv"}
    assert progress.fractions[-1] == 1.0
    assert table["stride_m"].to_pylist() == [0.5, 0.5, 5.0, 5.0]
    assert table["friction"].to_pylist() == [0.002, 0.4, 0.002, 0.4]
    assert table["outcome"].to_pylist() == ["infeasible", "feasible", "refused", "refused"]
    assert table["feasible"].to_pylist() == [False, True, False, False]
    assert np.isfinite(table["objective"].to_numpy()).tolist() == [False, True, False, False]
    assert table["why"].to_pylist()[-1].startswith("The robot cannot do this")
    assert (summary.points, summary.feasible, summary.refused, summary.infeasible, summary.failed) == (4, 1, 2, 1, 0)
    assert (summary.solvers, summary.solver_because) == ({"ipopt": 2}, "ipopt was requested.")
    assert [axis.field for axis in summary.axes] == ["stride", "friction"]
    assert summary.axes[0].present == current_value(short_walk().model_dump(mode="json"), "stride")


def test_a_process_that_dies_costs_its_own_scenarios(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def half(_work: object, items: list[Any], **_options: object) -> Any:
        yield 1, StridelabError("computation-crashed", "It was killed.")
        yield 0, plan_chunk(items[0])

    monkeypatch.setattr(sweep, "map_isolated", half)
    outcome = sweep.run(task({"timing": (1.0, 1.2, 2)}), tmp_path, RecordedProgress(), 1)
    summary = SweepSummary.model_validate(outcome.summary)
    assert (summary.feasible, summary.failed) == (1, 1)
    assert summary.warnings[0].code == "sweep-points-failed"
    assert "It was killed." in summary.warnings[0].message
    assert pq.read_table(tmp_path / "sweep.parquet")["outcome"].to_pylist() == ["feasible", "failed"]


def test_an_axis_that_cannot_be_varied_is_refused_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refusal:
        sweep.run(task({"height": (0.1, 0.2, 2)}), tmp_path, RecordedProgress())
    assert refusal.value.code == "sweep-field-impossible"
    assert list(tmp_path.iterdir()) == []


def test_the_native_solver_is_refused_where_it_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_problem, "native_unavailable_reason", lambda: "It was not built.")
    with pytest.raises(NotEstimable) as refusal:
        sweep.run(task({"timing": (1.0, 1.2, 2)}, solver="native"), tmp_path, RecordedProgress())
    assert (refusal.value.code, refusal.value.message) == ("solver-unavailable", "It was not built.")


def test_an_axis_of_one_value_is_that_value() -> None:
    walk = changed(short_walk(), lambda body: body.update(friction=0.5))
    (axis,) = sweep_axes(walk.model_dump(mode="json"), SweepInput(scenario=walk, vary={"friction": (0.3, 0.9, 1)}))
    assert (axis.values, axis.present, axis.unit) == ([0.3], 0.5, "")


@pytest.mark.parametrize(
    ("wrong", "where"),
    [
        ({}, "vary"),
        ({"vary": {}}, "vary"),
        ({"vary": {"mass": (1.0, 2.0, 3)}}, "mass"),
        ({"vary": {"stride": (0.0, 2.0, 3)}}, "stride"),
        ({"vary": {"stride": (1.0, float("nan"), 3)}}, "stride"),
        ({"vary": {"stride": (1.0, 2.0, 0)}}, "stride"),
        ({"vary": {"stride": (1.0, 2.0, 200), "friction": (0.1, 1.0, 200)}}, str(MAX_POINTS)),
        ({"scenario_id": "x", "vary": {"stride": (1.0, 2.0, 3)}}, "either scenario_id or scenario"),
    ],
)
def test_an_invalid_input_is_named(wrong: dict[str, Any], where: str) -> None:
    with pytest.raises(ValidationError, match=where):
        SweepInput.model_validate({"scenario": short_walk(), **wrong})


def test_the_scope_of_a_sweep_is_reported(tmp_path: Path) -> None:
    plain = SweepSummary.model_validate(
        sweep.run(task({"timing": (1.0, 1.0, 1)}), tmp_path, RecordedProgress(), 1).summary
    )
    assert plain.scope == "centre of mass"
    assert SweepSummary.model_validate({**plain.model_dump(exclude={"scope"})}).scope == "centre of mass"
    with pytest.raises(ValidationError, match="more than 500"):
        task({"timing": (1.0, 2.0, 501)}, whole_body=True)


def test_with_the_body_its_certificate_decides(tmp_path: Path) -> None:
    """Strides of 0.3 m pass; for strides of 0.8 m the centre of mass has a motion that the body cannot follow."""
    vary = {"stride": (0.3, 0.8, 2)}
    for name in "ab":
        (tmp_path / name).mkdir()
    alone = sweep.run(task(vary), tmp_path / "a", RecordedProgress(), 1)
    whole = sweep.run(task(vary, whole_body=True), tmp_path / "b", RecordedProgress(), 1)
    assert SweepSummary.model_validate(whole.summary).scope == "whole body"
    assert pq.read_table(tmp_path / "a" / "sweep.parquet")["outcome"].to_pylist() == ["feasible", "feasible"]
    table = pq.read_table(tmp_path / "b" / "sweep.parquet")
    assert table["outcome"].to_pylist() == ["feasible", "infeasible"]
    assert table["why"][1].as_py().startswith("The certificate fails: com_error_max")
    assert alone.summary["feasible"] == 2
