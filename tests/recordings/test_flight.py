"""Windows run through flight, and only through flight: bodies whose motion and force are known by formulas."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2, Points, Series
from stridelab.recordings.body_mass import VerticalMotion, best_mass, vertical_motion, weigh
from stridelab.recordings.foot_contact import find_feet
from stridelab.recordings.force_windows import find_windows, flight_frames
from stridelab.recordings.recording import Plate, Recording, Subject
from support.recordings.walks import (
    FOOT,
    FORCE_RATE_HZ,
    LANDMARKS,
    MASS_KG,
    RATE_HZ,
    MovingBody,
    corners,
    moving_body,
    smooth_step,
)

STANDING_M = 0.95


def bounce_m(time_s: Series, contact_s: float, flight_s: float) -> Series:
    """Height over the standing one: parabolas of free fall, half sines on the ground; the first contact starts at 0."""
    t = np.mod(time_s, contact_s + flight_s)
    speed = GRAVITY_M_S2 * flight_s / 2.0
    up = t - contact_s
    on_ground = -speed * contact_s / np.pi * np.sin(np.pi * t / contact_s)
    return np.asarray(np.where(up < 0.0, on_ground, speed * up - 0.5 * GRAVITY_M_S2 * up**2))


def lift_feet(body: MovingBody, lift_m: Series) -> MovingBody:
    up = np.outer(lift_m, [0.0, 0.0, 1.0])
    markers = {label: track if label == "pelvis" else track + up for label, track in body.recording.markers_m.items()}
    return replace(body, recording=replace(body.recording, markers_m=markers))


def hop(contact_s: float = 0.3, flight_s: float = 0.4, n: int = 4) -> MovingBody:
    """Hops in place on one plate; the feet rise 20 cm and are slow at the top."""
    duration_s = n * (contact_s + flight_s) + contact_s
    body = moving_body(lambda t: STANDING_M + bounce_m(t, contact_s, flight_s), np.zeros_like, duration_s)
    return lift_feet(body, np.maximum(bounce_m(body.recording.time_s, contact_s, flight_s), 0.0))


def held(fall_g: float) -> MovingBody:
    """Stands; from 1.0 to 1.6 s the feet are 20 cm up, while something beside the plate carries the body.

    The body sinks with ``fall_g`` times the acceleration of free fall.
    """

    def sinks(t: Series) -> Series:
        return np.asarray(STANDING_M + 0.4 - 0.5 * fall_g * GRAVITY_M_S2 * np.clip(t - 1.05, 0.0, 0.5) ** 2)

    body = moving_body(sinks, np.zeros_like, 3.0)
    time_s = body.recording.time_s
    lift = 0.2 * smooth_step(time_s, 1.0, 1.1) * (1.0 - smooth_step(time_s, 1.5, 1.6))
    (plate,) = body.recording.plates
    force_s = np.arange(len(plate.force_n)) / FORCE_RATE_HZ
    force_n = plate.force_n.copy()
    force_n[:, 2] = MASS_KG * GRAVITY_M_S2
    force_n[(force_s > 1.02) & (force_s < 1.58)] = 0.0
    body = replace(body, recording=replace(body.recording, plates=(replace(plate, force_n=force_n),)))
    return lift_feet(body, lift)


def motion_of(body: MovingBody) -> VerticalMotion:
    motion = vertical_motion(body.recording, LANDMARKS, body.com_m)
    assert motion is not None
    return motion


def sprint(contact_s: float, flight_s: float) -> MovingBody:
    """Runs at 7 m/s over one plate under the third contact; the others are on the floor before and behind it."""
    period_s, speed_m_s, n_steps = contact_s + flight_s, 7.0, 6
    duration_s = n_steps * period_s

    def height_m(t: Series) -> Series:
        return STANDING_M + bounce_m(t, contact_s, flight_s)

    force_s = np.arange(round(duration_s * FORCE_RATE_HZ)) / FORCE_RATE_HZ
    time_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    lift = np.gradient(np.gradient(height_m(force_s))) * FORCE_RATE_HZ**2
    on_plate = (force_s >= 2 * period_s) & (force_s < 2 * period_s + contact_s)
    force_n = np.zeros((len(force_s), 3))
    force_n[on_plate, 2] = np.maximum(MASS_KG * (GRAVITY_M_S2 + lift[on_plate]), 0.0)
    markers: dict[str, Points] = {}
    for side, first in (("l", 0), ("r", 1)):
        heel = _stepping(time_s, first, contact_s, period_s, speed_m_s)
        for name, offset in FOOT.items():
            markers[f"{side}_{name}"] = heel + offset
    com = np.column_stack([speed_m_s * time_s, 0.0 * time_s, height_m(time_s)])
    markers |= {f"pelvis_{k}": com + np.array([0.0, 0.1 * k - 0.2, 0.02 * k]) for k in range(9)}
    x = speed_m_s * 2 * period_s
    plate = Plate(1, 2, corners((x + 0.09, 0.0, 0.0)), force_n, np.cross([x + 0.09, 0.0, 0.0], force_n), np.zeros(3))
    ahead = np.array([1.0, 0.0, 0.0])
    recording = Recording(markers, RATE_HZ, FORCE_RATE_HZ, (plate,), Subject(), (), "+z", ahead)
    return MovingBody(recording, com, np.zeros_like(time_s))


def _stepping(time_s: Series, first: int, contact_s: float, period_s: float, speed_m_s: float) -> Points:
    """Heel of one foot: still in every second contact from ``first`` on, 30 cm up in between."""
    swing_s = 2 * period_s - contact_s
    share = np.clip((np.mod(time_s - first * period_s, 2 * period_s) - contact_s) / swing_s, 0.0, 1.0)
    n = np.floor((time_s - first * period_s) / (2 * period_s))
    stride_m = speed_m_s * 2 * period_s
    x = speed_m_s * first * period_s + stride_m * (n + share)
    return np.column_stack([x, 0.0 * x, 0.3 * np.sin(np.pi * share)])


def test_the_window_of_a_hopper_runs_through_all_flights() -> None:
    """At the top of a hop the feet are slow, 20 cm above the plate, as if they stood on something beside it."""
    body = hop()
    search = find_windows(body.recording, LANDMARKS, motion_of(body))
    (window,) = search.windows
    assert window.start_s == pytest.approx(0.0, abs=0.05)
    assert window.end_s == pytest.approx(body.recording.time_s[-1], abs=0.05)
    mass = best_mass(weigh(body.recording, search.windows, motion_of(body)))
    assert mass is not None
    assert mass.mass_kg == pytest.approx(MASS_KG, rel=0.01)


def test_flight_is_detected_from_lift_off_to_landing() -> None:
    body = hop()
    time_s = np.mod(body.recording.time_s, 0.7)
    flight = flight_frames(body.recording, find_feet(body.recording, LANDMARKS), motion_of(body))
    assert flight[(time_s > 0.33) & (time_s < 0.67)].all()
    assert not flight[time_s < 0.29].any()


def test_a_loaded_plate_is_not_flight() -> None:
    """A plate that carries the body while the markers fall: the two contradict each other, so nothing is known."""
    body = hop()
    plates = tuple(
        replace(plate, force_n=plate.force_n + np.array([0.0, 0.0, 300.0])) for plate in body.recording.plates
    )
    recording = replace(body.recording, plates=plates)
    assert not flight_frames(recording, find_feet(recording, LANDMARKS), motion_of(body)).any()


@pytest.mark.parametrize("fall_g", [0.0, 0.3, 0.6])
def test_a_body_that_something_beside_the_plate_carries_is_not_in_flight(fall_g: float) -> None:
    """A chair, a rail, a stick that is let down: the plates read zero, both feet are up, nothing falls freely."""
    body = held(fall_g)
    assert not flight_frames(body.recording, find_feet(body.recording, LANDMARKS), motion_of(body)).any()
    for window in find_windows(body.recording, LANDMARKS, motion_of(body)).windows:
        assert window.end_s < 1.15 or window.start_s > 1.45


def test_the_same_body_in_free_fall_is_in_flight() -> None:
    body = held(1.0)
    flight = flight_frames(body.recording, find_feet(body.recording, LANDMARKS), motion_of(body))
    assert flight[(body.recording.time_s > 1.1) & (body.recording.time_s < 1.5)].all()


def test_without_the_height_of_the_body_no_flight_is_assumed() -> None:
    body = hop()
    assert not flight_frames(body.recording, find_feet(body.recording, LANDMARKS), None).any()


def test_a_short_contact_counts_with_flight_on_both_sides() -> None:
    """A sprint over one plate: in flight for more than half of the time between the neighbouring contacts."""
    body = sprint(contact_s=0.13, flight_s=0.17)
    (window,) = find_windows(body.recording, LANDMARKS, motion_of(body)).windows
    assert 0.43 - 0.011 <= window.start_s <= 0.5, "between the lift-off of the foot before the plate and the landing"
    assert 0.8 <= window.end_s <= 0.9 + 0.011, "between the lift-off and the landing of the foot behind the plate"


def test_a_shorter_touch_does_not_count() -> None:
    body = sprint(contact_s=0.09, flight_s=0.17)
    assert find_windows(body.recording, LANDMARKS, motion_of(body)).windows == ()
