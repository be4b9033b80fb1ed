"""The shared recordings, with what must come of each.

Every recording of the shared gait data with what must come of it.

``outcome`` is "estimable" where all contact force is measured for some time, else the code of the refusal. Masses are
of the file (or, for the OpenSim trials, of the models made from them) and from the impulse of the plates.
``mass_tolerance`` is relative to the stated mass: 1 % for the demonstration trial, 3 % for adults at their own speed
(C4); elsewhere the measured difference plus half a percent, for the reasons below.

- kineticstoolkit: the plates carry 12.5 % more than the stated mass in every single support, too.
- HC040A is stated with 25.0 kg and weighs 27.2 kg while standing; HC002D with 32.1 kg and 31.1 kg.
- 2014001_C3_04 is readable and holds one whole step only; it carries the remark "one-step-window".
- pycgm-stairs: the last 50 ms lack force; a foot has landed beside the steps that are measured.
- walking2 lands with its heel at the edge of the second plate; the first 60 ms lack force.

One step of each recorded walk over two plates: its CoM from the smoother with aligned clocks, its timing.

The trailing foot's lift-off and the second strike of the first foot lie on the floor beside the plates: these two come
from the events in the file. All else is the plates' 20 N, earlier by the latency that was found.
"""

import zipfile
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

ESTIMABLE = "estimable"


@dataclass(frozen=True)
class GaitTrial:
    """One recording: its files (one C3D, or TRC and MOT), the expected outcome, masses in kg, windows in seconds."""

    files: tuple[str, ...]
    outcome: str
    stated_mass_kg: float | None
    measured_mass_kg: float | None
    mass_tolerance: float | None
    windows_s: tuple[tuple[float, float], ...]

    @property
    def name(self) -> str:
        return Path(self.files[0]).stem if len(self.files) == 1 else Path(self.files[0]).parent.name

    @property
    def adult_at_own_speed(self) -> bool:
        return "_C4_" in self.files[0]

    def uploaded(self, gait: Path, folder: Path) -> Path:
        """The file as a lab member uploads it: the C3D itself, or a zip of the texts made in ``folder``."""
        if self.files[0].endswith(".c3d"):
            return gait / self.files[0]
        target = folder / f"{self.name}.zip"
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in self.files:
                archive.write(gait / file, Path(file).name)
        return target


GAIT_TABLE: tuple[GaitTrial, ...] = (
    GaitTrial(
        ("biomechzoo-sample-study/HC002D/Static_HC002D02.c3d",), "estimable", 32.1, 31.07, 0.037, ((0.00, 0.50),)
    ),
    GaitTrial(
        ("biomechzoo-sample-study/HC002D/Straight_HC002D06.c3d",), "estimable", 32.1, 30.64, 0.05, ((0.68, 1.50),)
    ),
    GaitTrial(("biomechzoo-sample-study/HC030A/Static_HC030A01.c3d",), "estimable", 45.8, 45.84, 0.01, ((0.00, 2.99),)),
    GaitTrial(
        ("biomechzoo-sample-study/HC030A/Straight_HC030A05.c3d",), "estimable", 45.8, 45.45, 0.011, ((0.30, 1.21),)
    ),
    GaitTrial(("biomechzoo-sample-study/HC032A/Static_HC032A01.c3d",), "estimable", 60.3, 60.31, 0.01, ((0.00, 2.99),)),
    GaitTrial(
        ("biomechzoo-sample-study/HC032A/Straight_HC032A03.c3d",), "estimable", 60.3, 59.85, 0.01, ((0.26, 1.11),)
    ),
    GaitTrial(("biomechzoo-sample-study/HC032A/Turn_HC032A18.c3d",), "estimable", 60.3, 60.1, None, ((1.35, 1.79),)),
    GaitTrial(
        ("biomechzoo-sample-study/HC036A/Static_HC036A01.c3d",), "estimable", 33.0, 33.88, 0.032, ((0.00, 0.55),)
    ),
    GaitTrial(
        ("biomechzoo-sample-study/HC036A/Straight_HC036A10.c3d",), "estimable", 33.0, 33.69, 0.037, ((0.45, 1.21),)
    ),
    GaitTrial(("biomechzoo-sample-study/HC038A/Static_HC038A01.c3d",), "estimable", 56.8, 56.76, 0.01, ((0.00, 0.51),)),
    GaitTrial(
        ("biomechzoo-sample-study/HC038A/Straight_HC038A11.c3d",), "estimable", 56.8, 56.35, 0.01, ((0.80, 1.71),)
    ),
    GaitTrial(
        ("biomechzoo-sample-study/HC040A/Static_HC040A04.c3d",), "estimable", 25.0, 27.21, 0.093, ((0.00, 0.50),)
    ),
    GaitTrial(
        ("biomechzoo-sample-study/HC040A/Straight_HC040A14.c3d",), "estimable", 25.0, 27.14, 0.09, ((2.70, 3.36),)
    ),
    GaitTrial(("biomechzoo-sample-study/HC055A/Static_HC055A01.c3d",), "estimable", 32.0, 32.07, 0.01, ((0.00, 2.99),)),
    GaitTrial(
        ("biomechzoo-sample-study/HC055A/Straight_HC055A09.c3d",), "estimable", 32.0, 31.75, 0.01, ((0.30, 1.05),)
    ),
    GaitTrial(("ezc3d-testfiles/BTS.c3d",), "estimable", None, 59.27, None, ((3.62, 4.93),)),
    GaitTrial(("ezc3d-testfiles/FP_Type3.c3d",), "recording-too-short", None, None, None, ()),
    GaitTrial(("ezc3d-testfiles/Qualisys.c3d",), "estimable", None, 66.86, None, ((0.18, 1.02),)),
    GaitTrial(("kineticstoolkit/walk.c3d",), "estimable", 73.4, 82.62, 0.13, ((0.27, 1.81),)),
    GaitTrial(("opensim-core/walking2.c3d",), "estimable", None, 65.96, None, ((2.77, 3.13),)),
    GaitTrial(("pycgm-stairs/Movement_trial.c3d",), "estimable", 85.0, 87.15, 0.028, ((0.49, 2.51),)),
    GaitTrial(("pycgm-stairs/Static_trial.c3d",), "plates-unloaded", 85.0, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2014001/2014001_C1_01.c3d",), "estimable", 67.0, 67.12, 0.01, ((0.42, 2.59),)),
    GaitTrial(("rehazenter-adult-walking/2014001/2014001_C1_03.c3d",), "estimable", 67.0, 67.02, 0.01, ((0.76, 3.26),)),
    GaitTrial(("rehazenter-adult-walking/2014001/2014001_C3_01.c3d",), "estimable", 67.0, 66.84, 0.01, ((0.23, 1.24),)),
    GaitTrial(("rehazenter-adult-walking/2014001/2014001_C3_02.c3d",), "estimable", 67.0, 66.73, 0.01, ((0.22, 1.21),)),
    GaitTrial(("rehazenter-adult-walking/2014001/2014001_C3_04.c3d",), "estimable", 67.0, 66.85, 0.01, ((0.00, 0.60),)),
    GaitTrial(("rehazenter-adult-walking/2014001/2014001_C3_05.c3d",), "estimable", 67.0, 66.72, 0.01, ((0.19, 1.11),)),
    GaitTrial(("rehazenter-adult-walking/2014001/2014001_C4_05.c3d",), "estimable", 67.0, 66.78, 0.03, ((0.16, 1.02),)),
    GaitTrial(("rehazenter-adult-walking/2014001/2014001_C5_01.c3d",), "estimable", 67.0, 67.63, 0.01, ((0.12, 0.81),)),
    GaitTrial(("rehazenter-adult-walking/2014001/2014001_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2014015/2014015_C4_04.c3d",), "estimable", 67.0, 67.47, 0.03, ((0.18, 1.26),)),
    GaitTrial(("rehazenter-adult-walking/2014015/2014015_C5_03.c3d",), "estimable", 67.0, 67.06, 0.01, ((0.18, 1.03),)),
    GaitTrial(("rehazenter-adult-walking/2014015/2014015_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2014019/2014019_C4_05.c3d",), "estimable", 73.8, 73.05, 0.03, ((0.17, 1.12),)),
    GaitTrial(("rehazenter-adult-walking/2014019/2014019_C5_03.c3d",), "estimable", 73.8, 73.17, 0.01, ((0.14, 0.92),)),
    GaitTrial(("rehazenter-adult-walking/2014019/2014019_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2014022/2014022_C4_04.c3d",), "estimable", 59.8, 59.23, 0.01, ((0.18, 1.13),)),
    GaitTrial(("rehazenter-adult-walking/2014022/2014022_C5_02.c3d",), "estimable", 59.8, 59.4, 0.01, ((0.13, 0.93),)),
    GaitTrial(("rehazenter-adult-walking/2014022/2014022_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2014025/2014025_C4_04.c3d",), "estimable", 80.5, 80.42, 0.03, ((0.16, 0.99),)),
    GaitTrial(("rehazenter-adult-walking/2014025/2014025_C5_02.c3d",), "estimable", 80.5, 81.23, 0.01, ((0.13, 0.83),)),
    GaitTrial(("rehazenter-adult-walking/2014025/2014025_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2014029/2014029_C4_05.c3d",), "estimable", 89.9, 88.78, 0.03, ((0.23, 1.25),)),
    GaitTrial(
        ("rehazenter-adult-walking/2014029/2014029_C5_05.c3d",), "estimable", 89.9, 88.51, 0.018, ((0.18, 1.12),)
    ),
    GaitTrial(("rehazenter-adult-walking/2014029/2014029_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2014030/2014030_C4_03.c3d",), "estimable", 60.7, 59.31, 0.03, ((0.21, 1.12),)),
    GaitTrial(
        ("rehazenter-adult-walking/2014030/2014030_C5_02.c3d",), "estimable", 60.7, 59.39, 0.029, ((0.17, 1.01),)
    ),
    GaitTrial(("rehazenter-adult-walking/2014030/2014030_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2014031/2014031_C4_02.c3d",), "estimable", 67.2, 66.44, 0.03, ((0.21, 1.09),)),
    GaitTrial(("rehazenter-adult-walking/2014031/2014031_C5_05.c3d",), "estimable", 67.2, 66.66, 0.01, ((0.16, 0.98),)),
    GaitTrial(("rehazenter-adult-walking/2014031/2014031_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2014050/2014050_C4_04.c3d",), "estimable", 61.9, 61.18, 0.03, ((0.18, 1.06),)),
    GaitTrial(("rehazenter-adult-walking/2014050/2014050_C5_05.c3d",), "estimable", 61.9, 61.33, 0.01, ((0.16, 0.93),)),
    GaitTrial(("rehazenter-adult-walking/2014050/2014050_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2015026/2015026_C4_04.c3d",), "estimable", 51.5, 51.1, 0.03, ((0.17, 1.04),)),
    GaitTrial(("rehazenter-adult-walking/2015026/2015026_C5_03.c3d",), "estimable", 51.5, 51.32, 0.01, ((0.14, 0.91),)),
    GaitTrial(("rehazenter-adult-walking/2015026/2015026_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rehazenter-adult-walking/2015035/2015035_C4_03.c3d",), "estimable", 81.5, 81.29, 0.03, ((0.20, 1.15),)),
    GaitTrial(("rehazenter-adult-walking/2015035/2015035_C5_03.c3d",), "estimable", 81.5, 81.16, 0.01, ((0.16, 1.06),)),
    GaitTrial(("rehazenter-adult-walking/2015035/2015035_ST.c3d",), "single-frame", None, None, None, ()),
    GaitTrial(("rtosim-treadmill/walking_1.c3d",), "estimable", None, 62.77, None, ((0.00, 8.65),)),
    GaitTrial(
        (
            "opensim-core/gait2354-subject01/subject01_walk1.trc",
            "opensim-core/gait2354-subject01/subject01_walk1_grf.mot",
        ),
        "estimable",
        72.6,
        72.67,
        0.01,
        ((0.00, 2.47),),
    ),
    GaitTrial(
        (
            "opensim-core/rajagopal-walk/markers_walk.trc",
            "opensim-core/rajagopal-walk/grf_walk.mot",
        ),
        "estimable",
        85.07,
        85.1,
        0.01,
        ((0.46, 1.99),),
    ),
    GaitTrial(("opensim-core/gait2354-subject01/subject01_static.trc",), "no-plates", None, None, None, ()),
)


def trial(name: str) -> GaitTrial:
    """The row of this name (the file's stem, or the folder of a TRC and MOT pair)."""
    return next(row for row in GAIT_TABLE if row.name == name)


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
        inside = (self.estimate.time_s >= start_s - 1e-6) & (self.estimate.time_s <= end_s + 1e-6)
        return self.estimate.time_s[inside], self.path_m[inside]


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
