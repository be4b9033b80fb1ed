"""Frames hold the tracks at the places that their layout names."""

from collections.abc import Callable

import httpx
import numpy as np

from stridelab_web.recording_frames import build_frames
from stridelab_web.tables import read_columns
from support.fake_service import DURATION_S, LABELS, RATE_HZ, WINDOW_S, FakeService, com_m, marker_m

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
    shown = frames.track("/paths/fused")
    assert shown is not None
    inside = (WINDOW_S[0] <= T) & (WINDOW_S[1] - 0.5 / RATE_HZ > T)
    assert np.abs(shown[inside] - com_m(T[inside])).max() < 1e-6
    assert np.isnan(shown[~inside]).all()


def test_browser_gets_the_same_numbers(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    recording = fake.add_recording()
    job = fake.add_job(state="succeeded", recording_id=recording.id)
    layout = browse(f"/view/scene/recording/{recording.id}/{job.id}/frames.json").json()
    raw = browse(f"/view/scene/recording/{recording.id}/{job.id}/frames.f32").content
    values = np.frombuffer(raw, "<f4").reshape(layout["n_frames"], layout["width"])
    frames = build_frames(recording, read_columns(fake.tracks), read_columns(fake.com))
    np.testing.assert_array_equal(values, frames.values)
    assert [name for name, _, _ in layout["points"]] == [point.name for point in frames.points]
    assert len(layout["time_s"]) == layout["n_frames"]
