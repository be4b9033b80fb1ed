"""The mass by impulse holds for any movement, within the standard deviation that it states."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2, Series
from stridelab.recordings.body_mass import MassEstimate, best_mass, combined_mass, vertical_motion, weigh
from stridelab.recordings.force_windows import find_windows
from stridelab.recordings.recording import Window
from support.recordings.walks import (
    LANDED_S,
    LANDMARKS,
    MASS_KG,
    MovingBody,
    drop_jump,
    moving_body,
    sit_to_stand,
    stand,
)


def estimates(body: MovingBody, *windows: Window) -> dict[str, MassEstimate]:
    motion = vertical_motion(body.recording, LANDMARKS, body.com_m)
    windows_used = windows or find_windows(body.recording, LANDMARKS, motion).windows
    return {estimate.kind: estimate for estimate in weigh(body.recording, windows_used, motion)}


def test_a_drop_jump_weighs_the_jumper() -> None:
    """The mean force is 1.2 times the weight: the momentum of the fall is braked in the window."""
    body = drop_jump()
    (window,) = find_windows(body.recording, LANDMARKS, vertical_motion(body.recording, LANDMARKS, body.com_m)).windows
    window = Window(LANDED_S - 0.05, min(window.end_s, LANDED_S + 1.2))
    rate_hz = body.recording.force_rate_hz
    up_n = body.recording.plates[0].force_n[round(window.start_s * rate_hz) : round(window.end_s * rate_hz), 2]
    assert up_n.mean() > 1.15 * MASS_KG * GRAVITY_M_S2
    estimate = estimates(body, window)["impulse"]
    assert abs(estimate.mass_kg - MASS_KG) < 0.03 * MASS_KG
    assert abs(estimate.mass_kg - MASS_KG) < 3.0 * estimate.sd_kg
    assert 0.01 * MASS_KG < estimate.sd_kg < 0.05 * MASS_KG


def test_a_standing_person_is_weighed_as_on_a_scale() -> None:
    masses = estimates(stand())
    assert masses["standing"].mass_kg == pytest.approx(MASS_KG, abs=0.05)
    assert masses["standing"].total_sd_kg == pytest.approx(np.hypot(masses["standing"].sd_kg, 0.01 * MASS_KG))


def test_a_plate_that_is_never_unloaded_may_have_a_wrong_zero() -> None:
    """A zero error of 28 N is invisible while a person stands; samples of the empty plate would show it."""
    standing = stand()
    plate = standing.recording.plates[0]
    assert plate.loaded.all()
    off = replace(
        standing, recording=replace(standing.recording, plates=(replace(plate, force_n=plate.force_n - [0, 0, 28.0]),))
    )
    mass = estimates(off)["standing"]
    assert 2.0 < abs(mass.mass_kg - MASS_KG) < 3.0 * mass.sd_kg
    known = replace(standing, recording=replace(standing.recording, plates=(replace(plate, zero_is_known=True),)))
    assert estimates(known)["standing"].sd_kg < 0.3 * mass.sd_kg, "another trial of the session shows the zero"
    empty = plate.force_n.copy()
    empty[:100] = 0.0
    with_offset = replace(standing, recording=replace(standing.recording, plates=(replace(plate, force_n=empty),)))
    mass = estimates(with_offset, Window(0.5, 2.9))["standing"]
    assert mass.mass_kg == pytest.approx(MASS_KG, abs=0.05)
    assert mass.sd_kg < 0.2


def test_a_quiet_part_of_a_trial_is_a_scale() -> None:
    """From 2.8 s on the person stands; the chair does not count, because it is in no window."""
    masses = estimates(sit_to_stand())
    assert masses["standing"].mass_kg == pytest.approx(MASS_KG, rel=0.002)
    assert masses["impulse"].mass_kg == pytest.approx(MASS_KG, rel=0.02)
    best = best_mass(tuple(masses.values()))
    assert best is not None
    assert best.kind == "standing"


@pytest.mark.parametrize("start_s", [0.1, 0.2, 0.3, 0.4])
def test_the_interval_needs_not_be_a_whole_step(start_s: float) -> None:
    body = moving_body(lambda t: 0.95 + 0.025 * np.sin(4.0 * np.pi * t), np.zeros_like, duration_s=2.0)
    estimate = estimates(body, Window(start_s, start_s + 0.7))["impulse"]
    assert estimate.mass_kg == pytest.approx(MASS_KG, rel=0.005)


def test_the_standard_deviation_covers_a_velocity_that_is_wrong_by_a_tenth() -> None:
    body = moving_body(lambda t: 0.95 + 0.025 * np.sin(4.0 * np.pi * t), np.zeros_like, duration_s=2.0)
    stretched = replace(body, com_m=body.com_m * [1.0, 1.0, 1.1])
    for start_s in np.arange(0.05, 0.6, 0.05):
        estimate = estimates(stretched, Window(float(start_s), float(start_s) + 0.7))["impulse"]
        assert abs(estimate.mass_kg - MASS_KG) < 2.0 * estimate.sd_kg


@pytest.mark.parametrize("stretch", [0.9, 1.1])
def test_a_flight_in_the_window_does_not_make_a_wrong_velocity_more_certain(stretch: float) -> None:
    """A window of half a second from the push-off to the landing of a jump, most of it in flight."""
    pushed_s, left_s, speed_m_s = 0.3, 0.6, 1.9
    landed_s = left_s + 2.0 * speed_m_s / GRAVITY_M_S2

    def height_m(t: Series) -> Series:
        pushed = 0.5 * speed_m_s / (left_s - pushed_s) * np.clip(t - pushed_s, 0.0, left_s - pushed_s) ** 2
        flown_s = np.clip(t - left_s, 0.0, landed_s - left_s)
        braked_s = np.clip(t - landed_s, 0.0, 0.4)
        return np.asarray(
            0.9
            + pushed
            + speed_m_s * flown_s
            - 0.5 * GRAVITY_M_S2 * flown_s**2
            - speed_m_s * braked_s * (1.0 - braked_s / 0.8)
        )

    body = moving_body(height_m, np.zeros_like, duration_s=2.0)
    assert estimates(body, Window(0.5, landed_s + 0.02))["impulse"].mass_kg == pytest.approx(MASS_KG, rel=0.05)
    stretched = replace(body, com_m=body.com_m * [1.0, 1.0, stretch])
    for start_s in (0.46, 0.48, 0.5):
        estimate = estimates(stretched, Window(start_s, landed_s + 0.02))["impulse"]
        assert abs(estimate.mass_kg - MASS_KG) < 2.0 * estimate.sd_kg


def test_two_trials_are_combined_by_their_errors() -> None:
    walk = MassEstimate(60.6, 0.3, "impulse", 0.9)
    scale = MassEstimate(60.0, 0.1, "standing", 2.0)
    both = combined_mass([walk, scale])
    assert both is not None
    assert both.mass_kg == pytest.approx((60.6 / 0.09 + 60.0 / 0.01) / (1 / 0.09 + 1 / 0.01))
    chi2 = (60.6 - both.mass_kg) ** 2 / 0.09 + (60.0 - both.mass_kg) ** 2 / 0.01
    assert both.sd_kg == pytest.approx(np.sqrt(chi2) / np.sqrt(1 / 0.09 + 1 / 0.01))
    assert combined_mass([]) is None


def test_without_plate_or_window_there_is_no_mass() -> None:
    body = stand()
    assert weigh(body.recording, ()) == ()
    assert weigh(replace(body.recording, plates=()), (Window(0.0, 2.0),)) == ()
