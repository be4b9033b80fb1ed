"""A film: pictures of the robot on its terrain, handed to ffmpeg; without that program, a sentence."""

import stat
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.robots.visuals import link_meshes
from stridelab.schemas.plans import Film
from stridelab.service.kinds.plan_motion import run as plan_motion
from stridelab.service.kinds.plan_motion import video
from stridelab.service.kinds.plan_motion.display_tracks import display_poses
from stridelab.service.kinds.plan_motion.video import (
    BACKGROUND_COLOUR,
    SIZE_PX,
    Camera,
    render_frames,
    require_film,
    write_film,
)
from support.command_line import RecordedProgress, quiet
from support.robots.plans import made_up_motion, one_step, plan_task, talos

FFMPEG = """#!/bin/sh
echo "$@" > arguments
wc -c > bytes
for path; do :; done
echo film > "$path"
"""


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of programs that is all that is found, but for those of the system."""
    folder = tmp_path / "programs"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    monkeypatch.chdir(tmp_path)
    return folder


def install(folder: Path, script: str) -> None:
    path = folder / "ffmpeg"
    path.write_text(script)
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


def poses() -> np.ndarray:
    return display_poses(talos(), made_up_motion().q[[0, 100]])


def test_without_ffmpeg_a_film_is_refused_before_any_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video.shutil, "which", lambda _: None)  # type: ignore[attr-defined]
    require_film(None)
    progress = RecordedProgress()
    with pytest.raises(NotEstimable) as refusal:
        plan_motion.run(plan_task(film="mp4"), tmp_path, progress)
    assert refusal.value.code == "film-unavailable"
    assert "apt-get install ffmpeg" in refusal.value.message
    assert progress.messages == []


@pytest.mark.parametrize("film", ["gif", "mp4"])
def test_every_frame_is_passed_to_ffmpeg(programs: Path, tmp_path: Path, film: Film) -> None:
    install(programs, FFMPEG)
    artifact = write_film(tmp_path, film, one_step().terrain, link_meshes(talos()), poses(), 25.0, quiet)
    assert (artifact.name, artifact.media_type) == (f"motion.{film}", video.MEDIA_TYPES[film])
    assert (tmp_path / artifact.name).is_file()
    assert int((tmp_path / "bytes").read_text()) == 2 * 3 * SIZE_PX[0] * SIZE_PX[1]
    arguments = (tmp_path / "arguments").read_text()
    assert f"-s {SIZE_PX[0]}x{SIZE_PX[1]} -r 25 -i -" in arguments


def test_the_last_line_of_ffmpeg_is_the_reason(programs: Path, tmp_path: Path) -> None:
    install(programs, "#!/bin/sh\necho 'Unknown encoder libx264' >&2\nexit 1\n")
    with pytest.raises(NotEstimable) as failure:
        write_film(tmp_path, "mp4", one_step().terrain, link_meshes(talos()), poses(), 25.0, quiet)
    assert failure.value.code == "film-failed"
    assert "Unknown encoder libx264" in failure.value.message
    assert not (tmp_path / "motion.mp4").exists()


def test_the_robot_stands_where_the_camera_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    link_poses = poses()
    camera = Camera.looking_at(link_poses[:1, :, :3].reshape(-1, 3))
    monkeypatch.setattr(Camera, "looking_at", staticmethod(lambda _: camera))
    link_poses[1] = np.nan  # a robot that is not there
    with_robot, without = (
        np.asarray(picture) for picture in render_frames(one_step().terrain, link_meshes(talos()), link_poses)
    )
    changed = np.argwhere((with_robot != without).any(axis=2))
    assert len(changed) > 0.02 * SIZE_PX[0] * SIZE_PX[1]
    assert np.abs(changed.mean(axis=0) - np.array([SIZE_PX[1], SIZE_PX[0]]) / 2.0).max() < 0.25 * SIZE_PX[1]
    assert (without == BACKGROUND_COLOUR).all(axis=2).any()


def test_nearer_objects_are_larger_and_the_middle_stays_in_the_middle() -> None:
    box = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-0.5, 0.5) for z in (0.0, 1.6)])
    camera = Camera.looking_at(box)
    pixels, depth = camera.project_points(box)
    assert (pixels > 0.0).all()
    assert (pixels < SIZE_PX).all()
    assert depth.min() > 0.0
    middle, _ = camera.project_points(box.mean(axis=0)[None])
    np.testing.assert_allclose(middle[0], np.array(SIZE_PX) / 2.0, atol=1e-6)
