"""Physical checks on motions for which physics is written out here once more."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.body.geometric_com import GeometricCom, SegmentTrack
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.evaluation.physics_residuals import (
    assess_flight,
    assess_standing,
    momentum_agreement,
    segment_momentum_rate,
)
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.recordings.recording import Window, WrenchTrack
from support.recordings.analytic_motions import Harmonics, Motion, walk

T = np.arange(300) / 100.0
WINDOW = Window(0.2, 2.8)


def estimated(
    motion: Motion, shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0), window: Window = WINDOW
) -> ComEstimate:
    given = GeometryOnly().estimate(motion.geometric(T), motion.wrench_track(T, window), motion.mass_kg)
    return replace(given, com_m=given.com_m + np.array(shift_m))


def hops(g_m_s2: float) -> tuple[ComEstimate, WrenchTrack]:
    """0.2 s on the ground, 0.3 s in the air, again and again, falling with ``g_m_s2``."""
    motion = walk()
    phase = T % 0.5
    aloft = phase >= 0.2
    u = phase - 0.35
    z = np.where(aloft, 1.0 - 0.5 * g_m_s2 * u**2, 0.9)
    force = np.where(aloft, 0.0, 1700.0)[:, None] * np.array([0.0, 0.0, 1.0])
    wrench = WrenchTrack(T, force, 0 * force, np.ones(len(T), dtype=bool), (Window(0.0, 3.0),))
    com = np.column_stack([1.2 * T, 0 * T, z])
    return replace(estimated(motion, window=Window(0.0, 3.0)), com_m=com), wrench


def test_in_flight_the_body_falls_with_g_or_a_remark_says_so() -> None:
    free = assess_flight(*hops(9.81))
    assert free is not None
    assert free.flights == 5  # the last one is not seen to its end
    assert free.vertical_share == pytest.approx(0.0, abs=1e-9)
    assert free.horizontal_m_s2 == pytest.approx(0.0, abs=1e-9)
    floating = assess_flight(*hops(9.0))
    assert floating is not None
    assert floating.vertical_share == pytest.approx(9.0 / 9.81 - 1.0, abs=1e-9)


def test_a_walk_has_no_flight_and_no_standing() -> None:
    motion = walk()
    wrench = motion.wrench_track(T, WINDOW)
    assert assess_flight(estimated(motion), wrench) is None
    assert assess_standing(estimated(motion), motion.geometric(T), wrench) is None


@pytest.mark.parametrize("height_m", [0.0, 0.3])
def test_standing_still_the_pressure_lies_below_the_com(height_m: float) -> None:
    sway = ((0.5, np.array([0.002, 0.001, 0.0]), 0.0),)
    motion = Motion(Harmonics(np.array([0.4, -0.1, 0.95]), np.zeros(3), sway))
    wrench, geometric = motion.wrench_track(T, Window(0.0, 2.0)), motion.geometric(T)
    exact = estimated(motion, window=Window(0.0, 2.0))
    standing = assess_standing(exact, geometric, wrench, height_m)
    assert standing is not None
    assert standing.horizontal_m < 1e-4
    shifted = assess_standing(
        replace(exact, com_m=exact.com_m + np.array([0.006, -0.008, 0.0])), geometric, wrench, height_m
    )
    assert shifted is not None
    assert shifted.offset_m == pytest.approx((0.006, -0.008), abs=1e-4)
    assert shifted.horizontal_m == pytest.approx(0.01, abs=1e-4)


def test_the_pressure_of_somebody_who_is_pushed_is_that_on_the_floor() -> None:
    """A level force of 20 N through a point on the ground: 0.3 m higher its line is 0.3 times 20/700 further on."""
    motion = Motion(Harmonics(np.array([0.4, -0.1, 0.95]), np.zeros(3)))
    exact, geometric = estimated(motion, window=Window(0.0, 2.0)), motion.geometric(T)
    force = np.tile([20.0, -7.0, 700.0], (len(T), 1))
    wrench = replace(
        motion.wrench_track(T, Window(0.0, 2.0)), force_n=force, moment_nm=np.cross([0.1, 0.2, 0.0], force)
    )
    on_floor = assess_standing(exact, geometric, wrench)
    above = assess_standing(exact, geometric, wrench, 0.3)
    assert on_floor is not None
    assert above is not None
    assert on_floor.offset_m == pytest.approx((0.3, -0.3))
    assert above.offset_m == pytest.approx((0.3 - 0.3 * 20 / 700, -0.3 + 0.3 * 7 / 700))
    assert above.horizontal_m == pytest.approx(np.hypot(*above.offset_m))


def dumbbell() -> tuple[Motion, GeometricCom]:
    """Two masses that swing against each other about a CoM that walks: L and its rate by hand."""
    m, share, amplitude, w = 70.0, 0.25, 0.2, 2 * np.pi * 0.9
    arm = np.column_stack([amplitude * np.sin(w * T), 0 * T, -0.5 + 0 * T])
    other = -share / (1 - share) * arm
    # L_y = sum m_i (z x' - x z') = reduced mass times z x'; both z are constant.
    reduced = m * share / (1 - share)
    l_y_amplitude = reduced * -0.5 * amplitude * w
    momentum = Harmonics(np.zeros(3), np.zeros(3), ((0.9, np.array([0.0, l_y_amplitude, 0.0]), np.pi / 2),))
    motion = Motion(walk().com, momentum, m)
    com = motion.com.at(T)
    segments = {"leg": SegmentTrack(share, com + arm), "rest": SegmentTrack(1 - share, com + other)}
    return motion, replace(motion.geometric(T), segments=segments)


def test_the_momentum_of_the_segments_is_that_of_point_masses() -> None:
    motion, geometric = dumbbell()
    rate = segment_momentum_rate(geometric, motion.mass_kg)
    assert rate is not None
    true = motion.momentum.at(T, 1)
    assert np.ptp(true[:, 1]) > 30.0
    assert rate[30:-30] == pytest.approx(true[30:-30], abs=0.02 * np.ptp(true[:, 1]))


def test_where_the_geometry_has_a_gap_at_its_start_the_momentum_begins_after_it() -> None:
    motion, geometric = dumbbell()
    com = geometric.com_m.copy()
    com[:40] = np.nan
    rate = segment_momentum_rate(replace(geometric, com_m=com), motion.mass_kg)
    assert rate is not None
    assert np.isnan(rate[:40]).all()
    true = motion.momentum.at(T, 1)
    assert rate[70:-30] == pytest.approx(true[70:-30], abs=0.02 * np.ptp(true[:, 1]))


def test_a_right_com_implies_the_momentum_of_the_segments_and_a_wrong_one_does_not() -> None:
    motion, geometric = dumbbell()
    wrench = motion.wrench_track(T, WINDOW)
    right = momentum_agreement(estimated(motion), geometric, wrench, motion.mass_kg)
    wrong = momentum_agreement(estimated(motion, (0.02, 0.0, 0.0)), geometric, wrench, motion.mass_kg)
    assert right is not None
    assert wrong is not None
    assert right.correlation[1] > 0.999
    assert right.rms_nm[1] < 1.0
    assert wrong.rms_nm[1] == pytest.approx(0.02 * 70 * 9.81, rel=0.1)  # b f_z


def test_without_segments_there_is_nothing_to_hold_the_momentum_against() -> None:
    motion = walk()
    assert momentum_agreement(estimated(motion), motion.geometric(T), motion.wrench_track(T, WINDOW), 70.0) is None
