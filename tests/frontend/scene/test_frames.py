"""Frames hold the tracks at the places that their layout names."""

import re
from collections.abc import Callable

import httpx
import numpy as np

from stridelab_web.parquet import read_columns
from stridelab_web.scene import frames as frames_module
from stridelab_web.scene.com_frames import axis_ends
from stridelab_web.scene.recording_frames import build_frames
from support.browser.page import read_frames
from support.fakes.recorded_walk import DURATION_S, LABELS, RATE_HZ, SD_M, WINDOW_S, com_m, marker_m
from support.fakes.service import FakeService

T = np.arange(int(RATE_HZ * DURATION_S)) / RATE_HZ


def test_markers_stand_where_the_tracks_say_and_hidden_ones_nowhere(fake: FakeService) -> None:
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), None)
    at = {point.label: point.at for point in frames.points}
    for label in LABELS:
        shown = frames.values[:, at[label] : at[label] + 3]
        visible = slice(None, -50) if label == "C7" else slice(None)
        assert np.abs(shown[visible] - marker_m(label, T)[visible]).max() < 1e-6
    assert np.isnan(frames.values[-50:, at["C7"] : at["C7"] + 3]).all()


def test_lines_join_the_landmarks_that_the_recording_has(fake: FakeService) -> None:
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), None)
    label_at = {point.at: point.label for point in frames.points}
    joined = {frozenset((label_at[s.start], label_at[s.end])) for s in frames.sticks}
    assert frozenset(("LASI", "LKNE")) in joined
    assert frozenset(("LKNE", "LANK")) in joined
    assert frozenset(("LASI", "RASI")) in joined
    assert frozenset(("LKNE", "RKNE")) not in joined


def test_forces_of_plates_and_their_sum(fake: FakeService) -> None:
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), None)
    by_label = {arrow.label: frames.values[:, arrow.at : arrow.at + 6].astype(float) for arrow in frames.arrows}
    one, two, total = by_label["force on plate 1"], by_label["force on plate 2"], by_label["total force"]
    assert np.abs(one[:, 3:] + two[:, 3:] - total[:, 3:]).max() < 1e-3
    k = int(1.5 * RATE_HZ)  # both plates carry
    f1, f2 = one[k, 5], two[k, 5]
    assert f1 > 20
    assert f2 > 20
    # the moment of the sum about a horizontal axis is the sum of the moments
    assert np.isclose(total[k, 0] * (f1 + f2), one[k, 0] * f1 + two[k, 0] * f2, rtol=1e-5)
    assert np.isnan(one[:50, :3]).all(), "an unloaded plate has no point of application"


def test_a_plate_that_is_not_used_has_no_arrow(fake: FakeService) -> None:
    recording = fake.add_recording()
    plates = [recording.plates[0], recording.plates[1].model_copy(update={"use": False})]
    frames = build_frames(recording.model_copy(update={"plates": plates}), read_columns(fake.tracks), None)
    assert [arrow.label for arrow in frames.arrows] == ["force on plate 1"]


def test_centre_of_mass_is_on_the_clock_of_the_markers(fake: FakeService) -> None:
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), read_columns(fake.com))
    shown = frames.track_m("/paths/fused")
    assert shown is not None
    inside = (WINDOW_S[0] <= T) & (WINDOW_S[1] - 0.5 / RATE_HZ > T)
    assert np.abs(shown[inside] - com_m(T[inside])).max() < 1e-6
    assert np.isnan(shown[~inside]).all()


def test_the_band_follows_the_centre_of_mass_with_semi_axes_of_95_percent(fake: FakeService) -> None:
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), read_columns(fake.com))
    (band,) = frames.ellipsoids
    inside = (WINDOW_S[0] <= T) & (WINDOW_S[1] - 0.5 / RATE_HZ > T)
    assert np.abs(frames.values[inside, band.at : band.at + 3] - com_m(T[inside])).max() < 1e-6
    assert np.allclose(frames.values[inside, band.axes : band.axes + 3], 1.96 * np.array(SD_M), atol=1e-8)
    assert np.isnan(frames.values[~inside, band.axes : band.axes + 3]).all()


def test_the_central_axis_is_drawn_from_the_floor_through_its_point_where_the_force_is_complete(
    fake: FakeService,
) -> None:
    com = dict(read_columns(fake.com))
    gap = slice(20, 40)
    for axis in "xyz":
        com[f"force_{axis}_n"][gap] = com[f"axis_{axis}_m"][gap] = np.nan
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), com)
    (line,) = (stick for stick in frames.sticks if stick.name == "/axis/line")
    low, high = (frames.values[:, at : at + 3].astype(float) for at in (line.start, line.end))
    there = np.isfinite(low).all(axis=1)
    expected = (WINDOW_S[0] <= T) & (WINDOW_S[1] - 0.5 / RATE_HZ > T)
    first = int(WINDOW_S[0] * RATE_HZ)
    expected[first + gap.start : first + gap.stop] = False
    np.testing.assert_array_equal(there, expected)
    np.testing.assert_array_equal(np.isfinite(high).all(axis=1), expected)
    assert np.abs(low[there, 2]).max() < 1e-6, "the lowest plate lies at height 0"
    truth = com_m(T)[there]  # the axis of the synthetic walk runs through its centre of mass
    along = (high - low)[there] / np.linalg.norm((high - low)[there], axis=1, keepdims=True)
    away = np.cross(truth - low[there], along)
    assert np.linalg.norm(away, axis=1).max() < 1e-6
    assert (high[there, 2] > truth[:, 2] + 0.5).all()


def test_the_axis_of_a_force_that_hardly_rises_does_not_reach_for_the_horizon() -> None:
    low, high = axis_ends(np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]]), 0.0)
    assert np.linalg.norm(high - low) <= 2.5 + 0.6 + 1e-9


def test_inputs_that_are_places_are_points_with_paths(fake: FakeService) -> None:
    com = read_columns(fake.com)
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), com)
    at = {point.name: point.at for point in frames.points}
    first = int(WINDOW_S[0] * RATE_HZ)
    for name, before in (("geometry", "geometry"), ("axis", "axis")):
        shown = frames.values[first : first + len(com["time_s"]), at[f"/inputs/{name}/point"] :][:, :3]
        expected = np.column_stack([com[f"{before}_{axis}_m"] for axis in "xyz"])
        assert np.abs(shown - expected).max() < 1e-6
        path = frames.track_m(f"/inputs/{name}/path")
        assert path is not None
        np.testing.assert_array_equal(path[first : first + len(shown)], shown)


def test_a_table_of_an_older_version_lacks_the_axis_and_nothing_else(fake: FakeService) -> None:
    com = {name: values for name, values in read_columns(fake.com).items() if not name.startswith("axis_")}
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), com)
    names = [point.name for point in frames.points]
    assert "/com/fused" in names
    assert "/inputs/geometry/point" in names
    assert not any("axis" in name for name in (*names, *(stick.name for stick in frames.sticks)))


def test_browser_gets_the_same_numbers(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    recording = fake.add_recording()
    job = fake.add_job(state="succeeded", recording_id=recording.id)
    layout, values = read_frames(browse(f"/view/scene/recording/{recording.id}/{job.id}/frames.bin").content)
    frames = build_frames(recording, read_columns(fake.tracks), read_columns(fake.com))
    moved = [column for _, at, _ in layout["points"] for column in range(at, at + 3)]
    np.testing.assert_allclose(values[:, moved], frames.values[:, moved], rtol=0, atol=5e-7)
    np.testing.assert_allclose(values, frames.values, rtol=1e-7, atol=2.5e-4)  # forces: a quarter of a millinewton
    assert [name for name, _, _ in layout["points"]] == [point.name for point in frames.points]
    assert len(layout["time_s"]) == layout["n_frames"]


def test_every_name_in_a_scene_is_a_label_of_a_marker_or_translated(fake: FakeService) -> None:
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), read_columns(fake.com))
    assert {point.label for point in frames.points} <= {*LABELS, *frames_module.LABELS}
    plates = re.compile(r"force on plate \d")
    assert {arrow.label for arrow in frames.arrows if not plates.fullmatch(arrow.label)} <= set(frames_module.LABELS)
