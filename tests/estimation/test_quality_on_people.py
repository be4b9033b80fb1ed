"""The checks on recordings of people: nothing that is right is contradicted, and each fault made in them is."""

import os
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.quality import Quality, Recorded, assess_quality
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Plate, Recording

GAIT = Path(os.environ.get("STRIDELAB_TEST_DATA", Path(__file__).parents[3] / "shared")).resolve() / "gait"
if not GAIT.is_dir():
    pytest.skip("real recordings are not here (set STRIDELAB_TEST_DATA)", allow_module_level=True)

DERIVED = ("2014001", "2014015", "2014019", "2014022", "2014025", "HC002D", "HC030A", "HC032A")
"""People on whose walks the limits were derived; they are not looked at here."""
ADULTS = sorted(GAIT.glob("rehazenter-adult-walking/*/*_C[45]_*.c3d"))
CHILDREN = sorted(GAIT.glob("biomechzoo-sample-study/*/[ST]*.c3d"))
WALKS = [path for path in (*ADULTS, *CHILDREN) if not any(name in str(path) for name in DERIVED)]
DOUBTFUL = {"HC040A": {"force_residual", "mass_from_motion"}}
"""A child whom the file states at 25.0 kg and whom the plates weigh at 27.2 kg, standing and walking."""


@cache
def recording_of(path: Path) -> Recording:
    return read_recording(path)


def judge(recording: Recording, *, mass_share: float = 1.0) -> Quality:
    """As ``estimate-com`` does: with the latency that is found."""
    landmarks = identify(list(recording.markers_m)).landmarks
    assert recording.subject.mass_kg is not None
    mass_kg = mass_share * recording.subject.mass_kg
    geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
    windows = measured_windows(recording, landmarks)

    def wrench_at(latency_s: float):  # type: ignore[no-untyped-def]
        return wrench_track(recording, windows, latency_s=latency_s)

    latency_s = 0.0
    if recording.walking_direction is not None:
        latency = estimate_latency(geometric, wrench_at, mass_kg)
        latency_s = latency.latency_s if latency.significant else 0.0
    wrench = wrench_at(latency_s)
    estimate = Smoother().estimate(geometric, wrench, mass_kg)
    return assess_quality(Recorded(recording, landmarks, geometric, wrench, mass_kg), estimate)


def test_there_are_people_without_any_tuning_on_them() -> None:
    assert len({path.parent.name for path in WALKS}) == 10
    assert len(WALKS) == 20


@pytest.mark.parametrize("path", WALKS, ids=lambda path: path.stem)
def test_a_recording_that_is_right_is_good(path: Path) -> None:
    quality = judge(recording_of(path))
    failed = {check.name for check in quality.checks if not check.passed}
    assert quality.verdict != "contradicted", failed
    assert failed == DOUBTFUL.get(path.parent.name, set())


def changed(recording: Recording, change: Callable[[Plate], Plate], only: int | None = None) -> Recording:
    plates = [change(p) if only is None or k == only else p for k, p in enumerate(recording.plates)]
    return replace(recording, plates=tuple(plates))


def shifted(plate: Plate, by_m: tuple[float, float, float]) -> Plate:
    """The plate's sensor says what it said, and the file puts it elsewhere; the windows still see the true corners."""
    return replace(plate, moment_nm=plate.moment_nm + np.cross(by_m, plate.force_n))


def with_moments_times(plate: Plate, factor: float) -> Plate:
    carried = np.cross(plate.corners_m.mean(axis=0), plate.force_n)
    return replace(plate, moment_nm=carried + factor * (plate.moment_nm - carried))


FAULTS: dict[str, Callable[[Recording], Quality]] = {
    "moments times 1000": lambda good: judge(changed(good, lambda p: with_moments_times(p, 1000.0))),
    "one plate 0.5 m aside": lambda good: judge(changed(good, lambda p: shifted(p, (0.0, 0.5, 0.0)), only=0)),
    "mass 25 % too large": lambda good: judge(good, mass_share=1.25),
    "mass 25 % too small": lambda good: judge(good, mass_share=0.75),
    "vertical channels 30 % too large": lambda good: judge(
        changed(good, lambda p: replace(p, force_n=p.force_n * [1.0, 1.0, 1.3]))
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("path", [ADULTS[-1], CHILDREN[-1]], ids=lambda path: path.stem)
def test_a_fault_made_in_a_real_recording_is_contradicted(path: Path, fault: str) -> None:
    assert FAULTS[fault](recording_of(path)).verdict == "contradicted"
