"""Claims of chapters 2 and 3 against eleven adults at their own speed; docs/theory/misprints.md."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.differentiation import low_pass, smoothed_derivatives
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Event, Recording
from stridelab.walking.path_fit import PathFit, fit_path


@dataclass(frozen=True)
class Walker:
    """Path of the segment model's CoM in the sagittal plane, 8 Hz band, and the foot events of the file."""

    time_s: np.ndarray
    x_m: np.ndarray
    speed_m_s: np.ndarray
    z_m: np.ndarray
    events: tuple[Event, ...]
    jerk_m_s3: np.ndarray

    def turning(self, sign: float) -> np.ndarray:
        """Samples at which the height is lowest (sign 1) or highest (sign -1)."""
        z = sign * self.z_m
        return np.flatnonzero((z[1:-1] < z[:-2]) & (z[1:-1] <= z[2:])) + 1

    def steps(self) -> list[slice]:
        """From one lowest point to the next, both included."""
        low = self.turning(1.0)
        return [slice(a, b + 1) for a, b in pairwise(low)]


@pytest.fixture(scope="module")
def walkers(gait: Path) -> list[Walker]:
    return [walker(path) for path in sorted(gait.glob("rehazenter-adult-walking/*/*_C4_*.c3d"))]


def walker(path: Path) -> Walker:
    recording = read_recording(path)
    ahead = recording.walking_direction
    assert ahead is not None
    statics = sorted(path.parent.glob("*_ST.c3d"))
    com = SegmentModel().com(
        recording,
        identify(list(recording.markers_m)).landmarks,
        subject=recording.subject,
        static=read_recording(statics[0]) if statics else None,
    )
    visible = np.isfinite(com.com_m).all(axis=1)
    c = low_pass(com.com_m[visible], recording.marker_rate_hz)
    velocity, _ = smoothed_derivatives(com.com_m[visible], recording.marker_rate_hz)
    jerk = jerk_from_force(recording, np.array([ahead, np.cross([0.0, 0.0, 1.0], ahead), [0.0, 0.0, 1.0]]))
    return Walker(com.time_s[visible], c @ ahead, velocity @ ahead, c[:, 2], recording.events, jerk)


def jerk_from_force(recording: Recording, axes: np.ndarray) -> np.ndarray:
    """Along, across and up, 8 Hz band, while all contact is on plates."""
    mass_kg, rate_hz = recording.subject.mass_kg, recording.marker_rate_hz
    assert mass_kg is not None
    track = wrench_track(recording, measured_windows(recording, identify(list(recording.markers_m)).landmarks))
    acceleration = low_pass(track.force_n[track.complete] / mass_kg, rate_hz) @ axes.T
    return np.diff(acceleration, axis=0)[5:-5] * rate_hz  # the filter's edges left out


def test_the_jerk_of_walking_is_far_above_the_sigma_jerk_of_2_5_3(walkers):
    rms = np.sqrt([np.mean(w.jerk_m_s3**2, axis=0) for w in walkers])
    assert rms.mean(axis=0) == pytest.approx([12.0, 3.9, 23.9], abs=0.5)  # m/s^3; the text has 1
    assert rms.min() > 1.5


def test_people_are_fastest_near_their_lowest_point(walkers):
    excess = [
        (w.speed_m_s[s.start] + w.speed_m_s[s.stop - 1]) / 2 - w.speed_m_s[s].mean() for w in walkers for s in w.steps()
    ]
    assert len(excess) == 28
    assert np.mean(excess) == pytest.approx(0.075, abs=0.01)  # m/s; the wheel is slower there, by r omega
    assert min(excess) > 0


def test_the_crossings_of_z0_are_not_double_support(walkers):
    early, late = [], []
    for w in walkers:
        high = w.turning(-1.0)
        for strike in (e for e in w.events if e.kind == "foot_strike"):
            off = [e.time_s for e in w.events if e.kind == "foot_off" and 0 < e.time_s - strike.time_s < 0.3]
            around = w.time_s[high] - strike.time_s
            before, after = high[(around > -0.5) & (around < 0.05)], high[(around > 0.05) & (around < 0.6)]
            if not off or not before.size or not after.size:
                continue
            arc = slice(int(before[-1]), int(after[0]) + 1)
            z, t = w.z_m[arc], w.time_s[arc]
            below = t[z < (z.min() + (z[0] + z[-1]) / 2) / 2]
            early.append(below[0] - strike.time_s)
            late.append(below[-1] - off[0])
    assert len(early) == 22
    assert 1e3 * np.mean(early) == pytest.approx(-101, abs=5)  # "only few milliseconds of errors"
    assert 1e3 * np.mean(late) == pytest.approx(9, abs=5)
    assert 1e3 * np.std(late) > 30


def test_the_spread_of_the_distance_and_of_the_wheel_from_step_to_step(walkers):
    def fit(w: Walker, s: slice) -> PathFit:
        t = w.time_s[s]
        return fit_path(t, np.column_stack([w.x_m[s], w.z_m[s]]), float(t[-1] - t[0]))

    fits = [[fit(w, s) for s in w.steps()] for w in walkers]
    distance = np.array([f.distance_m.mean() for of in fits for f in of])
    spread = np.array([f.distance_m.std() for of in fits for f in of])
    assert distance.mean() == pytest.approx(0.00097, abs=1e-4)
    assert distance.max() < 0.0035
    assert 0.001 < spread.max() < 0.0015  # section 3.3.1 says 1 mm at most, the caption of fig. 3.6 says 1.5 mm
    between_steps = np.array([np.ptp([f.wheel.R_m for f in of]) for of in fits])
    formal = np.array([np.median([f.sd_m[1] for f in of]) for of in fits])
    assert np.median(between_steps) == pytest.approx(0.0096, abs=0.001)  # 10 % of R
    assert np.median(formal) == pytest.approx(0.0013, abs=0.0003)
    assert np.median([np.ptp([f.wheel.r_m for f in of]) for of in fits]) == pytest.approx(
        0.0022, abs=0.0005
    )  # 15 % of r
