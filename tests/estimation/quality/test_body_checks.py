"""A pelvis whose markers are at a wrong height, and a hand that pushes, are named as such."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.quality import Quality, Recorded, assess_quality
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.recording import Recording, Window
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise

MASS_KG = 70.0
WINDOW = (Window(0.9, 2.1),)
NOISE = MeasurementNoise(force_n=3.0, moment_nm=2.0, marker_m=0.001, mass_model=0.1)


def walk() -> Recording:
    walker = HumanWalker(1.75, MASS_KG, "male", speed_m_s=1.2, duration_s=3.0, seed=1).walk()
    return record(walker, NOISE, 1, lab="walkway").recording


def judge(recording: Recording) -> Quality:
    landmarks = identify(list(recording.markers_m)).landmarks
    geometric: GeometricCom = SegmentModel().com(recording, landmarks, subject=recording.subject)
    wrench = wrench_track(recording, WINDOW)
    estimate = Smoother().estimate(geometric, wrench, MASS_KG)
    return assess_quality(Recorded(recording, landmarks, geometric, wrench, MASS_KG), estimate)


@pytest.mark.parametrize("by_m", [0.1, -0.1])
def test_pelvis_markers_too_high_or_too_low_are_noticed(by_m: float) -> None:
    """The legs keep their lengths over time; the thighs are too long for the trunk, or too short."""
    good = walk()
    landmarks = identify(list(good.markers_m)).landmarks
    pelvis = [landmarks[name] for name in ("l_asis", "r_asis", "l_psis", "r_psis")]
    up_m = np.array([0.0, 0.0, by_m])
    moved_m = {label: track + up_m * (label in pelvis) for label, track in good.markers_m.items()}
    judged = judge(replace(good, markers_m=moved_m))
    (failed,) = [check for check in judged.checks if not check.passed]
    assert failed.name == "body_proportions"
    assert judged.verdict == "doubtful"
    assert "the markers of the pelvis (too high or too low)" in failed.message
    (right,) = [check for check in judge(good).checks if check.name == "body_proportions"]
    assert right.value < 0.1


@pytest.mark.parametrize("push_n", [30.0, -30.0, 0.0])
def test_a_constant_push_is_named_as_the_cause_of_a_bias(push_n: float) -> None:
    """A hand on a rail pushes with 30 N, and the feet against it; the force then passes beside the body by 4 cm."""
    good = walk()
    landmarks = identify(list(good.markers_m)).landmarks
    geometric = SegmentModel().com(good, landmarks, subject=good.subject)
    wrench = wrench_track(good, WINDOW)
    pushed_n = np.array([0.0, push_n, 0.0])
    height_m = float(np.nanmean(geometric.com_m[:, 2]))
    changed = replace(wrench, force_n=wrench.force_n - pushed_n)
    estimate = GeometryOnly().estimate(geometric, changed, MASS_KG)
    moved_m = estimate.com_m + np.array([0.0, push_n / (MASS_KG * GRAVITY_M_S2) * height_m, 0.0])
    quality = assess_quality(Recorded(good, landmarks, geometric, changed, MASS_KG), replace(estimate, com_m=moved_m))
    (check,) = [check for check in quality.checks if check.name == "horizontal_bias"]
    assert ("a hand on a support" in check.message) == (push_n != 0.0)


def judge_markers(recording: Recording) -> Quality:
    """Quality of the centre of mass by markers alone."""
    landmarks = identify(list(recording.markers_m)).landmarks
    geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
    wrench = wrench_track(recording, WINDOW)
    estimate = GeometryOnly().estimate(geometric, wrench, MASS_KG)
    return assess_quality(Recorded(recording, landmarks, geometric, wrench, MASS_KG, with_force=False), estimate)


@pytest.mark.parametrize(("angle_deg", "verdict"), [(0.0, "good"), (40.0, "good"), (90.0, "doubtful")])
def test_a_walk_along_the_wall_is_doubtful(angle_deg: float, verdict: str) -> None:
    """A file that names another axis vertical: lengths, proportions and hull are right, and the person lies."""
    good, angle_rad = walk(), np.radians(angle_deg)
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    R = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    judged = judge_markers(replace(good, markers_m={label: track @ R.T for label, track in good.markers_m.items()}))
    (axis,) = [check for check in judged.checks if check.name == "body_axis"]
    assert axis.value == pytest.approx(angle_deg, abs=10.0)
    assert "From the ankles to the neck, the body extends on average at" in axis.message
    assert judged.verdict == verdict
    assert [check.name for check in judged.checks if not check.passed] == (["body_axis"] if verdict != "good" else [])
