"""Durations left to the solver: chosen within their range, followed by the whole body, stored as a scenario."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.validation.validate import validate_and_build
from stridelab.errors import NotEstimable
from stridelab.pipelines import plan_problem
from stridelab.pipelines.plan_problem import free_durations
from stridelab.schemas.plans import PlanMotionSummary
from stridelab.schemas.scenarios import Scenario
from stridelab.service.kinds.plan_motion import run as plan_motion
from support.command_line import quiet
from support.robots.plans import changed, plan_task, short_walk


def planned(folder: Path, **asked: Any) -> tuple[PlanMotionSummary, Scenario]:
    outcome = plan_motion.run(plan_task(free_durations=True, **asked), folder, quiet)
    summary = PlanMotionSummary.model_validate(outcome.summary)
    return summary, Scenario.model_validate_json((folder / "scenario.json").read_text())


@pytest.mark.parametrize("formulation", ["forces", "wrench"])
def test_the_solver_chooses_within_the_range_and_it_costs_less(tmp_path: Path, formulation: str) -> None:
    summary, stored = planned(tmp_path, formulation=formulation, duration_range=(0.8, 1.3), whole_body=False)
    assert summary.converged
    assert summary.phase_durations is not None
    given = np.array([phase.given_s for phase in summary.phase_durations])
    chosen = np.array([phase.chosen_s for phase in summary.phase_durations])
    assert given.tolist() == [phase.duration_s for phase in short_walk().phases]
    assert chosen.tolist() == [phase.duration_s for phase in stored.phases]
    assert (chosen / given).min() >= 0.8 - 1e-9
    assert (chosen / given).max() <= 1.3 + 1e-9
    assert np.abs(chosen / given - 1.0).max() > 0.1
    assert chosen.sum() == pytest.approx(given.sum())
    as_given = plan_motion.run(plan_task(formulation=formulation, whole_body=False), tmp_path, quiet).summary
    assert as_given["phase_durations"] is None
    assert sum(summary.cost_terms.values()) < sum(as_given["cost_terms"].values())


def test_the_body_follows_the_chosen_durations_and_the_stored_scenario_is_valid(tmp_path: Path) -> None:
    summary, stored = planned(tmp_path, replay=True)
    assert summary.certificate is not None
    assert summary.certificate.passed
    assert summary.replay is not None
    assert summary.replay.completed
    assert stored.model_copy(update={"phases": []}) == short_walk().model_copy(update={"phases": []})
    report, _ = validate_and_build(stored.model_dump(mode="json"), effector_shapes(stored.robot))
    assert not report.faults
    ends_s = np.cumsum([phase.duration_s for phase in stored.phases])
    for table in ("centroidal", "motion"):
        rows = pq.read_table(tmp_path / f"{table}.parquet", columns=["time_s", "phase"]).to_pydict()
        time_s, phase = np.array(rows["time_s"][:-1]), np.array(rows["phase"][:-1])
        distinct = np.abs(time_s[:, None] - ends_s).min(axis=1) > 1e-5  # beside an end rounding decides
        assert (phase == np.searchsorted(ends_s, time_s + 1e-6))[distinct].all(), table
        assert distinct.mean() > 0.5
    again = plan_motion.run(plan_task(stored), tmp_path, quiet).summary
    assert again["objective"] == pytest.approx(summary.objective, abs=0.1)  # on a grid of its own


def test_no_phase_becomes_shorter_than_a_scenario_may_have_it() -> None:
    hasty = changed(short_walk(), lambda body: body["phases"][2].__setitem__("duration_s", 0.06))
    sequence = sequence_of(hasty.model_dump(mode="json"), effector_shapes("talos"))
    free = free_durations(plan_task(hasty, free_durations=True).input, sequence)
    assert free is not None
    assert free.shortest == pytest.approx(0.05 / 0.06)
    assert free.longest == 1.4
    assert free_durations(plan_task(hasty).input, sequence) is None


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"solver": "fatrop"}, "free_durations"),
        ({"formulation": "circular-cones", "solver": "casadi"}, "free_durations"),
        ({"formulation": "circular-cones", "solver": "ipopt"}, "free_durations"),
        ({"duration_range": (1.2, 1.4)}, "duration_range"),
        ({"duration_range": (0.7, 0.9)}, "duration_range"),
        ({"duration_range": (0.0, 1.4)}, "duration_range"),
    ],
)
def test_what_cannot_be_chosen_is_named(asked: dict[str, Any], named: str) -> None:
    with pytest.raises(ValidationError, match=named):
        plan_task(free_durations=True, **asked)


def test_circular_cones_want_the_native_solver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task = plan_task(whole_body=False, free_durations=True, formulation="circular-cones")
    monkeypatch.setattr(plan_problem, "native_unavailable_reason", lambda: "It was not built.")
    with pytest.raises(NotEstimable) as refused:
        plan_motion.run(task, tmp_path, quiet)
    assert refused.value.code == "solver-unavailable"
    assert refused.value.faults[0].where == "free_durations"


@pytest.mark.skipif(isinstance(native_availability(), NativeUnavailable), reason="no native solver")
def test_the_native_solver_chooses_them_in_circular_cones(tmp_path: Path) -> None:
    task = plan_task(short_walk(), whole_body=False, free_durations=True, formulation="circular-cones")
    summary = PlanMotionSummary.model_validate(plan_motion.run(task, tmp_path, quiet).summary)
    assert summary.solver == "native"
    assert summary.formulation == "circular-cones"
    assert summary.phase_durations is not None
