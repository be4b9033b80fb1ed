"""Which files of folders and zips are recordings: C3D, TRC alone, and zips; exports of a trial count once."""

import zipfile
from pathlib import Path

import pytest

from stridelab.errors import UnreadableFile
from stridelab.recordings.files.batch_zip import BatchLimits, is_batch, unpack_batch
from stridelab.recordings.files.recording_files import recordings_in

LIMITS = BatchLimits(files=10, file_bytes=10_000, total_bytes=100_000)
GRF = "grf\nnRows=1\nendheader\ntime\tground_force_vx\n0\t0\n"
ANGLES = "angles\nnRows=1\nendheader\ntime\tknee_angle\n0\t0\n"


def packed(folder: Path, *names: str, **texts: str) -> Path:
    path = folder / "lab.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, texts.get(name.replace(".", "_").replace("/", "_"), name))
    return path


def unpacked(folder: Path, path: Path) -> list[str]:
    target = folder / "out"
    target.mkdir()
    return [name for name, _ in unpack_batch(path, target, LIMITS).files]


def test_a_folder_gives_its_recordings_and_no_trial_twice(tmp_path: Path) -> None:
    names = [
        "a/walk1.c3d",
        "a/walk1.trc",
        "a/walk2.trc",
        "a/walk2.mot",
        "a/b/Walk3.TRC",
        "a/b/Walk3.zip",
        "a/b/walk1.trc",
    ]
    for name in [*names, "a/notes.txt"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    paths = [path.relative_to(tmp_path).as_posix() for path in recordings_in(tmp_path)]
    assert paths == ["a/b/Walk3.zip", "a/b/walk1.trc", "a/walk1.c3d", "a/walk2.trc"]


@pytest.mark.parametrize(
    ("names", "batch"),
    [
        (("a.trc", "a.mot"), False),
        (("a.trc",), False),
        (("a.mot",), False),
        (("a.trc", "b.trc"), True),
        (("a.trc", "b.c3d"), True),
        (("a.c3d",), True),
        (("a.trc", "__MACOSX/._b.trc"), False),
    ],
)
def test_one_trc_is_a_trial_and_several_are_many(names: tuple[str, ...], batch: bool, tmp_path: Path) -> None:
    assert is_batch(packed(tmp_path, *names)) == batch


def test_several_trc_files_are_unpacked(tmp_path: Path) -> None:
    path = packed(tmp_path, "lab/a.trc", "lab/b.trc", "lab/b.c3d", "lab/a_ik.mot", lab_a_ik_mot=ANGLES)
    assert unpacked(tmp_path, path) == ["lab/a.trc", "lab/b.c3d"]


@pytest.mark.parametrize("beside", ["b.trc", "b.c3d"])
def test_forces_are_not_left_out_silently(beside: str, tmp_path: Path) -> None:
    path = packed(tmp_path, "a.trc", "trial_7_grf.mot", beside, trial_7_grf_mot=GRF)
    with pytest.raises(UnreadableFile) as refusal:
        unpacked(tmp_path, path)
    assert refusal.value.code == "zip-several-trials"
    assert [fault.where for fault in refusal.value.faults] == ["trial_7_grf.mot"]


def test_forces_of_the_same_name_are_unpacked_with_their_trial(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    path = packed(tmp_path, "p/a.trc", "p/a_grf.mot", "p/b.trc", "p/a_ik.mot", p_a_grf_mot=GRF, p_a_ik_mot=ANGLES)
    files = dict(unpack_batch(path, tmp_path / "out", LIMITS).files)
    assert sorted(files) == ["p/a.trc", "p/b.trc"]
    with zipfile.ZipFile(files["p/a.trc"]) as trial:
        assert {name: trial.read(name).decode() for name in trial.namelist()} == {"a.trc": "p/a.trc", "a_grf.mot": GRF}
    assert files["p/b.trc"].read_text() == "p/b.trc"
    assert sorted(one.name for one in (tmp_path / "out").iterdir()) == ["member-0000", "member-0001"]


def test_forces_count_for_the_limits_of_a_zip(tmp_path: Path) -> None:
    path = packed(tmp_path, "a.trc", "a_grf.mot", "b.trc", a_grf_mot=GRF + "0\t0\n" * 3000)
    with pytest.raises(UnreadableFile) as refusal:
        unpacked(tmp_path, path)
    assert refusal.value.code == "zip-bomb"


def test_forces_beside_c3d_files_alone_do_no_harm(tmp_path: Path) -> None:
    path = packed(tmp_path, "a.c3d", "a.trc", "a_grf.mot", a_grf_mot=GRF)
    assert unpacked(tmp_path, path) == ["a.c3d"]
