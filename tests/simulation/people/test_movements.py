"""Drawn motions obey mechanics exactly, and no stride repeats the one before."""

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.interpolate import make_interp_spline

from experiments.people.limbs import LIMBS
from experiments.people.movements import MOVEMENTS, RATE_HZ, DrawnMotion, Movement, draw_motion, draw_person
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.wrench import contact_force


def motion_of(movement: Movement, seed: int = 0, *, belt: bool = False) -> DrawnMotion:
    rng = default_rng(seed)
    return draw_motion(rng, movement, draw_person(rng), 5.0, belt=belt)


@pytest.mark.parametrize("movement", MOVEMENTS)
def test_the_force_accelerates_the_centre_of_mass(movement: Movement) -> None:
    motion = motion_of(movement)
    second = np.diff(motion.com_m, 2, axis=0) * RATE_HZ**2
    expected = contact_force(second, motion.person.mass_kg)
    weight = motion.person.mass_kg * GRAVITY_M_S2
    assert np.sqrt(np.mean((motion.force_n[1:-1] - expected) ** 2)) < 2e-3 * weight


@pytest.mark.parametrize("movement", MOVEMENTS)
def test_the_limbs_hang_on_the_centre_of_mass(movement: Movement) -> None:
    motion = motion_of(movement, belt=True)
    mean = sum(LIMBS[name][0] * track for name, track in motion.limb_m.items())
    assert sum(fraction for fraction, _, _ in LIMBS.values()) == pytest.approx(1.0)
    assert mean == pytest.approx(motion.com_m, abs=1e-9)


def test_the_momentum_of_a_walk_is_that_of_its_limbs_as_points_and_a_rest() -> None:
    motion = motion_of("walk", 3)
    points = np.zeros_like(motion.com_m)
    for name, track in motion.limb_m.items():
        arm = track - motion.com_m
        velocity = make_interp_spline(motion.time_s, arm, k=5)(motion.time_s, 1)
        points += LIMBS[name][0] * motion.person.mass_kg * np.cross(arm, velocity)
    rest = motion.momentum_nms - points
    assert rest[:, 1].std() < 0.35 * motion.momentum_nms[:, 1].std()


@pytest.mark.parametrize("movement", MOVEMENTS)
def test_the_rate_integrates_to_the_momentum(movement: Movement) -> None:
    motion = motion_of(movement, 1)
    gained = np.cumsum((motion.momentum_rate_nm[1:] + motion.momentum_rate_nm[:-1]) / 2, axis=0) / RATE_HZ
    change = motion.momentum_nms[1:] - motion.momentum_nms[0]
    assert np.abs(gained - change).max() < 0.02 * max(1.0, np.abs(change).max())


@pytest.mark.parametrize("movement", ["run", "hop"])
def test_nothing_acts_in_flight(movement: Movement) -> None:
    motion = motion_of(movement, 2)
    aloft = motion.force_n[:, 2] == 0.0
    assert 0.1 < aloft.mean() < 0.7
    assert np.abs(motion.force_n[aloft]).max() == 0.0
    assert np.abs(motion.momentum_rate_nm[aloft]).max() == 0.0


@pytest.mark.parametrize("movement", ["walk", "run", "hop"])
def test_the_vertical_force_carries_the_weight(movement: Movement) -> None:
    motion = motion_of(movement, 4)
    share = motion.force_n[:, 2].mean() / motion.person.mass_kg / GRAVITY_M_S2
    assert share == pytest.approx(1.0, abs=0.12)
    assert np.ptp(motion.com_m[:, 2]) < 0.8


def test_no_stride_is_like_the_one_before() -> None:
    motion = motion_of("walk", 5)
    whole = np.arange(np.ceil(motion.stride[0]), motion.stride[-1])
    starts = np.interp(whole, motion.stride, motion.time_s)
    lasting = np.diff(starts)
    assert lasting.std() > 0.005 * lasting.mean()
    n = int(lasting.min() * RATE_HZ)
    first, second = (motion.force_n[round(at * RATE_HZ) : round(at * RATE_HZ) + n, 1] for at in starts[:2])
    assert np.std(first - second) > 0.02 * first.std()


def test_on_a_belt_a_walker_stays_in_place() -> None:
    motion = motion_of("walk", 6, belt=True)
    assert np.ptp(motion.com_m[:, 0]) < 0.3
    assert motion.ground_m_s < -0.4
