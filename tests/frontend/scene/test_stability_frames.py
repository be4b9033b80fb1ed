"""Measures of gait in the scene: corners of the base of support, margins that change colour, where they are drawn."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.spatial import ConvexHull

from stridelab_web.parquet import read_columns
from stridelab_web.scene.recording_frames import build_frames
from stridelab_web.scene.result_files import STABILITY_TABLE, frames_of
from stridelab_web.scene.stability_frames import BASE, INSIDE, MOMENTUM, OUTSIDE, XCOM, next_corners
from support.fakes.results import stability_table
from support.fakes.service import FakeService

SIDE_M = 0.1


def test_every_corner_of_the_hull_leads_to_the_next_one_counter_clockwise() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(50, 10, 2))
    points[20:, 5:] = np.nan
    for row, following in zip(points, next_corners(points), strict=True):
        given = row[np.isfinite(row[:, 0])]
        hull = ConvexHull(given)
        corners = hull.vertices.tolist()  # counter-clockwise in the plane
        expected = {corner: corners[(k + 1) % len(corners)] for k, corner in enumerate(corners)}
        assert {k: int(to) for k, to in enumerate(following) if to >= 0} == expected


def test_fewer_than_three_points_have_no_corners() -> None:
    points = np.full((1, 10, 2), np.nan)
    points[0, :2] = [[0.0, 0.0], [1.0, 0.0]]
    assert (next_corners(points) == -1).all()


def test_the_base_is_that_of_the_feet_that_stand(fake: FakeService) -> None:
    """One square foot, then two side by side: four edges of each, then four around both."""
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), None, None, stability_table(fake.tracks))
    edges = [stick for stick in frames.sticks if stick.name.startswith(BASE)]
    assert len(edges) == 10

    def perimeter_m(row: int) -> float:
        ends = [frames.values[row, [*range(e.start, e.start + 3), *range(e.end, e.end + 3)]] for e in edges]
        return float(np.nansum([np.linalg.norm(one[3:] - one[:3]) for one in ends]))

    assert perimeter_m(10) == pytest.approx(4 * SIDE_M, abs=1e-6)
    assert perimeter_m(200) == pytest.approx(2 * (SIDE_M + 3 * SIDE_M), abs=1e-6)


def test_a_margin_ends_at_the_edge_of_the_foot_in_the_colour_of_its_sign(fake: FakeService) -> None:
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), None, None, stability_table(fake.tracks))
    sticks = {stick.name: stick for stick in frames.sticks}
    at = next(point.at for point in frames.points if point.name == XCOM)
    for name, row, margin_m in ((INSIDE, 10, 0.05), (OUTSIDE, 60, -0.02)):
        stick = sticks[f"{name}left"]
        assert stick.start == at
        end = frames.values[row, stick.end : stick.end + 3].astype(float)
        np.testing.assert_allclose(end, [0.0, SIDE_M, 0.0], atol=1e-6)
        assert end[1] - frames.values[row, at + 1] == pytest.approx(margin_m, abs=1e-6)
        other = sticks[f"{OUTSIDE if name == INSIDE else INSIDE}left"]
        assert np.isnan(frames.values[row, other.end])
        assert np.isnan(frames.values[row, sticks[f"{name}right"].end]), "the right foot swings"


def test_the_angular_momentum_is_an_arrow_from_the_centre_of_mass(fake: FakeService) -> None:
    frames = build_frames(fake.add_recording(), read_columns(fake.tracks), None, None, stability_table(fake.tracks))
    (arrow,) = (one for one in frames.arrows if one.shaft.startswith(MOMENTUM))
    np.testing.assert_allclose(frames.values[10, arrow.at : arrow.at + 3], [0.0, 0.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(frames.values[10, arrow.at + 3 : arrow.at + 6], [1000.0, 0.0, 0.0], rtol=1e-6)
    assert "/com/fused" in {point.name for point in frames.points}


def test_a_scene_shows_its_own_recording_of_several(fake: FakeService) -> None:
    """The rows of another recording, whose feet stand elsewhere, come first."""
    recording = fake.add_recording()
    own = stability_table(fake.tracks)
    other = {name: values + (5.0 if name != "time_s" else 0.0) for name, values in own.items()}
    columns = {name: np.concatenate([other[name], own[name]]) for name in own}
    ids = ["another"] * len(own["time_s"]) + [recording.id] * len(own["time_s"])
    buffer = io.BytesIO()
    pq.write_table(pa.table({"recording_id": ids, **columns}), buffer)
    frames = frames_of(recording, fake.tracks, {STABILITY_TABLE: buffer.getvalue()})
    at = next(point.at for point in frames.points if point.name == XCOM)
    assert frames.values[10, at] == pytest.approx(0.0)
    without = frames_of(
        recording.model_copy(update={"id": "unknown"}), fake.tracks, {STABILITY_TABLE: buffer.getvalue()}
    )
    assert XCOM not in {point.name for point in without.points}
