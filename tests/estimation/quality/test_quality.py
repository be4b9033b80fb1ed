"""The checks of a recording on walks whose truth is known: a good one stays good, and every fault is caught."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import pytest

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import NotEstimable
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.quality import Quality, Recorded, assess_quality
from stridelab.estimation.quality.assessment import MARKER_CHECKS, evaluate_checks
from stridelab.estimation.quality.body_checks import distance_outside_m, length_change
from stridelab.estimation.quality.measures import (
    Measures,
    dynamic_mass_kg,
)
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.recording import Plate, Recording, Window
from stridelab.simulation.force_plates import LabName
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise

MASS_KG = 70.0
WINDOW = (Window(0.9, 2.1),)
"""Everywhere measured on the walkway: faults of the plates are judged on the same frames as the good walk."""
NOISE = MeasurementNoise(force_n=3.0, moment_nm=2.0, marker_m=0.001, mass_model=0.1)


@cache
def walk(seed: int = 1, speed_m_s: float = 1.2, lab: LabName = "walkway") -> Recording:
    walker = HumanWalker(
        height_m=1.75, mass_kg=MASS_KG, sex="male", speed_m_s=speed_m_s, duration_s=3.0, seed=seed
    ).walk()
    return record(walker, NOISE, seed, lab=lab).recording


@dataclass(frozen=True)
class Judged:
    quality: Quality
    estimate: ComEstimate

    def check(self, name: str):  # type: ignore[no-untyped-def]
        (result,) = [check for check in self.quality.checks if check.name == name]
        return result


def judge(
    recording: Recording, *, mass_kg: float = MASS_KG, method: object = None, windows: tuple[Window, ...] = WINDOW
) -> Judged:
    landmarks = identify(list(recording.markers_m)).landmarks
    geometric: GeometricCom = SegmentModel().com(recording, landmarks, subject=recording.subject)
    wrench = wrench_track(recording, windows)
    estimate = (method or Smoother()).estimate(geometric, wrench, mass_kg)  # type: ignore[attr-defined]
    recorded = Recorded(recording, landmarks, geometric, wrench, mass_kg)
    return Judged(assess_quality(recorded, estimate), estimate)


def with_plates(change: Callable[[Plate], Plate]) -> Recording:
    good = walk()
    return replace(good, plates=tuple(change(plate) for plate in good.plates))


def moved(plate: Plate, by_m: np.ndarray) -> Plate:
    moment = plate.moment_nm + np.cross(by_m, plate.force_n)
    return replace(plate, corners_m=plate.corners_m + by_m, moment_nm=moment)


def about_middle(plate: Plate, factor: float) -> Plate:
    """The moment about the middle of the surface times ``factor``, as under a wrong unit."""
    c = plate.corners_m.mean(axis=0)
    carried = np.cross(c, plate.force_n)
    return replace(plate, moment_nm=carried + factor * (plate.moment_nm - carried))


def scaled(plate: Plate, factors: list[float]) -> Plate:
    """The force's channels times ``factors``; the moment channels about the sensor stay as they are."""
    c = plate.corners_m.mean(axis=0)
    force = plate.force_n * factors
    moment = plate.moment_nm - np.cross(c, plate.force_n) + np.cross(c, force)
    return replace(plate, force_n=force, moment_nm=moment)


def loaded(recording: Recording) -> list[int]:
    """Places of the plates that carry somebody inside the window."""
    i, j = (round(t * recording.force_rate_hz) for t in (WINDOW[0].start_s, WINDOW[0].end_s))
    return [k for k, plate in enumerate(recording.plates) if plate.force_n[i:j, 2].max() > 200.0]


def swapped() -> Recording:
    """The channels of two plates are exchanged: each has the other's signals under its own corners."""
    good = walk()
    a, b = loaded(good)[:2]
    plates = list(good.plates)
    for here, there in ((a, b), (b, a)):
        by_m = good.plates[here].corners_m.mean(axis=0) - good.plates[there].corners_m.mean(axis=0)
        signals = moved(good.plates[there], by_m)
        plates[here] = replace(good.plates[here], force_n=signals.force_n, moment_nm=signals.moment_nm)
    return replace(good, plates=tuple(plates))


def one_moved() -> Recording:
    """The second of the plates that carry somebody lies half a metre from where the file says."""
    good = walk()
    plates = list(good.plates)
    here = loaded(good)[1]
    plates[here] = moved(plates[here], np.array([0.0, 0.5, 0.0]))
    return replace(good, plates=tuple(plates))


@pytest.mark.parametrize(("seed", "speed_m_s"), [(1, 1.2), (2, 0.8), (3, 1.6)])
def test_a_good_walk_is_good(seed: int, speed_m_s: float) -> None:
    judged = judge(walk(seed, speed_m_s))
    assert judged.quality.verdict == "good", [c.message for c in judged.quality.checks if not c.passed]
    assert judged.quality.remarks == ()
    not_checked = {"mass_from_standing", "mass_uncertainty", "flight_acceleration"}
    assert set(judged.quality.not_checked) == not_checked, "a walk has no flight, and its mass is stated"


def test_a_good_walk_over_two_plates_is_good() -> None:
    recording = walk(lab="two_plates")
    windows = measured_windows(recording, identify(list(recording.markers_m)).landmarks)
    assert judge(recording, windows=windows).quality.verdict == "good"


FAULTS: dict[str, tuple[Callable[[], Judged], set[str]]] = {
    "moments-in-newton-millimetres": (
        lambda: judge(with_plates(lambda plate: about_middle(plate, 1000.0))),
        {"horizontal_bias", "outside_body", "pressure_from_feet", "pressure_off_plate"},
    ),
    "plates-moved-half-a-metre-along": (
        lambda: judge(with_plates(lambda plate: moved(plate, np.array([0.5, 0.0, 0.0])))),
        {"pressure_from_feet"},
    ),
    "plates-moved-half-a-metre-aside": (
        lambda: judge(with_plates(lambda plate: moved(plate, np.array([0.0, 0.5, 0.0])))),
        {"pressure_from_feet"},
    ),
    "one-plate-moved-half-a-metre": (lambda: judge(one_moved()), {"pressure_from_feet"}),
    "plates-moved-under-the-complementary-filter": (
        lambda: judge(with_plates(lambda plate: moved(plate, np.array([0.0, 0.5, 0.0]))), method=ComplementaryFilter()),
        {"pressure_from_feet", "horizontal_bias"},
    ),
    "plates-swapped": (lambda: judge(swapped()), {"pressure_from_feet"}),
    "mass-a-quarter-too-large": (lambda: judge(walk(), mass_kg=1.25 * MASS_KG), {"mass_from_motion"}),
    "mass-a-quarter-too-small": (lambda: judge(walk(), mass_kg=0.75 * MASS_KG), {"mass_from_motion"}),
    "vertical-channel-a-third-too-large": (
        lambda: judge(with_plates(lambda plate: scaled(plate, [1.0, 1.0, 1.33]))),
        {"mass_from_motion", "force_residual"},
    ),
    "fore-aft-channel-of-the-wrong-sign": (
        lambda: judge(with_plates(lambda plate: scaled(plate, [-1.0, 1.0, 1.0]))),
        {"acceleration_difference"},
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_contradicted_and_the_sensors_are_named(name: str) -> None:
    made, expected = FAULTS[name]
    quality = made().quality
    contradicting = {check.name for check in quality.checks if check.contradicts}
    assert expected <= contradicting
    assert quality.verdict == "contradicted"
    (remark,) = quality.remarks
    assert remark.code == "contradicted"
    for check in quality.checks:
        assert (check.message in remark.message) == check.contradicts
        assert check.message.endswith("contradict each other.") == check.contradicts


def test_the_plate_that_is_wrong_is_named() -> None:
    good = walk()
    index = good.plates[loaded(good)[1]].index
    message = judge(one_moved()).check("pressure_from_feet").message
    assert message.startswith(f"The centre of pressure of plate {index} lies")
    assert f"plate {index} (its place, its moments or its channels) and the foot markers contradict" in message


@pytest.mark.parametrize("factors", [[1.0, -1.0, 1.0], [0.0, 1.0, 1.0], [2.0, 1.0, 1.0]])
def test_a_horizontal_channel_that_is_wrong_is_not_good(factors: list[float]) -> None:
    """Weight and place are right, so the innovations contradict nothing: the markers' acceleration tells."""
    judged = judge(with_plates(lambda plate: scaled(plate, factors)))
    innovations = judged.check("normalised_innovations")
    assert innovations.value < innovations.contradicted_above
    assert not judged.check("acceleration_difference").passed
    assert judged.quality.verdict != "good"


def test_more_than_five_centimetres_from_the_geometry_are_never_without_an_error() -> None:
    """The filter follows the centre of pressure: its position moves with the plates, across the limit."""
    values = []
    for shift_m in (0.05, 0.10, 0.14, 0.17):
        shift = partial(moved, by_m=np.array([0.0, shift_m, 0.0]))
        judged = judge(with_plates(shift), method=ComplementaryFilter())
        check = judged.check("horizontal_bias")
        values.append(check.value)
        assert (check.value > 0.05) == check.contradicts
        assert check.contradicts == (judged.quality.verdict == "contradicted")
    assert min(values) < 0.05 < max(values)


@pytest.mark.parametrize("drift_mm", [-40.0, 40.0, 62.0, -62.0])
def test_five_centimetres_at_any_one_time_are_an_error_though_the_mean_is_small(drift_mm: float) -> None:
    """A result that drifts evenly off the geometry: its acceleration, and with it the force, says nothing of it."""
    recording = walk()
    landmarks = identify(list(recording.markers_m)).landmarks
    geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
    wrench = wrench_track(recording, WINDOW)
    good = GeometryOnly().estimate(geometric, wrench, MASS_KG)
    drift_m = np.linspace(0.0, 1e-3 * drift_mm, len(good.com_m))[:, None] * [1.0, 0.0, 0.0]
    quality = assess_quality(
        Recorded(recording, landmarks, geometric, wrench, MASS_KG), replace(good, com_m=good.com_m + drift_m)
    )
    contradicting = [check.name for check in quality.checks if check.contradicts]
    assert contradicting == (["largest_difference"] if abs(drift_mm) > 50.0 else [])
    assert (quality.verdict == "contradicted") == bool(contradicting)
    (check,) = [check for check in quality.checks if check.name == "largest_difference"]
    assert check.value == pytest.approx(1e-3 * abs(drift_mm), rel=0.02)
    assert f"is {abs(drift_mm):.0f} mm from" in check.message


def test_other_methods_get_the_checks_that_they_allow() -> None:
    good = judge(walk(), method=ComplementaryFilter())
    assert good.quality.verdict == "good"
    assert good.quality.not_checked["normalised_innovations"] == "only the smoother has innovations"
    recording = walk()
    landmarks = identify(list(recording.markers_m)).landmarks
    geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
    wrench = wrench_track(recording, WINDOW)
    estimate = GeometryOnly().estimate(geometric, wrench, MASS_KG)
    quality = assess_quality(Recorded(recording, landmarks, geometric, wrench, MASS_KG, with_force=False), estimate)
    assert {check.name for check in quality.checks} == set(MARKER_CHECKS) - {"model_leg_mass"}
    assert quality.not_checked["force_residual"] == "no force was used"
    assert quality.verdict == "good"


def test_markers_of_exchanged_joints_are_refused_without_force() -> None:
    """The names of the left and the right outer knee are exchanged."""
    good = walk()
    landmarks = identify(list(good.markers_m)).landmarks
    one, other = landmarks["l_knee_lateral"], landmarks["r_knee_lateral"]
    markers = dict(good.markers_m) | {one: good.markers_m[other], other: good.markers_m[one]}
    with pytest.raises(NotEstimable) as refusal:
        SegmentModel().com(replace(good, markers_m=markers), landmarks, subject=good.subject)
    assert refusal.value.code == "sides-swapped"


def test_a_marker_that_jumps_between_joints_is_noticed_without_force() -> None:
    """In half of the frames the outer knee and ankle of one leg are exchanged."""
    good = walk()
    landmarks = identify(list(good.markers_m)).landmarks
    one, other = landmarks["l_knee_lateral"], landmarks["l_ankle_lateral"]
    early = np.arange(good.n_frames)[:, None] < good.n_frames // 2
    pair = good.markers_m[one], good.markers_m[other]
    markers = dict(good.markers_m) | {one: np.where(early, *pair), other: np.where(early, *pair[::-1])}
    exchanged = replace(good, markers_m=markers)
    geometric = SegmentModel().com(exchanged, landmarks, subject=good.subject)
    wrench = wrench_track(exchanged, WINDOW)
    estimate = GeometryOnly().estimate(geometric, wrench, MASS_KG)
    quality = assess_quality(Recorded(exchanged, landmarks, geometric, wrench, MASS_KG, with_force=False), estimate)
    (check,) = [check for check in quality.checks if check.name == "leg_length_change"]
    assert not check.passed
    assert quality.verdict != "good"


def test_without_a_single_check_nothing_is_good() -> None:
    quality = evaluate_checks(Measures(), MASS_KG, (0.01, 0.01, 0.02))
    assert quality.checks == ()
    assert quality.verdict == "doubtful"
    assert quality.remarks[0].code == "doubtful"


@pytest.mark.parametrize(("uncertainty", "verdict"), [(0.039, "good"), (0.041, "doubtful"), (0.9, "doubtful")])
def test_a_measured_mass_that_is_hardly_known_is_doubtful_and_contradicts_nothing(
    uncertainty: float, verdict: str
) -> None:
    quality = evaluate_checks(Measures(mass_uncertainty=uncertainty), MASS_KG, (0.01, 0.01, 0.02))
    assert quality.verdict == verdict
    assert f"standard deviation of {uncertainty:.1%}" in quality.checks[0].message


def test_the_hull_of_a_box_tells_how_far_outside_a_point_is() -> None:
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 3.0)])
    points = np.array([[0.5, 1.0, 1.5], [1.25, 1.0, 1.5], [0.5, 1.0, -0.5]])
    np.testing.assert_allclose(distance_outside_m(points, np.tile(corners, (3, 1, 1))), [0.0, 0.25, 0.5], atol=1e-12)
    flat = np.tile(corners * [1.0, 1.0, 0.0], (3, 1, 1))
    assert np.isnan(distance_outside_m(points, flat)).all()


def test_force_and_motion_weigh_a_body_that_jumps() -> None:
    """z = sin t is no walk and not periodic in the interval; f = m (z'' + g)."""
    t = np.linspace(0.0, 0.8, 400)
    z = 0.1 * np.sin(3.0 * t) + 0.2 * t
    f = 63.0 * (-0.9 * np.sin(3.0 * t) + GRAVITY_M_S2)
    assert dynamic_mass_kg(t + 5.0, z + 0.9, f) == pytest.approx(63.0, rel=1e-4)
    assert np.isnan(dynamic_mass_kg(t, z, np.zeros_like(t)))


def test_the_segment_that_changes_most_is_named() -> None:
    n = 50
    swing = np.linspace(0.0, 1.0, n)[:, None]
    joints = {
        "l_hip": np.zeros((n, 3)),
        "l_knee": np.array([0.0, 0.0, -0.4]) + np.zeros((n, 3)),
        "l_ankle": np.array([0.0, 0.0, -0.8]) - 0.04 * swing * [0.0, 0.0, 1.0],
    }
    name, change = length_change(joints)  # type: ignore[misc]
    assert name == "left shank"
    assert change == pytest.approx(0.9 * 0.04 / 0.42, rel=0.02)
    assert length_change({}) is None
