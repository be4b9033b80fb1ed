"""Recordings of this machine as tasks: what those of one day share."""

import shutil
from pathlib import Path

from stridelab.schemas.recordings import SubjectFields
from stridelab.service.local_recordings import share_by_day, stage_walks
from support.command_line import SAMPLE


def test_recordings_of_one_day_are_of_one_session_and_unreadable_ones_of_none(tmp_path: Path) -> None:
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(b"no recording")
    work = tmp_path / "work"
    work.mkdir()
    walk = SAMPLE / "recording.c3d"
    again = Path(shutil.copyfile(walk, tmp_path / "again.c3d"))
    staged = stage_walks([walk, again, broken], work, SubjectFields(), None)
    assert all(one.session_id is None for one in staged)
    shared = share_by_day(staged, work)
    assert shared[0].session_id == shared[1].session_id
    assert shared[0].session_id
    assert shared[2].session_id is None
    assert [one.session_id for one in share_by_day(staged[:1], work)] == [None]


def test_equal_names_of_files_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    places = [tmp_path / name for name in ("monday/walk.c3d", "friday/walk.c3d", "friday/slow.c3d")]
    for place in places:
        place.parent.mkdir(exist_ok=True)
        place.write_bytes(b"no recording")
    staged = stage_walks(places, tmp_path, SubjectFields(), None)
    assert [one.task.recording.filename for one in staged] == ["monday-walk.c3d", "friday-walk.c3d", "slow.c3d"]
