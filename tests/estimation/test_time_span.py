"""The window that an estimate answers for: from its first sample to its last, and nothing outside the data."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.errors import InvalidInput, NotEstimable
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.differentiation import window_span
from stridelab.estimation.estimator import ComEstimator
from stridelab.estimation.kalman.filter import KalmanFilter, RtsSmoother
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import walk

T = np.arange(200) / 100.0
ESTIMATORS: list[ComEstimator] = [ComplementaryFilter(), KalmanFilter(), RtsSmoother()]


def test_the_window_is_that_of_the_measured_frames() -> None:
    motion = walk()
    span = window_span(motion.geometric(T), motion.wrench_track(T, Window(0.503, 1.5)))
    assert (span.inside.start, span.inside.stop) == (51, 151)
    assert (span.window.start_s, span.window.end_s) == (T[51], T[150])


def test_the_geometry_around_the_window_ends_at_its_gaps() -> None:
    motion, holes = walk(), np.zeros((200, 3))
    holes[20:23] = holes[170] = np.nan
    span = window_span(motion.geometric(T, noise_m=holes), motion.wrench_track(T, Window(0.503, 1.5)))
    assert (span.around, span.within) == (slice(23, 170), slice(51 - 23, 151 - 23))


@pytest.mark.parametrize(("late_s", "first", "last"), [(0.006, 0, 198), (0.026, 0, 196), (-0.013, 2, 199)])
def test_a_latency_that_drops_frames_at_the_edge_states_none_too_many(late_s: float, first: int, last: int) -> None:
    """Force and markers of the same length: read later, the force of the last frames lies beyond its end."""
    motion = walk()
    wrench = motion.wrench_track(T, Window(0.0, float(T[-1])), read_late_s=late_s)
    readable = (T + late_s >= 0.0) & (T + late_s <= T[-1])
    wrench = replace(wrench, complete=wrench.complete & readable)
    span = window_span(motion.geometric(T), wrench)
    assert (span.window.start_s, span.window.end_s) == (T[first], T[last])
    assert round(span.window.duration_s * span.rate_hz) + 1 == span.inside.stop - span.inside.start


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda estimator: estimator.name)
@pytest.mark.parametrize("window", [Window(2.5, 3.5), Window(-2.0, -1.0)])
def test_a_window_outside_the_data_is_refused(estimator, window: Window) -> None:  # type: ignore[no-untyped-def]
    motion = walk()
    wrench = replace(motion.wrench_track(T, Window(0.0, 1.99)), windows=(window,))
    with pytest.raises(NotEstimable) as refusal:
        estimator.estimate(motion.geometric(T), wrench, motion.mass_kg)
    assert refusal.value.code == "no-window"
    assert refusal.value.message.startswith("At no time is all contact force on the plates, so")
    assert refusal.value.message.endswith("combined. Is every foot that touches the ground on an enabled plate?")


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda estimator: estimator.name)
def test_a_force_from_another_time_than_the_markers_is_refused(estimator) -> None:  # type: ignore[no-untyped-def]
    motion = walk()
    with pytest.raises(InvalidInput) as refusal:
        estimator.estimate(motion.geometric(T), motion.wrench_track(T + 10.0, Window(10.0, 12.0)), motion.mass_kg)
    assert refusal.value.code == "clock-mismatch"
    assert refusal.value.faults[0].where == "time_s"


@pytest.mark.parametrize("mass_kg", [0.0, -70.0, float("nan"), 1e5])
def test_a_mass_that_no_person_has_is_refused_by_name(mass_kg: float) -> None:
    motion = walk()
    for estimator in ESTIMATORS:
        with pytest.raises(InvalidInput) as refusal:
            estimator.estimate(motion.geometric(T), motion.wrench_track(T, Window(0.0, 1.99)), mass_kg)
        assert refusal.value.code == "mass-out-of-range"
        assert refusal.value.faults[0].where == "mass_kg"
