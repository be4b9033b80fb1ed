"""Preconditions of the rolling wheel and of the measures of gait: straight, level walking ahead with double support.

Violations raise errors that contain the measured values. The limits lie far from normal walking: in the shared walks
the feet stand within 3 cm of one height, double support is at least 30 ms, and two strides differ by at most 3 degrees
in direction (two steps by 21 at 0.35 m/s, where the body sways most).
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stridelab.errors import Fault, NotEstimable
from stridelab.recordings.foot_contact import Foot, find_feet, ground_of_feet_m_s
from stridelab.recordings.plate_contacts import loaded_intervals, mean_visible
from stridelab.recordings.recording import Recording, Side, Window
from stridelab.walking.gait_events import Contact
from stridelab.walking.marker_kinematics import pelvis_m
from stridelab.walking.steps import MIN_PROGRESS_M, GaitStep

RISE_M: Final = 0.05
"""Largest height difference of two consecutive contacts; level walks stay within 3 cm."""
FLIGHT_S: Final = 0.03
"""Shortest flight, from one foot's lift-off to the other's strike; marker timing is accurate to 25 ms."""
TURN_RAD: Final = np.deg2rad(25.0)
"""Largest angle between the directions of the pelvis in two strides (in two steps without two strides)."""
BOUNCE_M: Final = 0.01
"""Depth of the pelvis in the middle of a stance, below its heights at both ends, from which a gait is a run. A walker's
leg is a pendulum, which is highest there, and a runner's a spring (Cavagna, Thys and Zamboni 1976): medians of -48 to
-5 mm in 70 walks of more than 30 people, 21 to 74 mm in 40 runs of ten."""
FACING_RAD: Final = np.deg2rad(60.0)
"""Largest angle between the walk and the mean direction of the feet while they rest; in forty walks it is at most 9
degrees, that of one foot 28."""
NOT_APPLICABLE: Final = "This is no straight walk on level ground: "


def require_walk(
    recording: Recording,
    landmarks: Mapping[str, str],
    contacts: Sequence[Contact],
    feet: Sequence[Foot] | None = None,
    *,
    level: bool = True,
) -> None:
    """Raise ``NotEstimable`` unless the subject walks straight ahead, on level ground or, without ``level``, on stairs.

    ``contacts`` are those of ``find_contacts``; ``feet`` are both by default. Of one foot a flight is not seen, but the
    pelvis of a run is. Codes: ``feet-not-marked``, ``standing``, ``stairs``, ``running``, ``turning``, ``backwards``,
    ``sideways``; ``faults`` list the measured values.
    """
    if feet is None:
        feet = find_feet(recording, landmarks)
    if not feet:
        raise NotEstimable(
            "feet-not-marked",
            "Steps need a marker at the heel (or ankle) and one at the forefoot of both feet; this recording lacks "
            "them, so it is unknown when a foot swings.",
        )
    _require_walking(recording, landmarks, contacts)
    if level:
        _require_level_ground(recording, feet, contacts)
    _require_no_flight(contacts)
    _require_no_bounce(recording, landmarks, contacts)
    _require_straight_walk(recording, landmarks, feet, contacts)
    _require_walk_ahead(recording, landmarks, feet)


def require_steps(
    recording: Recording, seen: Sequence[GaitStep], wanted: Sequence[GaitStep], windows: Sequence[Window]
) -> None:
    """Raise ``NotEstimable`` if ``wanted`` has no step to fit.

    Codes: ``no-whole-step``, ``one-plate-only``, ``no-measured-step``.
    """
    if wanted:
        return
    if not seen:
        message = (
            f"In {recording.duration_s:.2f} s there is no whole step, which lasts from the lift-off of one foot to the "
            "next lift-off of the other."
        )
        raise NotEstimable("no-whole-step", message)
    steps = ", ".join(f"{step.start_s:.2f} to {step.end_s:.2f} s" for step in seen)
    complete = ", ".join(f"{w.start_s:.2f} to {w.end_s:.2f} s" for w in windows) or "never"
    faults = [Fault("steps", steps), Fault("all contact force is measured", complete)]
    walked_on = [p.index for p in recording.plates if p.use and loaded_intervals(p, recording.force_rate_hz)]
    if len(walked_on) == 1:
        raise NotEstimable(
            "one-plate-only",
            f"Feet stood on plate {walked_on[0]} only. A step ends in double support, for which both feet must be on "
            f"plates: of {len(seen)} whole steps ({steps}) none is measured (all force: {complete}).",
            faults,
        )
    raise NotEstimable(
        "no-measured-step",
        f"There are {len(seen)} whole steps ({steps}), but all contact force is measured only {complete}: no step is "
        "inside. With steps: all they are fitted from the markers.",
        faults,
    )


def _require_walking(recording: Recording, landmarks: Mapping[str, str], contacts: Sequence[Contact]) -> None:
    lifted = sum(contact.lift_off_s is not None for contact in contacts)
    if lifted >= 1:
        return
    pelvis = pelvis_m(recording, landmarks)
    way_m = float(np.linalg.norm(np.nanmax(pelvis[:, :2], axis=0) - np.nanmin(pelvis[:, :2], axis=0)))
    message = f"In {recording.duration_s:.2f} s no foot is lifted and the pelvis moves by {way_m:.3f} m."
    raise NotEstimable("standing", NOT_APPLICABLE + message)


def _require_level_ground(recording: Recording, feet: Sequence[Foot], contacts: Sequence[Contact]) -> None:
    heights_m = contact_heights_m(recording, feet, contacts)
    rises = [abs(b - a) for a, b in itertools.pairwise(heights_m) if np.isfinite(a) and np.isfinite(b)]
    if not rises or max(rises) <= RISE_M:
        return
    listed = ", ".join(f"{h:.2f}" for h in heights_m if np.isfinite(h))
    raise NotEstimable(
        "stairs",
        f"{NOT_APPLICABLE}the ground is not level. The feet stand at heights of {listed} m (lowest marker), up to "
        f"{max(rises):.2f} m apart from one to the next.",
        [Fault("contacts", f"at {listed} m")],
    )


def contact_heights_m(recording: Recording, feet: Sequence[Foot], contacts: Sequence[Contact]) -> list[float]:
    """Height of the lowest marker of the foot in the middle of each contact; NaN where none is visible."""
    by_side = {foot.side: foot for foot in feet}
    return [_height_m(recording, by_side, contact) for contact in contacts]


def _height_m(recording: Recording, feet: Mapping[Side, Foot], contact: Contact) -> float:
    """Height of the lowest marker of the foot in the middle of the contact."""
    start_s, end_s = max(contact.start_s, 0.0), min(contact.end_s, recording.duration_s)
    middle = (recording.time_s >= start_s + 0.2 * (end_s - start_s)) & (
        recording.time_s <= start_s + 0.8 * (end_s - start_s)
    )
    heights = feet[contact.side].markers_m[middle, :, 2]
    return float(np.nanmin(heights)) if np.isfinite(heights).any() else float("nan")


def _require_no_flight(contacts: Sequence[Contact]) -> None:
    """Raise ``running`` if most steps have a flight: one foot lifts off clearly before the other lands."""
    flights, steps = [], 0
    for left in contacts:
        if left.lift_off_s is None:
            continue
        down = [c for c in contacts if c.side != left.side and c.end_s > left.lift_off_s and c.strike_s is not None]
        if any(c.start_s <= left.lift_off_s + FLIGHT_S for c in contacts if c.side != left.side and c in down):
            steps += 1
        elif down:
            landing_s = min(c.start_s for c in down)
            flights.append(landing_s - left.lift_off_s)
    if len(flights) <= steps:
        return
    raise NotEstimable(
        "running",
        f"{NOT_APPLICABLE}it is running. {len(flights)} of {len(flights) + steps} steps have a flight, of "
        f"{1e3 * float(np.median(flights)):.0f} ms (median), in place of a double support.",
        [Fault("flights", ", ".join(f"{1e3 * f:.0f} ms" for f in flights))],
    )


def _require_no_bounce(recording: Recording, landmarks: Mapping[str, str], contacts: Sequence[Contact]) -> None:
    """Raise ``running`` if the pelvis is lowest in the middle of the stances: markers miss short flights."""
    height_m = pelvis_m(recording, landmarks)[:, 2]
    falls_m = []
    for contact in contacts:
        if contact.strike_s is None or contact.lift_off_s is None:
            continue
        at_s = [contact.strike_s, 0.5 * (contact.strike_s + contact.lift_off_s), contact.lift_off_s]
        first, middle, last = np.interp(at_s, recording.time_s, height_m)
        if np.isfinite(first + middle + last):
            falls_m.append(0.5 * (first + last) - middle)
    if not falls_m or float(np.median(falls_m)) < BOUNCE_M:
        return
    listed = ", ".join(f"{1e3 * fall:.0f} mm" for fall in falls_m)
    raise NotEstimable(
        "running",
        f"{NOT_APPLICABLE}it is running. In the middle of the stance the pelvis is {1e3 * np.median(falls_m):.0f} mm "
        "lower than at its ends (median); in walking it is higher there.",
        [Fault("depths of the pelvis", listed)],
    )


def _require_straight_walk(
    recording: Recording, landmarks: Mapping[str, str], feet: Sequence[Foot], contacts: Sequence[Contact]
) -> None:
    time_s = recording.time_s
    over_floor = pelvis_m(recording, landmarks) - ground_of_feet_m_s(feet) * time_s[:, None]
    strikes = [contact.strike_s for contact in contacts if contact.strike_s is not None]
    at = np.array([[np.interp(t, time_s, over_floor[:, axis]) for axis in (0, 1)] for t in strikes])
    stride = 2 if len(at) >= 4 else 1
    displacement = at[stride:] - at[:-stride] if len(at) > stride else np.zeros((0, 2))
    displacement = displacement[np.isfinite(displacement).all(axis=1)]
    if len(displacement) < 2:
        return
    direction = np.unwrap(np.arctan2(displacement[:, 1], displacement[:, 0]))
    turn = float(np.ptp(direction))
    if turn <= TURN_RAD:
        return
    listed = ", ".join(f"{d:.0f}" for d in np.rad2deg(direction - direction[0]))
    raise NotEstimable(
        "turning",
        f"{NOT_APPLICABLE}the walk is not straight. From {'stride to stride' if stride == 2 else 'step to step'} the "
        f"pelvis goes towards {listed} degrees from the first, {np.rad2deg(turn):.0f} degrees in all.",
        [Fault("directions", f"{listed} degrees")],
    )


def _require_walk_ahead(recording: Recording, landmarks: Mapping[str, str], feet: Sequence[Foot]) -> None:
    """Raise ``backwards`` or ``sideways`` unless the feet point where the body goes.

    Otherwise the left foot is not on the left of the walk, and heels do not land first.
    """
    over_floor = pelvis_m(recording, landmarks) - ground_of_feet_m_s(feet) * recording.time_s[:, None]
    seen = over_floor[np.isfinite(over_floor).all(axis=1), :2]
    way = seen[-1] - seen[0] if len(seen) else np.zeros(2)
    if float(np.linalg.norm(way)) < MIN_PROGRESS_M:
        return
    facing = np.zeros(2)
    for foot in feet:
        along = (mean_visible(np.asarray(foot.markers_m[:, 1:])) - foot.markers_m[:, 0])[foot.resting.all(axis=1), :2]
        along = along[np.isfinite(along).all(axis=1)]
        if len(along):
            mean = along.mean(axis=0)
            facing += mean / np.linalg.norm(mean)
    angle = abs(float(np.arctan2(way[0] * facing[1] - way[1] * facing[0], way @ facing)))
    if angle <= FACING_RAD:
        return
    is_backwards = angle > np.pi - FACING_RAD
    raise NotEstimable(
        "backwards" if is_backwards else "sideways",
        f"{NOT_APPLICABLE}the person walks {'backwards' if is_backwards else 'sideways'}. The feet point "
        f"{np.rad2deg(angle):.0f} degrees away from the direction of the walk.",
        [Fault("direction of the feet", f"{np.rad2deg(angle):.0f} degrees from the walk")],
    )
