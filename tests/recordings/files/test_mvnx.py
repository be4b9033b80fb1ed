"""MVNX files: points by segment pose, the computed centre of mass, and files that cannot be used."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stridelab.body.segment_model import SegmentModel
from stridelab.errors import UnreadableFile
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, Subject
from support.recordings.export_files import COM_M, POINT_M, RATE_HZ, SEGMENTS, SPEED_M_S, mvnx_text, yaw_rad

N = 60
FRAMES = np.arange(N)
SHIFT = np.column_stack([SPEED_M_S * FRAMES / RATE_HZ, 0 * FRAMES, 0 * FRAMES])


def read(folder: Path, text: str, name: str = "walk.mvnx") -> Recording:
    (folder / name).write_text(text, encoding="utf-8")
    return read_recording(folder / name)


def test_the_points_turn_with_their_segments(tmp_path: Path) -> None:
    recording = read(tmp_path, mvnx_text())
    assert set(recording.markers_m) == {f"p{name}" for name in SEGMENTS}
    turned = Rotation.from_euler("z", yaw_rad(FRAMES)[:, None]).apply(POINT_M)
    for name, place in SEGMENTS.items():
        np.testing.assert_allclose(recording.markers_m[f"p{name}"], place + SHIFT + turned, atol=1e-6)
    assert (recording.marker_rate_hz, recording.up_axis, recording.recorded_on) == (RATE_HZ, "+z", "2025-11-27")
    assert {remark.code for remark in recording.remarks} >= {"no-force-file", "own-com"}
    assert "Anna" not in repr(recording)


@pytest.mark.parametrize("listed", [True, False])
def test_without_points_the_joints_are_used(tmp_path: Path, listed: bool) -> None:
    text = mvnx_text(points=False, listed=listed)
    if not listed:  # the order of MVN's 23 segments
        with pytest.raises(UnreadableFile, match="names 23 of 17 segments"):
            read(tmp_path, text)
        return
    recording = read(tmp_path, text)
    assert identify(list(recording.markers_m)).name == "xsens-segments"
    np.testing.assert_allclose(recording.markers_m["LeftFoot"], SEGMENTS["LeftFoot"] + SHIFT, atol=1e-8)


def test_the_computed_centre_of_mass_is_a_model_point_and_the_table_carried(tmp_path: Path) -> None:
    recording = read(tmp_path, mvnx_text(points=False))
    np.testing.assert_allclose(recording.model_points_m["CentreOfMass"], COM_M + SHIFT, atol=1e-8)
    landmarks = identify(list(recording.markers_m)).landmarks
    own = SegmentModel("carried").com(recording, landmarks, subject=Subject())
    np.testing.assert_allclose(own.com_m, COM_M + SHIFT, atol=1e-8)
    assert own.table == "carried"
    ours = SegmentModel().com(recording, landmarks, subject=Subject(height_m=1.75, mass_kg=70.0, sex="male"))
    assert ours.table == "dumas2007"
    assert np.abs(ours.com_m - own.com_m).max() < 0.1


def test_a_file_without_a_centre_of_mass_is_read(tmp_path: Path) -> None:
    assert read(tmp_path, mvnx_text(com=False)).model_points_m == {}


GOOD = mvnx_text(n_frames=10)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (mvnx_text(n_frames=10, head='<!DOCTYPE mvnx [<!ENTITY a "b">]>'), "document type"),
        (GOOD[:-40], "not well-formed"),
        (GOOD.replace("frameRate='60'", "frameRate='often'"), "frameRate"),
        (GOOD.replace("frameRate='60'", "frameRate='0'"), "0 frames per second"),
        (GOOD.replace("segmentCount='17'", "segmentCount='999999'"), "999999 segments"),
        (GOOD.replace("segmentCount='17'", "segmentCount='3'"), "17 of 3 segments"),
        (GOOD.replace("type='normal'", "type='tpose'"), "no frames of motion"),
        (GOOD.replace("<position>", "<position>1 ", 5), "position has 52 of 51"),
        (GOOD.replace("<orientation>1.0", "<orientation>nan 1.0", 1), "orientation"),
        (GOOD.replace("<orientation>1.000000000 ", "<orientation>0 ", 1), "no unit quaternion"),
        (GOOD.replace("<centerOfMass>", "<centerOfMass>much ", 1), "not a number"),
        (GOOD.replace("<subject", "<person").replace("</subject", "</person"), "no subject"),
    ],
)
def test_a_broken_file_is_refused_with_the_reason(tmp_path: Path, text: str, why: str) -> None:
    assert text != GOOD
    with pytest.raises(UnreadableFile, match=why) as refused:
        read(tmp_path, text)
    assert refused.value.code == "mvnx-broken"
    assert "walk.mvnx" in refused.value.message
