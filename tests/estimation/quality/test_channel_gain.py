"""The gain of the force channels on walks whose truth is known: scaled, reversed and dead channels are named."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.quality import Quality, Recorded, assess_quality
from stridelab.estimation.quality.channel_gain import ChannelGain, channel_gains, exchange_ratio
from stridelab.estimation.quality.plate_checks import force_balance
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.recording import Plate, Recording, Window
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise

MASS_KG = 70.0
WINDOW = (Window(0.9, 2.1),)
NOISE = MeasurementNoise(force_n=3.0, moment_nm=2.0, marker_m=0.001, mass_model=0.1)


@cache
def walk(seed: int = 1, speed_m_s: float = 1.2) -> Recording:
    walker = HumanWalker(1.75, MASS_KG, "male", speed_m_s=speed_m_s, duration_s=3.0, seed=seed).walk()
    return record(walker, NOISE, seed, lab="walkway").recording


@cache
def geometry(seed: int = 1, speed_m_s: float = 1.2) -> GeometricCom:
    recording = walk(seed, speed_m_s)
    landmarks = identify(list(recording.markers_m)).landmarks
    return SegmentModel().com(recording, landmarks, subject=recording.subject)


def with_channel(axis: int, factor: float, only: int | None = None) -> Recording:
    """The walk, along x, with one channel of all plates, or of one, times ``factor``."""
    factors = np.eye(3)
    factors[axis, axis] = factor
    return with_channels(factors, only)


def with_channels(mixed: np.ndarray, only: int | None = None) -> Recording:
    """The walk with the forces of all plates, or of one, times a matrix."""

    def changed(plate: Plate) -> Plate:
        return replace(plate, force_n=plate.force_n @ mixed)

    good = walk()
    return replace(good, plates=tuple(changed(p) if only in (None, p.index) else p for p in good.plates))


def gains(recording: Recording) -> tuple[ChannelGain, ...]:
    return channel_gains(force_balance(recording, geometry(), wrench_track(recording, WINDOW), MASS_KG))


def quality(recording: Recording) -> Quality:
    wrench = wrench_track(recording, WINDOW)
    landmarks = identify(list(recording.markers_m)).landmarks
    estimate = Smoother().estimate(geometry(), wrench, MASS_KG)
    return assess_quality(Recorded(recording, landmarks, geometry(), wrench, MASS_KG), estimate)


def worst(found: tuple[ChannelGain, ...]) -> ChannelGain:
    return max(found, key=lambda gain: gain.deviation)


@pytest.mark.parametrize(("seed", "speed_m_s"), [(1, 1.2), (2, 0.8), (3, 1.6), (4, 1.2)])
def test_right_channels_have_a_gain_of_one(seed: int, speed_m_s: float) -> None:
    recording = walk(seed, speed_m_s)
    result = channel_gains(
        force_balance(recording, geometry(seed, speed_m_s), wrench_track(recording, WINDOW), MASS_KG)
    )
    assert {gain.axis for gain in result} >= {"along the walk", "vertically"}
    assert max(gain.deviation for gain in result) < 0.15
    for gain in result:
        if gain.axis == "vertically":
            assert gain.gain == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("factor", [0.5, 2.0, -1.0])
def test_a_fore_aft_channel_that_is_scaled_or_reversed_is_contradicted(factor: float) -> None:
    gain = worst(gains(with_channel(0, factor)))
    assert gain.axis == "along the walk"
    assert gain.gain == pytest.approx(1.0 / factor, rel=0.3)
    (check,) = [one for one in quality(with_channel(0, factor)).checks if one.name == "channel_gain"]
    assert check.contradicts
    assert f"needs {gain.gain:.2f} times" in check.message
    assert "along the walk" in check.message


def test_a_half_scaled_channel_passed_every_other_check() -> None:
    contradicting = {one.name for one in quality(with_channel(0, 0.5)).checks if one.contradicts}
    assert contradicting == {"channel_gain"}


def test_a_lateral_channel_of_the_wrong_sign_is_contradicted() -> None:
    gain = worst(gains(with_channel(1, -1.0)))
    assert (gain.axis, gain.plate) == ("across the walk", 0)
    assert gain.gain < 0.0
    assert gain.deviation > 0.5


@pytest.mark.parametrize(("factor", "verdict"), [(0.5, "contradicted"), (2.0, "contradicted"), (1.0, "good")])
def test_a_lateral_channel_that_is_scaled_is_contradicted(factor: float, verdict: str) -> None:
    """Newton's law alone cannot tell: soft tissue shakes the markers as much as the walk sways."""
    result = quality(with_channel(1, factor))
    assert result.verdict == verdict
    (check,) = [one for one in result.checks if one.name == "channel_gain"]
    assert check.contradicts == (factor != 1.0)
    assert ("across the walk" in check.message) == (factor != 1.0)


def main_plate(good: Recording) -> int:
    """The plate that carries the body longest in the window."""
    i, j = (round(t * good.force_rate_hz) for t in (1.1, 1.9))
    return max(good.plates, key=lambda plate: int((plate.force_n[i:j, 2] > 400.0).sum())).index


@pytest.mark.parametrize("factor", [0.5, 2.0, -1.0])
def test_a_lateral_channel_of_one_plate_that_is_scaled_is_named(factor: float) -> None:
    index = main_plate(walk())
    gain = worst(gains(with_channel(1, factor, only=index)))
    assert (gain.axis, gain.plate) == ("across the walk", index)
    assert gain.gain == pytest.approx(1.0 / factor, rel=0.3)
    (check,) = [one for one in quality(with_channel(1, factor, only=index)).checks if one.name == "channel_gain"]
    assert check.contradicts
    assert f"across the walk that plate {index} measures" in check.message


def test_a_lateral_channel_of_one_plate_is_not_judged_where_the_trunk_is_not_marked() -> None:
    index = main_plate(walk())
    recording = with_channel(1, 0.5, only=index)
    labels = identify(list(recording.markers_m)).landmarks
    legs = {name: label for name, label in labels.items() if name not in ("c7", "jugular_notch")}
    lateral = []
    for landmarks in (labels, legs):
        geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
        balance = force_balance(recording, geometric, wrench_track(recording, WINDOW), MASS_KG)
        assert balance is not None
        assert balance.trunk_is_marked == (landmarks is labels)
        lateral.append({g.plate for g in channel_gains(balance) if g.axis == "across the walk"} - {0})
    assert index in lateral[0]
    assert not lateral[1]


def test_a_lateral_channel_of_one_plate_is_not_judged_in_a_turn() -> None:
    """Across the walk is not across the body there."""
    balance = force_balance(walk(), geometry(), wrench_track(walk(), WINDOW), MASS_KG)
    assert balance is not None
    angle = np.linspace(0.0, np.radians(60.0), len(balance.position_m))
    arc_m = np.column_stack([np.sin(angle), 1.0 - np.cos(angle), balance.position_m[:, 2]])
    turning = replace(balance, position_m=arc_m)
    assert (balance.is_straight, turning.is_straight) == (True, False)
    single = [{g.plate for g in channel_gains(b) if g.axis == "across the walk"} - {0} for b in (balance, turning)]
    assert single[0]
    assert not single[1]


def test_errors_of_the_markers_that_exceed_the_lateral_force_judge_no_lateral_channel() -> None:
    """Soft tissue of a runner asks for more lateral force than the plates measure, and another one at every step."""
    balance = force_balance(walk(), geometry(), wrench_track(walk(), WINDOW), MASS_KG)
    assert balance is not None
    assert balance.moment_needed_n is not None
    measured_n = balance.levered_n[:, :, 1].sum(axis=0)
    phase = np.linspace(0.0, 2.0 * np.pi, len(measured_n))
    shaken_n = 2.0 * measured_n.std() * np.sin(7.0 * phase)
    lateral = {"across the walk"} & {gain.axis for gain in channel_gains(balance)}
    moment_n = np.column_stack([balance.moment_needed_n[:, 0], 0.3 * measured_n + shaken_n])
    shaken = replace(balance, moment_needed_n=moment_n)
    assert lateral
    assert not {"across the walk"} & {gain.axis for gain in channel_gains(shaken)}


@pytest.mark.parametrize(("axis", "name"), [(0, "along the walk"), (1, "across the walk")])
def test_a_dead_channel_of_one_plate_among_several_is_named(axis: int, name: str) -> None:
    good = walk()
    index = main_plate(good)
    dead = [gain for gain in gains(with_channel(axis, 0.0, only=index)) if math.isinf(gain.gain)]
    assert [(gain.plate, gain.axis) for gain in dead] == [(index, name)]
    result = quality(with_channel(axis, 0.0, only=index))
    assert result.verdict == "contradicted"
    (check,) = [one for one in result.checks if one.name == "channel_gain"]
    assert f"a force {name}, and plate {index} measures next to none" in check.message


EXCHANGED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("one", [False, True])
def test_exchanged_horizontal_channels_are_named(one: bool, sign: float) -> None:
    mixed = EXCHANGED * [1.0, sign, 1.0]
    result = quality(with_channels(mixed, main_plate(walk()) if one else None))
    (check,) = [one for one in result.checks if one.name == "channel_exchange"]
    assert check.contradicts
    assert "exchanged" in check.message
    assert result.verdict == "contradicted"


def test_channels_that_are_right_dead_or_scaled_are_not_called_exchanged() -> None:
    for recording in (walk(), with_channel(0, 0.5), with_channel(0, 0.0), with_channel(1, -1.0)):
        (check,) = [one for one in quality(recording).checks if one.name == "channel_exchange"]
        assert check.passed
        if check.value == 0.0:
            assert "more than half of the force that the motion of the markers needs is unexplained" in check.message
        assert "000000" not in check.message


def test_feet_side_by_side_that_push_apart_have_no_gain_of_their_own() -> None:
    """Somebody jumps on two plates: the forces of the feet along x cancel, and move nothing."""
    good = walk()
    t = np.arange(len(good.plates[0].force_n)) / good.force_rate_hz
    push_n = np.column_stack([60.0 * np.sin(9.0 * t), 0.0 * t, MASS_KG * 9.81 / 2 * (1.0 + 0.3 * np.sin(9.0 * t))])
    apart = tuple(
        replace(plate, force_n=push_n * [sign, 1.0, 1.0]) for plate, sign in zip(good.plates, (1, -1), strict=False)
    )
    still = replace(geometry(), com_m=np.tile(geometry().com_m.mean(axis=0), (len(geometry().com_m), 1)))
    balance = force_balance(replace(good, plates=apart), still, wrench_track(good, WINDOW), MASS_KG)
    assert balance is not None
    assert not balance.is_walk
    assert {(gain.axis, gain.plate) for gain in channel_gains(balance) if gain.plate} <= {
        ("vertically", 1),
        ("vertically", 2),
    }
    assert math.isnan(exchange_ratio(balance))


def test_the_one_plate_that_is_wrong_is_named() -> None:
    good = walk()
    i, j = (round(t * good.force_rate_hz) for t in (1.1, 1.9))
    (index, *_) = [plate.index for plate in good.plates if plate.force_n[i:j, 2].max() > 400.0]
    gain = worst(gains(with_channel(0, -1.0, only=index)))
    assert gain.plate == index
    assert gain.gain < -0.4


def test_a_dead_channel_of_a_walk_is_contradicted() -> None:
    gain = worst(gains(with_channel(0, 0.0)))
    assert math.isinf(gain.gain)
    (check,) = [one for one in quality(with_channel(0, 0.0)).checks if one.name == "channel_gain"]
    assert check.contradicts
    assert check.message.startswith("The motion of the markers needs a force along the walk, and the plates together")
    assert "next to none" in check.message


def test_a_recording_played_at_the_wrong_rate_is_contradicted() -> None:
    """Markers and force of 100 and 1000 Hz that the file states as 125 and 1250 Hz: accelerations are 1.56 times."""
    good = walk()
    factor = 1.25
    fast = replace(good, marker_rate_hz=factor * good.marker_rate_hz, force_rate_hz=factor * good.force_rate_hz)
    landmarks = identify(list(fast.markers_m)).landmarks
    geometric = SegmentModel().com(fast, landmarks, subject=fast.subject)
    window = (Window(WINDOW[0].start_s / factor, WINDOW[0].end_s / factor),)
    result = channel_gains(force_balance(fast, geometric, wrench_track(fast, window), MASS_KG))
    vertical = [gain for gain in result if gain.axis == "vertically"]
    assert max(gain.deviation for gain in vertical) > 0.25
    assert vertical[0].gain == pytest.approx(factor**2, rel=0.15)


def test_standing_has_no_channel_to_judge() -> None:
    still = replace(geometry(), com_m=np.tile(geometry().com_m.mean(axis=0), (len(geometry().com_m), 1)))
    good = walk()
    weight_n = MASS_KG * 9.81
    quiet = replace(
        good,
        plates=tuple(
            replace(p, force_n=np.tile([0.0, 0.0, weight_n / 2], (len(p.force_n), 1))) for p in good.plates[:2]
        ),
    )
    assert channel_gains(force_balance(quiet, still, wrench_track(quiet, WINDOW), MASS_KG)) == ()
