"""A second walk over the first: aligned in time and place at a strike, in the direction of the first."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from stridelab.schemas.recordings import Recording
from stridelab_web.parquet import Columns, read_columns
from stridelab_web.scene.com_frames import FUSED
from stridelab_web.scene.recording_frames import build_frames
from stridelab_web.scene.result_files import STABILITY_TABLE, frames_of, second_recording
from stridelab_web.scene.second_walk import OTHER, add_second_walk, align_at_strike, next_recording
from stridelab_web.scene.stability_frames import BASE, XCOM
from support.fakes.results import stability_table
from support.fakes.service import FakeService

STRIKE = 100
"""Frame at which the right foot of ``stability_table`` strikes."""


def turned(table: Columns, late: int) -> Columns:
    """The same walk a quarter turn to the left, 3 m further along x and ``late`` frames later."""
    result = dict(table)
    for name in table:
        if name.endswith("x_m") and not name.startswith("momentum"):
            x, y = table[name], table[name[:-3] + "y_m"]
            result[name], result[name[:-3] + "y_m"] = 3.0 - y, x
    return {
        name: values
        if name == "time_s"
        else np.concatenate([np.repeat(values[:1], late), values[: len(values) - late]])
        for name, values in result.items()
    }


@pytest.fixture
def walking(fake: FakeService) -> Columns:
    """``stability_table`` of a person who walks ahead at 1 m/s."""
    table = dict(stability_table(fake.tracks))
    for name in ("x_m", "xcom_x_m"):
        table[name] = table[name] + table["time_s"]
    return table


def test_the_foot_strikes_at_the_same_instant_and_place(walking: Columns) -> None:
    second = turned(walking, 7)
    alignment = align_at_strike(walking, second)
    assert alignment is not None
    assert alignment.later_s == pytest.approx(walking["time_s"][STRIKE] - walking["time_s"][STRIKE + 7])
    np.testing.assert_allclose(alignment.R, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-9)
    corner = np.array([second[f"right_outline0_{axis}_m"][STRIKE + 20] for axis in "xyz"])
    expected = [walking[f"right_outline0_{axis}_m"][STRIKE + 20] for axis in "xyz"]
    np.testing.assert_allclose(alignment.R @ corner + alignment.t_m, expected, atol=1e-9)


def test_a_walk_over_itself_coincides_at_every_instant(fake: FakeService, walking: Columns) -> None:
    recording, tracks = fake.add_recording(), read_columns(fake.tracks)
    first = build_frames(recording, tracks, None, None, walking)
    alignment = align_at_strike(walking, walking)
    assert alignment is not None
    both = add_second_walk(first, first, alignment)
    at = {point.name: point.at for point in both.points}
    for name in (FUSED, XCOM):
        own, other = (both.values[:, k : k + 3] for k in (at[name], at[OTHER + name]))
        np.testing.assert_allclose(other, own, atol=1e-5)
    ends = {stick.name: (stick.start, stick.end) for stick in both.sticks}
    assert sum(name.startswith(OTHER + BASE) for name in ends) == 10
    assert sum(name.startswith(f"{OTHER}/skeleton/") for name in ends) == sum(
        name.startswith("/skeleton/") for name in ends
    )
    assert both.values.shape[1] > first.values.shape[1]
    np.testing.assert_array_equal(both.values[:, : first.values.shape[1]], first.values)


def test_a_turned_and_later_walk_coincides_where_both_are_recorded(fake: FakeService, walking: Columns) -> None:
    recording, tracks = fake.add_recording(), read_columns(fake.tracks)
    first = build_frames(recording, tracks, None, None, walking)
    second_table = turned(walking, 7)
    second = build_frames(recording, tracks, None, None, second_table)
    alignment = align_at_strike(walking, second_table)
    assert alignment is not None
    both = add_second_walk(first, second, alignment)
    at = {point.name: point.at for point in both.points}
    rows = slice(20, len(both.time_s) - 20)
    own, other = (both.values[rows, at[name] : at[name] + 3] for name in (FUSED, OTHER + FUSED))
    np.testing.assert_allclose(other, own, atol=1e-5)
    assert np.isnan(both.values[-1, at[OTHER + FUSED]]), "the second walk ends earlier"


def test_walks_without_a_strike_in_both_are_not_aligned(walking: Columns) -> None:
    still = {name: values[:STRIKE] for name, values in walking.items()}
    assert align_at_strike(walking, still) is None


@pytest.mark.parametrize(
    ("ids", "shown", "other"),
    [
        (["a", "b", "c"], "a", "b"),
        (["a", "b", "c"], "c", "a"),
        (["a"], "a", None),
        (["a", "b"], "x", None),
        ([], "a", None),
    ],
)
def test_the_other_walk_is_the_next_of_the_result(ids: list[str], shown: str, other: str | None) -> None:
    assert next_recording(ids, shown) == other


def test_a_result_without_the_table_of_stability_has_no_second_walk() -> None:
    summary = {"trials": [{"recording_id": "a"}, {"recording_id": "b"}]}
    assert second_recording(["com.parquet"], summary, "a") is None
    assert second_recording([STABILITY_TABLE], summary, "a") == "b"


def test_the_scene_of_a_result_of_two_recordings_has_both(fake: FakeService, walking: Columns) -> None:
    recording = fake.add_recording()
    other = Recording.model_validate({**recording.model_dump(), "id": "another"})
    second = turned(walking, 7)
    n = len(walking["time_s"])
    columns = {name: np.concatenate([walking[name], second[name]]) for name in walking}
    buffer = io.BytesIO()
    pq.write_table(pa.table({"recording_id": [recording.id] * n + [other.id] * n, **columns}), buffer)
    shown = {STABILITY_TABLE: buffer.getvalue()}
    names = {point.name for point in frames_of(recording, fake.tracks, shown, (other, fake.tracks)).points}
    assert {FUSED, OTHER + FUSED, OTHER + XCOM} <= names
    assert OTHER + FUSED not in {point.name for point in frames_of(recording, fake.tracks, shown).points}
