"""Balance frame by frame: against the offline estimate of the same walk, with everything that a live stream lacks."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import Points
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.online.balance import (
    COAST_WITH_FORCE_S,
    BalanceSample,
    BalanceSetup,
    OnlineBalance,
)
from stridelab.estimation.online.foot_support import PlateReading
from stridelab.recordings.force_windows import require_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import sampled_wrench, wrench_track
from stridelab.recordings.recording import Subject
from support.recordings.walks import landmarks as standing_landmarks
from support.service.streams import sample

LABELS = dict(identify(list(sample().markers_m)).landmarks)
FRAMES = np.stack([sample().markers_m[label] for label in LABELS.values()], axis=1)
ORDER = list(LABELS)
TIME_S = sample().time_s


@cache
def readings() -> list[list[PlateReading]]:
    rate_hz = sample().force_rate_hz
    tracks = [sampled_wrench(plate, rate_hz, TIME_S) for plate in sample().plates]
    return [[PlateReading(f[k], nu[k]) for f, nu in tracks] for k in range(len(TIME_S))]


FIRST, LAST = 120, 295
"""The part of the sample that is played: up to and a little beyond the end of the force."""


def setup(**fields: Any) -> BalanceSetup:
    plates = [plate.corners_m for plate in sample().plates]
    return replace(BalanceSetup(LABELS, sample().subject, sample().marker_rate_hz, plates), **fields)


def played(
    used: BalanceSetup, frames: Points, skipped: Sequence[int] = (), late: Mapping[int, Any] | None = None
) -> list[BalanceSample]:
    balance = OnlineBalance(used)
    reports = []
    for k in range(FIRST, min(LAST, len(frames))):
        if k not in skipped:
            plates = readings()[k] if used.plates_m else []
            reports.append(balance.step(float(TIME_S[k]), frames[k], (late or {}).get(k, plates)))
    return reports


def at(told: Sequence[BalanceSample], k: int) -> BalanceSample:
    """The answer to frame ``k``, where none was skipped."""
    return told[k - FIRST]


@cache
def undisturbed() -> list[BalanceSample]:
    return played(setup(), FRAMES)


@cache
def by_markers() -> list[BalanceSample]:
    """The walk without plates."""
    return played(setup(plates_m=[]), FRAMES)


def hidden(landmark: str, first: int, last: int, frames: Points = FRAMES) -> Points:
    masked = frames.copy()
    masked[first:last, ORDER.index(landmark)] = np.nan
    return masked


def com_m(told: Sequence[BalanceSample]) -> Points:
    return np.array([[math.nan] * 3 if one.com is None else one.com.com_m for one in told])


@cache
def offline() -> tuple[np.ndarray, Points]:
    """Instants and positions of the offline estimate, in the window in which all force is measured."""
    geometric = SegmentModel("dumas2007").com(sample(), LABELS, subject=sample().subject)
    wrench = wrench_track(sample(), require_windows(sample(), LABELS))
    estimate = ComplementaryFilter().estimate(geometric, wrench, sample().subject.mass_kg or 0.0)
    return estimate.time_s, estimate.com_m


def error_mm(told: Sequence[BalanceSample]) -> np.ndarray:
    """RMS difference from the offline estimate per axis."""
    time_s, positions = offline()
    at_s = np.array([one.time_s for one in told])
    inside = (at_s >= time_s[0]) & (at_s <= time_s[-1])
    truth = np.column_stack([np.interp(at_s[inside], time_s, positions[:, axis]) for axis in range(3)])
    return np.asarray(1e3 * np.sqrt(np.mean((com_m(told)[inside] - truth) ** 2, axis=0)))


def test_a_whole_walk_is_within_millimetres_of_the_offline_estimate() -> None:
    reports = undisturbed()
    assert (error_mm(reports) < [5.0, 3.0, 3.0]).all()
    assert {one.bridged.force for one in reports} == {None, "foot-beside-plates"}


def test_a_tenth_of_the_frames_may_be_lost() -> None:
    skipped = np.flatnonzero(np.random.default_rng(5).random(len(FRAMES)) < 0.1).tolist()
    reports = played(setup(), FRAMES, skipped)
    assert (error_mm(reports) < [5.0, 3.0, 3.0]).all()
    inside = [k for k in skipped if reports[0].time_s < TIME_S[k] < reports[-1].time_s]
    assert sum(one.bridged.frames_lost for one in reports) == len(inside)


@pytest.mark.parametrize(("landmark", "worst_mm"), [("l_knee_lateral", 5.0), ("r_asis", 5.0), ("r_acromion", 12.0)])
def test_a_marker_may_be_lost_for_half_a_second(landmark: str, worst_mm: float) -> None:
    """A marker of a cluster is rebuilt from its neighbours; the acromion has none: the force carries the CoM on."""
    reports = played(setup(), hidden(landmark, 200, 250))
    assert error_mm(reports).max() < worst_mm
    assert all(one.com is not None for one in reports)
    assert all(landmark in one.bridged.hidden for one in reports[200 - FIRST : 250 - FIRST])


def test_without_force_the_velocity_carries_on_and_then_a_substitute() -> None:
    """One hand: 0.1 s by velocity, then a mean hand at the stated cost; never a jump."""
    frames = FRAMES
    for name in ("r_wrist_radial", "r_wrist_ulnar", "r_mc2", "r_mc5"):
        frames = hidden(name, 200, 270, frames)
    reports = played(setup(plates_m=[]), frames)
    sources = {k: at(reports, k).bridged.geometry for k in (199, 201, 211, 240, 269, 271)}
    assert sources == {
        199: "measured", 201: "coasted", 211: "substituted", 240: "substituted", 269: "substituted", 271: "measured"
    }  # fmt: skip
    assert np.abs(np.diff(com_m(reports), axis=0)).max() < 0.03
    with_hand, without = at(reports, 190).com, at(reports, 240).com
    assert with_hand is not None
    assert without is not None
    assert without.sd_m[0] > with_hand.sd_m[0]


def test_no_pelvis_no_estimate_and_it_comes_back() -> None:
    frames = FRAMES
    for name in ("l_asis", "r_asis", "l_psis", "r_psis"):
        frames = hidden(name, 140, 260, frames)
    reports = played(setup(plates_m=[]), frames)
    assert at(reports, 142).com is not None
    gone = reports[155 - FIRST : 260 - FIRST]
    assert all(one.com is None and one.xcom_m is None and one.margin_ml_m is None for one in gone)
    assert {one.reason for one in gone} == {"pelvis-markers-missing"}
    assert {one.margin_reason for one in gone} == {"pelvis-markers-missing"}
    assert at(reports, 262).com is not None
    assert np.abs(com_m(reports)[-15:] - com_m(by_markers())[-15:]).max() < 0.005


def test_the_first_frames_without_markers_have_no_estimate() -> None:
    frames = FRAMES.copy()
    frames[: FIRST + 20] = np.nan
    reports = played(setup(), frames[: FIRST + 30])
    assert all(one.com is None and one.reason for one in reports[:20])
    assert reports[20].com is not None


def test_a_frame_out_of_order_changes_nothing() -> None:
    plain, disturbed = OnlineBalance(setup()), OnlineBalance(setup())
    for k in range(30):
        expected = plain.step(float(TIME_S[k]), FRAMES[k], readings()[k])
        reports = disturbed.step(float(TIME_S[k]), FRAMES[k], readings()[k])
        late = disturbed.step(float(TIME_S[k] - 0.005), FRAMES[k], readings()[k])
        assert (late.com, late.reason, late.margin_reason) == (None, "frame-late", "frame-late")
        assert expected.com is not None
        assert reports.com is not None
        assert reports.com.com_m.tolist() == expected.com.com_m.tolist()


def test_a_jump_of_time_starts_anew() -> None:
    balance = OnlineBalance(setup())
    for k in range(50):
        balance.step(float(TIME_S[k]), FRAMES[k], readings()[k])
    after = balance.step(float(TIME_S[50]) + 100.0, FRAMES[280], readings()[280])
    assert after.bridged.restarted
    assert after.com is not None
    assert after.com.com_m == pytest.approx(com_m(undisturbed())[280 - FIRST], abs=0.02)


def test_a_late_plate_is_remarked_on_and_the_estimate_goes_on() -> None:
    whole = undisturbed()
    used = [k for k in range(FIRST, LAST) if at(whole, k).bridged.force is None]
    late = {k: [None, None] for k in used[20:40]}
    reports = played(setup(), FRAMES, late=late)
    assert {at(reports, k).bridged.force for k in late} == {"plate-late"}
    assert np.abs(com_m(reports) - com_m(whole)).max() < 0.01


def test_without_mass_the_force_is_not_used() -> None:
    light = replace(sample().subject, mass_kg=None)
    reports = played(setup(subject=light), FRAMES[:230])
    assert {one.bridged.force for one in reports} == {"mass-not-stated", "foot-beside-plates"}


def test_a_body_at_rest_stands_inside_its_base() -> None:
    """An independent truth: symmetric and still, XCoM over CoM, the margin sideways half of the outer width."""
    tracks = standing_landmarks(1)
    names = {name: name for name in tracks}
    still = np.stack([track[0] for track in tracks.values()])
    balance = OnlineBalance(BalanceSetup(names, Subject(1.75, 70.0, "male"), 100.0))
    reports = [balance.step(k / 100.0, still) for k in range(60)][-1]
    assert reports.com is not None
    assert reports.xcom_m is not None
    assert reports.margin_ap_m is not None
    assert reports.contact == {"left": True, "right": True}
    assert reports.xcom_m[:2] == pytest.approx(reports.com.com_m[:2], abs=1e-6)
    assert reports.ahead == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)
    outer_m = reports.base_m[:, 1].max()
    assert outer_m == pytest.approx(-reports.base_m[:, 1].min(), abs=1e-9)
    assert reports.margin_ml_m == pytest.approx(outer_m - abs(reports.com.com_m[1]), abs=1e-6)
    assert reports.margin_ap_m == pytest.approx(reports.base_m[:, 0].max() - reports.com.com_m[0], abs=1e-6)
    assert reports.speed_m_s == pytest.approx(0.0, abs=1e-6)


def test_a_belt_counts_as_ground() -> None:
    """Walking in place on a belt is the same walk: height, XCoM ahead of the CoM, and margins."""
    speed_m_s = float(np.polyfit(TIME_S, FRAMES[:, ORDER.index("l_asis"), 0], 1)[0])
    over_ground = by_markers()
    carried = FRAMES - (speed_m_s * TIME_S)[:, None, None] * [1.0, 0.0, 0.0]
    on_belt = played(setup(plates_m=[], belt_m_s=speed_m_s), carried)
    for name in ("height_m", "speed_m_s", "margin_ap_m", "margin_ml_m"):
        ground, belt = (
            np.array([getattr(one, name) for one in reports[50:]], dtype=float) for reports in (over_ground, on_belt)
        )
        same = np.isfinite(ground) & np.isfinite(belt)
        assert same.mean() > 0.9
        assert np.median(np.abs(ground[same] - belt[same])) < 0.02, name


def test_the_body_is_carried_on_by_force_for_half_a_second_at_most() -> None:
    whole = undisturbed()
    first = next(k for k in range(FIRST, LAST) if at(whole, k).bridged.force is None) + 5
    reports = played(setup(), hidden("r_acromion", first, first + 70)[: first + 75])
    coasted = [one.bridged.geometry for one in reports].count("coasted")
    assert coasted == pytest.approx(COAST_WITH_FORCE_S * 100.0, abs=2)
