"""The day of a recording is read where the file states it without doubt, and nowhere else."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stridelab.recordings.files.metadata import recorded_on
from stridelab.recordings.reader import read_recording
from support.recordings.c3d_files import write_file

POINTS = {"LASI": np.ones((20, 3)), "RASI": np.full((20, 3), 2.0)}


@pytest.mark.parametrize(
    ("place", "value", "day"),
    [
        (("TRIAL", "DATE"), [2019, 5, 24], "2019-05-24"),
        (("TRIAL", "DATE"), ["2019-05-24"], "2019-05-24"),
        (("TRIAL", "DATE"), ["20190524T151357"], "2019-05-24"),
        (("MANUFACTURER", "DATE"), ["2021/11/02 08:15"], "2021-11-02"),
        (("TRIAL", "DATE"), ["05/06/2019"], ""),
        (("TRIAL", "DATE"), [0, 0, 0], ""),
        (("TRIAL", "DATE"), [2019, 13, 1], ""),
        (("TRIAL", "DATE"), [1899, 12, 30], ""),
        (("TRIAL", "TIME"), [15, 13, 57], ""),
    ],
)
def test_the_recording_day_is_read_from_the_file(tmp_path: Path, place: tuple[str, str], value: Any, day: str) -> None:
    path = write_file(tmp_path / "walk.c3d", POINTS, parameters={place: value})
    assert read_recording(path).recorded_on == day


def test_a_date_that_is_no_number_is_no_date() -> None:
    assert recorded_on(lambda _g, _n: [], lambda _g, _n: [2019.5, 5.0, 24.0]) == ""


def test_bts_states_the_day(gait: Path) -> None:
    assert read_recording(gait / "ezc3d-testfiles" / "BTS.c3d").recorded_on == "2019-05-24"
    assert read_recording(gait / "ezc3d-testfiles" / "Qualisys.c3d").recorded_on == ""
