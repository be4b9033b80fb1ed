"""The plan's and the motion's tables: every column where and what the contract says, at the right instant."""

from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from stridelab.centroidal.nlp.kkt import Attempt, IterationLog
from stridelab.service.kinds.plan_motion.files import write_plan
from stridelab.service.kinds.plan_motion.tables import (
    centroidal_columns,
    iteration_columns,
    motion_columns,
    phase_indices,
)
from stridelab.service.kinds.result_tables import read_metadata
from support.robots.plans import made_up_motion, made_up_plan, one_step, talos

AXES = "xyz"


def test_centroidal_has_the_contracts_columns_and_units(tmp_path: Path) -> None:
    plan = made_up_plan()
    write_plan(tmp_path, plan)
    table = pq.read_table(tmp_path / "centroidal.parquet")
    expected = ["time_s", "phase", *(f"com_{a}_m" for a in AXES), *(f"com_v{a}_m_s" for a in AXES)]
    expected += [*(f"com_a{a}_m_s2" for a in AXES), *(f"l_{a}_nms" for a in AXES)]
    expected += [f"f_{foot}_{k}_{a}_n" for foot in ("left_foot", "right_foot") for k in range(4) for a in AXES]
    expected += ["friction_left_foot", "friction_right_foot"]
    assert table.column_names == expected
    units = read_metadata(tmp_path / "centroidal.parquet")["units"]
    expected_units = {
        "com_x_m": "m",
        "com_vx_m_s": "m/s",
        "com_ax_m_s2": "m/s^2",
        "l_x_nms": "N m s",
        "f_left_foot_0_x_n": "N",
    }
    assert {name: units[name] for name in expected_units} == expected_units
    assert read_metadata(tmp_path / "iterations.parquet")["units"]["cost_s"] == "s"
    twin = pyarrow.csv.read_csv(tmp_path / "centroidal.csv")
    assert twin.column_names == expected
    for name in expected:
        np.testing.assert_allclose(twin[name].to_numpy(), table[name].to_numpy(), rtol=1e-12)


def test_interval_values_stand_at_the_start_of_the_interval_and_the_last_row_repeats() -> None:
    plan = made_up_plan()
    columns = centroidal_columns(plan)
    assert len({len(column) for column in columns.values()}) == 1
    at = int(np.searchsorted(plan.time_s, 0.5))
    assert plan.time_s[at] == 0.5
    assert columns["phase"][at - 1 : at + 1].tolist() == [0, 1]
    # the force changes at the node at which the foot leaves: corner 3 carries 4 of 10 parts of half the weight
    right = columns["f_right_foot_3_z_n"]
    assert right[at - 1 : at + 1] == pytest.approx([880.0 * 0.5 * 0.4, 0.0])
    friction = plan.sequence.phases[0].contacts["right_foot"].friction
    assert columns["friction_right_foot"][at - 1 : at + 1].tolist() == [friction, 0.0]
    for name in ("phase", "com_ax_m_s2", "f_left_foot_0_y_n"):
        assert columns[name][-1] == columns[name][-2]
    assert columns["com_x_m"][-1] == plan.com_m[-1, 0]
    assert np.isfinite(np.column_stack(list(columns.values()))).all(), "there is nothing that is not known"


def test_iterations_of_all_attempts_stand_one_after_the_other() -> None:
    def attempt(n: int) -> Attempt:
        log = IterationLog(*(np.arange(n) + k for k in (-10.0, 0.5, 0.25, 0.125)))
        return Attempt("ipopt", "stopped", False, max(n - 1, 0), 0.0, 0.0, None, log)

    columns = iteration_columns([attempt(3), attempt(0), attempt(2)])
    assert columns["attempt"].tolist() == [0, 0, 0, 2, 2]
    assert columns["iteration"].tolist() == [0, 1, 2, 0, 1]
    assert columns["cost_s"].tolist() == [-10.0, -9.0, -8.0, -10.0, -9.0]
    assert columns["primal_infeasibility"][-1] == 1.5
    assert {len(column) for column in iteration_columns([]).values()} == {0}


def test_the_motion_stands_beside_its_reference() -> None:
    motion = made_up_motion()
    limits = np.asarray(talos().model.effortLimit)[6:]
    columns = motion_columns(motion, limits)
    assert columns["com_error_m"] == pytest.approx(np.full(501, 5e-4))
    np.testing.assert_array_equal(
        columns["com_reference_z_m"] - columns["com_z_m"], motion.com_reference_m[:, 2] - 0.86
    )
    assert columns["f_left_foot_z_n"][[0, 250]] == pytest.approx([440.0, 880.0])
    assert columns["f_right_foot_z_n"][250] == 0.0
    joint = int(np.argmax(np.abs(motion.tau_nm[100]) / limits))
    assert columns["torque_ratio"][100] == abs(motion.tau_nm[100, joint]) / limits[joint]


def test_a_boundary_belongs_to_the_phase_that_begins_there_also_where_floats_fall_short() -> None:
    sequence = one_step()
    time_s = np.array([0.0, 0.5 - 1e-6, 0.5 - 1e-12, 0.5, 1.5, 2.0])
    assert phase_indices(sequence, time_s).tolist() == [0, 0, 1, 1, 2, 2]
