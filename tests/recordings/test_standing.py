"""Static trials are distinguished from others by their markers alone."""

from pathlib import Path

import numpy as np
import pytest

from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, Subject
from stridelab.recordings.static_pose import stands_still


def moving(amplitude_m: float, markers: int = 40, lost: int = 0, n: int = 300) -> Recording:
    """Markers that sway along x, of which ``lost`` jump to another place for a fifth of the time."""
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 2 * np.pi, n)
    tracks = {}
    for i in range(markers):
        track = rng.uniform(-1, 1, 3) + np.outer(amplitude_m * np.sin(t + i), [1.0, 0.0, 0.0])
        if i < lost:
            track[: n // 5] += 0.4
        tracks[f"M{i}"] = track
    return Recording(tracks, 100.0, 1000.0, (), Subject(), (), "+z", None)


@pytest.mark.parametrize(("amplitude_m", "still"), [(0.0, True), (0.02, True), (0.2, False), (1.0, False)])
def test_sway_is_standing_and_steps_are_not(amplitude_m: float, still: bool) -> None:
    assert stands_still(moving(amplitude_m)) is still


def test_one_frame_is_a_static_trial_and_no_marker_is_none() -> None:
    assert stands_still(moving(1.0, n=1))
    assert not stands_still(moving(0.0, markers=0))


def test_a_mislabelled_marker_does_not_make_a_static_trial_move() -> None:
    assert stands_still(moving(0.01, lost=1))
    assert not stands_still(moving(0.01, lost=10))


def test_hidden_frames_do_not_count() -> None:
    recording = moving(0.01)
    for track in recording.markers_m.values():
        track[100:150] = np.nan
    recording.markers_m["M0"][:] = np.nan
    assert stands_still(recording)


def test_real_statics_stand_and_real_walks_do_not(gait: Path) -> None:
    """7 children, one of them restless, two adults; walks from 0.2 to 2.2 m/s, a turn, stairs, a treadmill."""
    still = {p.name for p in sorted(gait.rglob("*.c3d")) if stands_still(read_recording(p))}
    statics = {p.name for p in gait.rglob("*.c3d") if "_ST" in p.name or p.name.startswith("Static")}
    assert len(statics) == 19
    assert still - {"FP_Type3.c3d"} == statics  # FP_Type3 is a file of two frames
