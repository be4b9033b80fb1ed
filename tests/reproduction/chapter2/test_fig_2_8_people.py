"""Figure 2.8 on two real adults: what moves the thesis' estimate is the clock, and it moves it against the walk."""

import re
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import NotFound
from stridelab.reproduction.chapter2 import fig_2_8_people
from stridelab.reproduction.chapter2.fig_2_8_people import COMFORTABLE, WALK, Fused, fuse_walk
from stridelab.reproduction.common.recorded_walks import RecordedWalk, recordings_in
from support.recorded_claims import assert_as_recorded, assert_tables_as_recorded
from support.recordings.walks import cut_recording, link_adults

ADULTS = ("2014001", "2014015")


@pytest.fixture(scope="module")
def few(gait: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two adults, and a third one whose recording is cut."""
    folder = link_adults(gait, ADULTS, tmp_path_factory.mktemp("gait"))
    cut_recording(gait, folder, COMFORTABLE)
    return folder


@pytest.fixture(scope="module")
def walks(few: Path) -> list[Fused]:
    paths = [path for path in recordings_in(few, COMFORTABLE) if path.parent.name in ADULTS]
    return [fuse_walk(RecordedWalk.from_file(path)) for path in paths]


def test_a_late_force_moves_the_estimate_back_by_speed_times_delay(walks: list[Fused]) -> None:
    for one in walks:
        assert 0.008 < one.latency_s < 0.025
        moved = float(one.offset_m[WALK] - one.corrected_m[WALK])
        assert moved == pytest.approx(-one.speed_m_s * one.latency_s, abs=0.006)


def test_the_table_has_every_walk_with_the_speed_of_its_markers(few: Path, walks: list[Fused]) -> None:
    result = fig_2_8_people.run(few, lambda _fraction, _message: None)
    table = result.tables["walks"]
    assert sorted(set(table["person"])) == sorted(ADULTS)
    assert re.search(r"Left out: cut/2014001_C4_\w+\.c3d \(.*ends in the middle of its frames\)", result.note)
    slow, fast = (table["speed_m_s"][table["pace"] == pace] for pace in ("comfortable", "fast"))
    assert slow.mean() < fast.mean()
    com = walks[0].walk.geometric.com_m
    travelled_m = float(np.linalg.norm((com[-1] - com[0])[:2]))
    seconds = float(np.ptp(walks[0].walk.geometric.time_s))
    assert walks[0].speed_m_s == pytest.approx(travelled_m / seconds, rel=0.1)
    claims = {claim.key: claim for claim in result.claims}
    assert claims["horizontal_over_vertical"].verdict == "met"
    assert result.drawing.count("<g ") == 3
    assert_as_recorded(fig_2_8_people.NAME, result.claims)
    assert_tables_as_recorded(fig_2_8_people.NAME, result.tables)


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match="no recording"):
        fig_2_8_people.run(tmp_path, lambda _fraction, _message: None)
