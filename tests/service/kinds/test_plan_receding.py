"""``plan-receding``: a walk carried out period by period, pushed on the way, as a table and a summary."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from stridelab.centroidal.receding_horizon import State
from stridelab.errors import InvalidInput
from stridelab.pipelines.plan_problem import native_unavailable_reason
from stridelab.pipelines.plan_receding import push_disturbance
from stridelab.robots.loader import load_robot
from stridelab.schemas.receding import PlanRecedingInput, PlanRecedingSummary, Push
from stridelab.schemas.scenarios import Scenario
from stridelab.service.kinds.plan_receding.run import run
from stridelab.service.kinds.registry import KINDS
from stridelab.service.processes.child import with_json
from support.command_line import RecordedProgress
from support.robots.plans import changed, short_walk

PERIOD_S = 0.2
FILES = {"receding.parquet", "receding.csv", "centroidal.parquet", "centroidal.csv", "scenario.json"}


def carried_out(folder: Path, scenario: Scenario, **options: Any) -> tuple[PlanRecedingSummary, Any]:
    input_ = PlanRecedingInput(scenario=scenario, period_s=PERIOD_S, **options)
    task = {"scenario": scenario.model_dump(mode="json"), "input": input_.model_dump(mode="json")}
    folder.mkdir(exist_ok=True)
    progress = RecordedProgress()
    outcome = with_json(run)(task, folder, progress)
    assert progress.fractions[-1] == 1.0
    assert {item["name"] for item in outcome["artifacts"]} == FILES
    return PlanRecedingSummary.model_validate(outcome["summary"]), pq.read_table(folder / "receding.parquet")


def test_the_registry_names_it() -> None:
    assert KINDS["plan-receding"].run == f"{run.__module__}:{run.__name__}"


def test_a_push_moves_the_centre_of_mass_and_is_recovered_from(tmp_path: Path) -> None:
    """The velocity jumps by the push, and the motion ends where it would have without it."""
    walk = short_walk()
    calm, table = carried_out(tmp_path / "calm", walk)
    push = {"time_s": 1.1, "velocity_m_s": (0.0, 0.06, 0.0)}
    summary, other = carried_out(tmp_path / "pushed", walk, pushes=[push])
    time_s = table["time_s"].to_numpy()
    assert summary.replans == calm.replans == len(time_s) - 1
    assert (summary.carried_on, calm.carried_on) == (0, 0)
    assert summary.solver == ("ipopt" if native_unavailable_reason() else "native")
    assert max(summary.goal_gap_m, calm.goal_gap_m) < 1e-3
    apart = other["com_vy_m_s"].to_numpy() - table["com_vy_m_s"].to_numpy()
    at = int(np.searchsorted(time_s, 1.1))
    assert time_s[at] == pytest.approx(1.2)
    assert np.abs(apart[:at]).max() < 1e-6
    assert apart[at] == pytest.approx(0.06, abs=1e-6)
    assert abs(apart[-1]) < 1e-3
    assert summary.replan_median_ms <= summary.replan_p99_ms <= summary.replan_max_ms
    assert np.nanmedian(other["iterations"].to_numpy()) == summary.iterations_median


def test_the_executed_motion_has_the_files_of_a_plan(tmp_path: Path) -> None:
    """Between rows the forces hold: they integrate to the next row, but for the push, and lie in the friction cones."""
    walk = short_walk()
    push = {"time_s": 1.1, "velocity_m_s": (0.0, 0.06, 0.0)}
    _, periods = carried_out(tmp_path / "out", walk, pushes=[push])
    assert Scenario.model_validate_json((tmp_path / "out" / "scenario.json").read_text()) == walk
    table = pq.read_table(tmp_path / "out" / "centroidal.parquet")
    rows = {name: table[name].to_numpy() for name in table.column_names}
    t = rows["time_s"]
    assert (np.diff(t) > 1e-6).all()
    assert t[-1] == pytest.approx(sum(phase.duration_s for phase in walk.phases))
    assert np.isin(periods["time_s"].to_numpy().round(9), t.round(9)).all()
    vy, ay = rows["com_vy_m_s"], rows["com_ay_m_s2"]
    jump = vy[1:] - vy[:-1] - np.diff(t) * ay[:-1]
    assert t[1 + int(np.argmax(jump))] == pytest.approx(1.2)
    assert jump.max() == pytest.approx(0.06, abs=1e-6)
    assert np.abs(np.delete(jump, np.argmax(jump))).max() < 1e-6
    mass_kg = load_robot("talos").mass_kg
    feet = {"left_foot", "right_foot"}
    total = sum(rows[f"f_{foot}_{k}_z_n"] for foot in feet for k in range(4))
    assert np.abs(total / mass_kg - 9.81 - rows["com_az_m_s2"]).max() < 1e-6
    touching = [{c.effector for c in walk.phases[k].contacts} for k in rows["phase"]]
    for foot in feet:
        down = np.array([foot in there for there in touching])
        load = sum(rows[f"f_{foot}_{k}_z_n"] for k in range(4))
        assert (load[~down] == 0.0).all()
        assert (rows[f"friction_{foot}"] == np.where(down, 0.3, 0.0)).all()


def test_pushes_belong_to_the_period_that_they_are_in() -> None:
    state = State(np.zeros(3), np.zeros(3), np.zeros(3))
    disturb = push_disturbance([Push(time_s=t, velocity_m_s=(1.0, 0.0, 0.0)) for t in (0.0, 0.2, 0.25, 0.9)], PERIOD_S)
    felt = [float(disturb(k * PERIOD_S, state).com_v_m_s[0]) for k in range(1, 6)]
    assert sum(felt) == 4.0
    assert felt == [1.0, 2.0, 0.0, 0.0, 1.0]


def test_a_scenario_that_cannot_be_done_leaves_nothing(tmp_path: Path) -> None:
    lifted = changed(short_walk(), lambda s: s["phases"][0]["contacts"][0].update(position_m=[0.0, 0.09, 0.3]))
    with pytest.raises(InvalidInput, match=r"phases\[0\]"):
        carried_out(tmp_path, lifted)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "wrong",
    [{"period_s": 2.5}, {"horizon_s": 0.1}, {"pushes": [{"time_s": -1.0, "velocity_m_s": (0.0, 0.0, 0.0)}]}, {}],
)
def test_an_invalid_horizon_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        PlanRecedingInput.model_validate({"scenario_id": "flat-walk", **wrong} if wrong else {})
