"""What the plots get is what the file holds."""

from collections.abc import Callable

import httpx
import numpy as np

from stridelab_web.charts import plotly
from stridelab_web.pages.results.com_plots import com_curves
from stridelab_web.parquet import read_columns
from support.fakes.recorded_walk import SD_M, com_m
from support.fakes.service import FakeService


def test_plot_values_are_those_of_the_file(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    job = fake.add_job(state="succeeded")
    answer = browse(f"/jobs/{job.id}/plots.json").json()
    columns, table = answer["columns"], read_columns(fake.com)
    assert answer["shades_s"] == [[0.6, 2.4]]
    assert [row["title"].partition(" [")[0] for row in answer["rows"]] == [
        "CoM x", "CoM y", "CoM z", "Velocity", "Force x", "Force y", "Force z",
    ]  # fmt: skip
    assert all(trace["key"] in columns for row in answer["rows"] for trace in row["traces"])
    assert np.abs(np.array(columns["time_s"]) - table["time_s"]).max() < 1e-9
    truth = com_m(np.array(columns["time_s"]))
    for k, axis in enumerate("xyz"):
        assert np.abs(np.array(columns[f"{axis}_m"]) - truth[:, k]).max() <= 0.5e-5 + 1e-12
        assert np.abs(np.array(columns[f"geometry_{axis}_m"]) - truth[:, k] - 0.01).max() <= 1e-5
        assert set(columns[f"sd_{axis}_m"]) == {SD_M[k]}


def test_the_three_inputs_can_be_switched(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    job = fake.add_job(state="succeeded")
    answer = browse(f"/jobs/{job.id}/plots.json").json()
    keys = {
        switch["key"]: {t["key"] for row in answer["rows"] for t in row["traces"] if t["group"] == switch["key"]}
        for switch in answer["switches"]
    }
    assert keys == {
        "geometry": {"geometry_x_m", "geometry_y_m", "geometry_z_m"},
        "force": {"force_x_n", "force_y_n", "force_z_n"},
        "axis": {"axis_x_m", "axis_y_m", "axis_z_m"},
    }
    assert answer["x"] == {"key": "time_s", "title": "time [s]", "name": "t", "unit": "s", "digits": 3, "log": False}


def test_the_force_of_the_fused_motion_is_mass_times_its_acceleration_against_gravity() -> None:
    t = np.arange(200) / 100
    columns = {"time_s": t, "ax_m_s2": t * 0 + 1.0, "ay_m_s2": t * 0 - 2.0, "az_m_s2": t * 0 + 0.5}
    drawn = com_curves(columns, {"mass_kg": 50.0, "window_s": (0.0, 1.0)})
    assert {row["title"]: {t["key"] for t in row["traces"]} for row in drawn["rows"]} == {
        f"Force {axis} [N]": {f"fused_force_{axis}_n"} for axis in "xyz"
    }
    assert drawn["switches"] == [], "nothing measured, nothing to switch"
    for axis, force_n in zip("xyz", (50.0, -100.0, 50.0 * (0.5 + 9.81)), strict=True):
        assert set(drawn["columns"][f"fused_force_{axis}_n"]) == {force_n}


def test_without_a_mass_no_force_of_the_motion_is_drawn() -> None:
    columns = {"time_s": np.arange(3.0), "x_m": np.ones(3), **{f"a{axis}_m_s2": np.ones(3) for axis in "xyz"}}
    drawn = com_curves(columns, {"mass_kg": None, "window_s": (0.0, 2.0)})
    assert [row["title"] for row in drawn["rows"]] == ["CoM x [m]"]


def test_missing_values_become_null_and_empty_columns_go() -> None:
    nan = np.full(3, np.nan)
    columns = {"time_s": np.arange(3.0), "x_m": np.array([1.0, np.nan, 3.0]), "y_m": nan, "other": nan}
    drawn = com_curves(columns, {"mass_kg": 60.0, "window_s": (0.0, 2.0)})
    assert drawn["columns"] == {"time_s": [0.0, 1.0, 2.0], "x_m": [1.0, None, 3.0]}
    assert [[trace["key"] for trace in row["traces"]] for row in drawn["rows"]] == [["x_m"]]
    assert [reading["key"] for reading in drawn["readings"]] == ["x_m"]


def test_long_recordings_are_thinned_evenly() -> None:
    n = 5 * plotly.MAX_SAMPLES + 1
    summary = {"mass_kg": 60.0, "window_s": (0.0, 1.0)}
    drawn = com_curves({"time_s": np.arange(n) / 100, "x_m": np.arange(n) * 1.0}, summary)["columns"]
    assert len(drawn["time_s"]) <= plotly.MAX_SAMPLES
    assert drawn["x_m"][:3] == [0.0, 6.0, 12.0]
