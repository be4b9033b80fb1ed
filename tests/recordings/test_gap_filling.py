"""Missing samples and short gaps."""

import numpy as np
import pytest

from stridelab.recordings.gap_filling import (
    MAX_BRIDGE_S,
    MAX_GAP_S,
    bridge_segment_gaps,
    fill_short_gaps,
    mark_missing,
    true_runs,
)

RATE = 100.0


def track(n: int = 200) -> np.ndarray:
    t = np.arange(n) / RATE
    return np.column_stack([1.2 * t, 0.1 * np.sin(6 * t), 0.5 + 0.05 * np.cos(12 * t)])


def test_nan_infinity_exact_zeros_and_implausible_values_are_missing() -> None:
    cloud = np.ones((5, 1, 3))
    cloud[4, 0, 1] = -1e30
    cloud[1, 0] = 0.0
    cloud[2, 0, 1] = np.nan
    cloud[3, 0, 2] = np.inf
    assert np.isnan(mark_missing(cloud)[:, 0, :]).all(axis=1).tolist() == [False, True, True, True, True]


def test_a_zero_in_one_coordinate_is_a_position() -> None:
    cloud = np.array([[[0.0, 0.0, 1.0]]])
    assert not np.isnan(mark_missing(cloud)).any()


def test_runs_are_begin_and_end_of_what_holds() -> None:
    assert true_runs(np.array([True, False, True, True])) == [(0, 1), (2, 4)]
    assert true_runs(np.array([False])) == []


def test_short_gaps_are_filled_within_a_millimetre_and_reported() -> None:
    whole = track()
    holed = whole.copy()
    holed[50:60] = np.nan
    filled, mask = fill_short_gaps(holed, RATE)
    assert np.flatnonzero(mask).tolist() == list(range(50, 60))
    np.testing.assert_allclose(filled, whole, atol=1e-3)


def test_long_gaps_are_not_filled() -> None:
    holed = track()
    n = int(MAX_GAP_S * RATE) + 1
    holed[50 : 50 + n] = np.nan
    filled, mask = fill_short_gaps(holed, RATE)
    assert not mask.any()
    assert np.isnan(filled[50 : 50 + n]).all()


@pytest.mark.parametrize("edge", [slice(0, 5), slice(195, 200)])
def test_ends_are_never_extrapolated(edge: slice) -> None:
    holed = track()
    holed[edge] = np.nan
    filled, mask = fill_short_gaps(holed, RATE)
    assert not mask.any()
    assert np.isnan(filled[edge]).all()


def running_foot() -> dict[str, np.ndarray]:
    """A foot that swings forwards at 4 m/s, lands at 0.9 s on a belt of 3 m/s, and pitches slowly by 20 degrees."""
    t = np.arange(200) / RATE
    pitch = np.deg2rad(20.0) * np.sin(2 * np.pi * 1.4 * t)
    middle = np.column_stack([np.where(t < 0.9, 4.0, -3.0) * (t - 0.9), 0.0 * t, 0.05 + np.maximum(0.9 - t, 0.0)])
    along = np.column_stack([np.cos(pitch), 0.0 * t, -np.sin(pitch)])
    return {"heel": middle - 0.12 * along, "toe": middle + 0.12 * along, "mt5": middle + 0.05 * along}


def test_a_gap_of_one_marker_is_bridged_by_the_others_of_its_segment() -> None:
    foot = running_foot()
    whole = foot["heel"].copy()
    foot["heel"][80:100] = np.nan
    filled = bridge_segment_gaps(foot, RATE)
    error_m = np.linalg.norm(filled["heel"] - whole, axis=1).max()
    assert error_m < 0.01
    alone, _ = fill_short_gaps(foot["heel"], RATE, MAX_BRIDGE_S)
    assert np.linalg.norm(alone - whole, axis=1).max() > 0.1, "the path of the marker alone misses the landing"
    assert filled["toe"] is foot["toe"]
    assert np.isnan(foot["heel"][80:100]).all(), "the tracks that were given stay as they are"


def test_longer_gaps_gaps_at_the_ends_and_gaps_of_all_markers_stay() -> None:
    foot = running_foot()
    foot["heel"][60 : 61 + int(MAX_BRIDGE_S * RATE)] = np.nan
    foot["heel"][190:] = np.nan
    foot["toe"][:5] = np.nan
    for track in foot.values():
        track[120:125] = np.nan
    for name, track in bridge_segment_gaps(foot, RATE).items():
        np.testing.assert_array_equal(track, foot[name])
