"""The wheel in the scene rolls on its line without slipping, with its point where the table has it."""

import itertools

import numpy as np
import pytest

from stridelab_web.parquet import read_columns
from stridelab_web.scene import com_frames, cycloid_frames
from stridelab_web.scene.frames import Frames
from stridelab_web.scene.recording_frames import build_frames
from stridelab_web.viewer import meshes
from support.fakes.recorded_walk import DURATION_S, RATE_HZ, SIDE_Y_M, STEPS_S, WHEELS, samples
from support.fakes.service import FakeService

T = np.arange(int(RATE_HZ * DURATION_S)) / RATE_HZ


def rotated(wxyz: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """``vector`` turned by a quaternion (Rodrigues)."""
    w, axis = wxyz[0], wxyz[1:]
    return np.asarray(vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector))


@pytest.fixture
def frames(fake: FakeService) -> Frames:
    return build_frames(fake.add_recording(), read_columns(fake.tracks), None, read_columns(fake.wheel))


def inside(k: int) -> np.ndarray:
    """Frames of step ``k``: its first belongs to it, its last to the next step where there is one."""
    start, end = STEPS_S[k]
    return np.asarray((start - 1e-9 < T) & (end + (1e-9 if k == len(STEPS_S) - 1 else -1e-9) > T))


def test_the_point_is_where_the_table_has_it(frames: Frames) -> None:
    at = {point.name: point.at for point in frames.points}
    for k in range(len(STEPS_S)):
        own = samples(k)
        hub = frames.values[inside(k), at[cycloid_frames.HUB] :][:, :3]
        point = frames.values[inside(k), at[cycloid_frames.POINT] :][:, :3]
        side = np.full(len(hub), SIDE_Y_M)
        assert np.abs(hub - np.column_stack([side, own["hub_x_m"], own["hub_z_m"]])).max() < 1e-6
        assert np.abs(point - np.column_stack([side, own["model_x_m"], own["model_z_m"]])).max() < 1e-6


def test_the_spoke_of_the_turned_wheel_points_at_the_point(frames: Frames) -> None:
    (hoop,) = frames.hoops
    at = {point.name: point.at for point in frames.points}
    for k, (R, r, *_) in enumerate(WHEELS):
        for row in frames.values[inside(k)].astype(float):
            spoke = rotated(row[hoop.at + 3 : hoop.at + 7], np.array([0.0, 0.0, -r]))
            expected = row[at[cycloid_frames.POINT] :][:3] - row[at[cycloid_frames.HUB] :][:3]
            assert np.abs(spoke - expected).max() < 1e-6
            assert row[hoop.size] == pytest.approx(R, rel=1e-6)


def test_the_wheel_does_not_slip_on_its_line(frames: Frames) -> None:
    """The lowest point of the rim is the instantaneous centre: the hub goes ahead by R times the turn."""
    (hoop,) = frames.hoops
    ground = frames.track_m(cycloid_frames.GROUND)
    assert ground is not None
    for k, (R, _, z0, *_) in enumerate(WHEELS):
        rows = frames.values[inside(k)].astype(float)
        np.testing.assert_allclose(ground[inside(k), 2], z0 - R, atol=1e-6)
        for before, after in itertools.pairwise(rows):
            q, p = after[hoop.at + 3 : hoop.at + 7], before[hoop.at + 3 : hoop.at + 7]
            turn = 2 * np.arccos(min(abs(float(q @ p)), 1.0))
            gone = after[hoop.at + 1] - before[hoop.at + 1]
            assert gone == pytest.approx(R * turn, abs=2e-5)


def test_between_steps_there_is_no_wheel(frames: Frames) -> None:
    (hoop,) = frames.hoops
    rolling = np.isfinite(frames.values[:, hoop.at])
    np.testing.assert_array_equal(rolling, inside(0) | inside(1))
    for name in (cycloid_frames.TRACE, cycloid_frames.GROUND, cycloid_frames.HUB_PATH):
        track = frames.track_m(name)
        assert track is not None
        np.testing.assert_array_equal(np.isfinite(track).all(axis=1), rolling)


def test_without_its_own_table_the_centre_of_mass_is_that_of_the_wheel(frames: Frames, fake: FakeService) -> None:
    path = frames.track_m(com_frames.PATH)
    assert path is not None
    own = samples(0)
    assert np.abs(path[inside(0)] - np.column_stack([own["x_m"], own["y_m"], own["z_m"]])).max() < 1e-6
    with_com = build_frames(
        fake.add_recording(), read_columns(fake.tracks), read_columns(fake.com), read_columns(fake.wheel)
    )
    other = with_com.track_m(com_frames.PATH)
    assert other is not None
    assert np.isfinite(other).all(axis=1).sum() > np.isfinite(path).all(axis=1).sum()


def test_steps_that_do_not_touch_are_not_joined() -> None:
    late = {name: np.array(values) for name, values in samples(1).items()}
    late["time_s"] = late["time_s"] + 0.5
    table = {name: np.concatenate([values, late[name]]) for name, values in samples(0).items()}
    com = cycloid_frames.com_of(table)
    assert np.isnan(com["x_m"]).sum() == 1
    assert (np.diff(com["time_s"]) > 0).all()


@pytest.mark.parametrize("heading", [0.3, -2.0, np.pi])
def test_the_wheel_faces_where_the_walk_goes(heading: float) -> None:
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    (q,) = cycloid_frames.wheel_quaternions(ahead, np.zeros(1))
    assert np.allclose(rotated(q, np.array([1.0, 0.0, 0.0])), ahead)
    (q,) = cycloid_frames.wheel_quaternions(ahead, np.array([np.pi / 2]))
    assert np.allclose(rotated(q, np.array([0.0, 0.0, -1.0])), -ahead), "rolling ahead, the lowest point goes back"


def test_the_mesh_is_a_wheel_of_radius_one_about_the_y_axis() -> None:
    vertices, faces = meshes.wheel(0.05, 6)
    assert np.abs(vertices[:, 1]).max() <= 0.05 + 1e-6
    assert np.hypot(vertices[:, 0], vertices[:, 2]).max() == pytest.approx(1.05, abs=0.01)
    assert faces.max() < len(vertices)
