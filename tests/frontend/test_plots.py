"""What the plots get is what the file holds."""

from collections.abc import Callable

import httpx
import numpy as np

from stridelab_web import plots
from stridelab_web.tables import read_columns
from support.fake_service import FakeService, com_m


def test_plot_values_are_those_of_the_file(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    job = fake.add_job(state="succeeded")
    answer = browse(f"/jobs/{job.id}/plots.json").json()
    columns, table = answer["columns"], read_columns(fake.com)
    assert answer["shades_s"] == [[0.6, 2.4]]
    assert [row["title"][:5] for row in answer["rows"]] == ["CoM x", "CoM y", "CoM z", "Veloc", "Groun"]
    assert all(trace["key"] in columns for row in answer["rows"] for trace in row["traces"])
    assert np.abs(np.array(columns["time_s"]) - table["time_s"]).max() < 1e-9
    truth = com_m(np.array(columns["time_s"]))
    for k, axis in enumerate("xyz"):
        assert np.abs(np.array(columns[f"{axis}_m"]) - truth[:, k]).max() <= 0.5e-5 + 1e-12
        assert np.abs(np.array(columns[f"geometry_{axis}_m"]) - truth[:, k] - 0.01).max() <= 1e-5
        assert set(columns[f"sd_{axis}_m"]) == {0.004}


def test_missing_values_become_null_and_empty_columns_go() -> None:
    nan = np.full(3, np.nan)
    columns = {"time_s": np.arange(3.0), "x_m": np.array([1.0, np.nan, 3.0]), "y_m": nan, "other": nan}
    drawn = plots.curves(columns, (0.0, 2.0))
    assert drawn["columns"] == {"time_s": [0.0, 1.0, 2.0], "x_m": [1.0, None, 3.0]}
    assert [[trace["key"] for trace in row["traces"]] for row in drawn["rows"]] == [["x_m"]]
    assert [reading["key"] for reading in drawn["readings"]] == ["x_m"]


def test_long_recordings_are_thinned_evenly() -> None:
    n = 5 * plots.SAMPLES_AT_MOST + 1
    drawn = plots.curves({"time_s": np.arange(n) / 100, "x_m": np.arange(n) * 1.0}, (0.0, 1.0))["columns"]
    assert len(drawn["time_s"]) <= plots.SAMPLES_AT_MOST
    assert drawn["x_m"][:3] == [0.0, 6.0, 12.0]
