"""One step of each recorded walk over two plates: its CoM from the smoother with aligned clocks, its timing.

The trailing foot's lift-off and the second strike of the first foot lie on the floor beside the plates: these two come
from the events in the file. All else is the plates' 20 N, earlier by the latency that was found.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import Vector3
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import loaded_intervals, wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, Side, WrenchTrack
from stridelab.walking.steps import GaitStep

STATICS = ("*_ST.c3d", "Static*.c3d")
GROUPS = {
    "C4": "rehazenter-adult-walking/*/*_C4_*.c3d",
    "C5": "rehazenter-adult-walking/*/*_C5_*.c3d",
    "children": "biomechzoo-sample-study/*/Straight*.c3d",
}


@dataclass(frozen=True)
class RecordedWalk:
    """A walk with the step that the plates measured whole, and when the first foot struck again (None: not seen)."""

    person: str
    height_m: float
    estimate: ComEstimate
    ahead: Vector3
    step: GaitStep
    next_strike_s: float | None

    @property
    def path_m(self) -> np.ndarray:
        """Ahead and up at the samples of the estimate."""
        return np.column_stack([self.estimate.com_m @ self.ahead, self.estimate.com_m[:, 2]])

    def between(self, start_s: float, end_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Instants and path from ``start_s`` to ``end_s``."""
        kept = (self.estimate.time_s >= start_s - 1e-6) & (self.estimate.time_s <= end_s + 1e-6)
        return self.estimate.time_s[kept], self.path_m[kept]


def walks(gait: Path, group: str) -> list[RecordedWalk]:
    """All walks of a group of persons."""
    return [load(path) for path in sorted(gait.glob(GROUPS[group]))]


def load(path: Path) -> RecordedWalk:
    """Read, align the clocks, smooth, and time one step."""
    recording = read_recording(path)
    mass_kg, height_m, ahead = recording.subject.mass_kg, recording.subject.height_m, recording.walking_direction
    assert mass_kg is not None
    assert height_m is not None
    assert ahead is not None
    landmarks = identify(list(recording.markers_m)).landmarks
    statics = sorted(p for pattern in STATICS for p in path.parent.glob(pattern))
    static = read_recording(statics[0]) if statics else None
    geometric = SegmentModel().com(recording, landmarks, subject=recording.subject, static=static)
    wrench_at = partial(_wrench, recording, measured_windows(recording, landmarks))
    latency = estimate_latency(geometric, wrench_at, mass_kg)
    applied_s = latency.latency_s if latency.significant else 0.0
    estimate = Smoother(beyond_window=True).estimate(geometric, wrench_at(applied_s), mass_kg)
    step, next_strike_s = _timed(recording, applied_s, estimate, ahead, landmarks)
    return RecordedWalk(path.parent.name, height_m, estimate, ahead, step, next_strike_s)


def _wrench(recording: Recording, windows, latency_s: float) -> WrenchTrack:
    return wrench_track(recording, windows, latency_s=latency_s)


def _timed(
    recording: Recording, latency_s: float, estimate: ComEstimate, ahead: Vector3, landmarks
) -> tuple[GaitStep, float | None]:
    loads = sorted(
        (start - latency_s, end - latency_s)
        for plate in recording.plates
        for start, end in loaded_intervals(plate, recording.force_rate_hz)[:1]
    )
    (first_on, first_off), (second_on, _) = loads[:2]
    lifted = [e for e in recording.events if e.kind == "foot_off" and first_on < e.time_s < second_on + 0.02]
    struck = [e for e in recording.events if e.kind == "foot_strike" and e.time_s > first_off + 0.05]
    side: Side = lifted[0].side or "left"
    around = (estimate.time_s >= lifted[0].time_s) & (estimate.time_s <= first_off)
    speed = np.polyfit(estimate.time_s[around], estimate.com_m[around] @ ahead, 1)[0]
    k = round(second_on * recording.marker_rate_hz)
    heels = [recording.markers_m[landmarks[name]][k] @ ahead for name in ("l_heel", "r_heel") if name in landmarks]
    step = GaitStep(
        side=side,
        lift_off_s=lifted[0].time_s,
        strike_s=second_on,
        next_lift_off_s=first_off,
        period_s=second_on - first_on,
        length_m=float(abs(heels[0] - heels[1])) if len(heels) == 2 else None,
        speed_m_s=float(speed),
        measured=True,
        source="mixed",
    )
    return step, struck[0].time_s if struck else None
