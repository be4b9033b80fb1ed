"""Foot strikes and lift-offs: from the plates where a contact is on them, otherwise from the markers.

``recordings.foot_contact`` is conservative: it detects when a foot *may* touch the ground. Here the instants are
estimated without bias. With v the speed of the pelvis, a foot lifts off when its forefoot moves at 0.9 v over the
floor, and lands near the instant at which its heel (or its forefoot, if earlier) becomes slower than 0.45 v. A foot
that still sinks after that instant lands later. With u the vertical velocities of heel and forefoot around it, over v,

    strike = instant + 0.0044 s - (w . u - c), the last at most 25 ms,

where w, c and the constant are a regression on the strikes of 20 sources with plates, in which only differences within
a recording inform w (``scripts/make_strike_timing.py``). At 0.35 m/s one lift-off was 93 ms late.

Most of the error is the same in all events of a recording and of its session: it follows from the placement of the
markers, the shoes and the filter of the plates. Where whole stances of a recording or of its session are timed by
plates, the difference there shifts the events by markers (``walking.event_calibration``). A strike whose forefoot
becomes slower than 0.45 v less than 20 ms after the heel, or before it, is one of a flat foot.

The events of plates and their errors are those of ``walking.plate_events``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Series
from stridelab.recordings.foot_contact import Foot, find_feet
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.plate_contacts import markers_on_plate, mean_visible
from stridelab.recordings.recording import Plate, Recording, Side
from stridelab.walking.event_calibration import (
    FLAT_STRIKE_ERROR,
    MARKER_ERROR,
    EventDifferences,
    EventError,
    EventKind,
    PlateDifference,
    common_difference,
)
from stridelab.walking.marker_kinematics import level_speed_m_s, smooth_velocity_m_s, walking_speed_m_s
from stridelab.walking.plate_events import plate_events

LIFT_OFF_SPEED_SHARE, STRIKE_SPEED_SHARE = 0.9, 0.45
"""Speeds of the forefoot at lift-off and of the heel at the strike, per walking speed."""
STRIKE_DELAY_S: Final = 0.0044
"""Time from that speed of the heel to the strike on plates: median of the medians of the sources."""
SINKING_LAGS_S: Final = np.arange(-4, 4) * 0.02
"""Times after that instant at which the vertical velocities are taken."""
SINKING_WEIGHTS_S: Final = 1e-3 * np.array(
    [
        [-3.90, -3.38, 0.88, -2.06, 10.21, 24.32, 30.78, 4.46],
        [-0.50, -1.53, -2.02, -3.09, -7.47, 5.99, 13.12, 12.64],
    ]
)
"""Weights of the vertical velocities of heel and forefoot, over the walking speed."""
SINKING_MEAN_S, MAX_SINKING_S = -0.0103, 0.025
"""Weighted sum in a median landing, and the largest difference from it that is believed."""
SWING_SPEED_SHARE: Final = 0.9
"""Minimum speed of a swinging foot, per walking speed. The peak is 3.5, in the first step from rest 1.5."""
MIN_SWING_S: Final = 0.15
"""Shortest swing; shorter ones are jumps of a marker."""
SHORTEST_STANCE_S: Final = 0.3
"""Markers that are hidden for less between two parts of a swing hide no stance."""
MAX_SOURCE_DIFFERENCE_S: Final = 0.1
"""Largest difference of one event between plates and markers; beyond it the foot stood beside the plate."""
MIN_LOADED_SHARE: Final = 0.5
"""Minimum share of a plate's loaded time in which a foot must be on it to be the foot that loads it."""

FLAT_LEAD_S: Final = 0.02
"""Time from the heel to the forefoot becoming slow below which a foot lands flat; in heel strikes it is 40 to 80 ms."""

EventSource = Literal["plates", "markers"]


@dataclass(frozen=True)
class Contact:
    """Contact of one foot, in seconds of the markers' clock; None for an event that is not seen.

    An event that hidden markers hide lies after ``begins_after_s`` and before ``ends_before_s``, when the foot is seen
    to swing.
    """

    side: Side
    strike_s: float | None
    lift_off_s: float | None
    strike_source: EventSource = "markers"
    lift_off_source: EventSource = "markers"
    strike_error: EventError = MARKER_ERROR["strike"]
    lift_off_error: EventError = MARKER_ERROR["lift_off"]
    lands_flat: bool = False
    begins_after_s: float = -np.inf
    ends_before_s: float = np.inf

    @property
    def start_s(self) -> float:
        """Strike for comparisons: its bound if it is unknown, minus infinity before the recording."""
        return self.begins_after_s if self.strike_s is None else self.strike_s

    @property
    def end_s(self) -> float:
        """Lift-off for comparisons: its bound if it is unknown, infinity after the recording."""
        return self.ends_before_s if self.lift_off_s is None else self.lift_off_s


def find_contacts(
    recording: Recording,
    landmarks: Mapping[str, str],
    *,
    latency_s: float = 0.0,
    plates: bool = True,
    feet: Sequence[Foot] | None = None,
    session: Sequence[EventDifferences] = (),
) -> tuple[Contact, ...]:
    """All contacts of both feet in order of time; empty if the feet are not marked.

    ``latency_s`` > 0 is the delay of the force; plate events are converted to the markers' clock. ``plates`` False uses
    the markers only: for validation, and if ``feet`` is the only marked one, since the other may load a plate as well.
    ``session`` are the ``plate_differences`` of the other recordings of the session, which shift the events by markers.
    """
    if feet is None:
        feet = find_feet(recording, landmarks)
    if not feet:
        return ()
    by_markers, timed = _timed_contacts(recording, landmarks, feet, latency_s if plates else None)
    _shift_to_plates(timed, _stance_differences(timed, by_markers), session)
    both = [contact for contacts in timed.values() for contact in contacts]
    return tuple(sorted(both, key=lambda contact: (contact.start_s, contact.end_s)))


def plate_differences(
    recording: Recording, landmarks: Mapping[str, str], *, latency_s: float = 0.0, feet: Sequence[Foot] | None = None
) -> EventDifferences:
    """Differences of marker events from plate events in the whole stances on plates; arguments of ``find_contacts``."""
    if feet is None:
        feet = find_feet(recording, landmarks)
    by_markers, timed = _timed_contacts(recording, landmarks, feet, latency_s)
    return _stance_differences(timed, by_markers)


def _timed_contacts(
    recording: Recording, landmarks: Mapping[str, str], feet: Sequence[Foot], latency_s: float | None
) -> tuple[dict[Side, list[Contact]], dict[Side, list[Contact]]]:
    """Contacts by markers, and the same with the events of the plates, which have no part if ``latency_s`` is None."""
    by_markers = {foot.side: contacts_of_foot(recording, landmarks, foot) for foot in feet}
    timed = {side: list(contacts) for side, contacts in by_markers.items()}
    if latency_s is not None:
        for plate in recording.plates:
            if plate.use:
                _apply_plate_events(timed, recording, plate, feet, latency_s)
    return by_markers, timed


def contacts_of_foot(recording: Recording, landmarks: Mapping[str, str], foot: Foot) -> list[Contact]:
    """Contacts of one foot between its swings, from its markers alone."""
    rate_hz, time_s = recording.marker_rate_hz, recording.time_s
    floor = foot.ground_m_s
    v_heel = smooth_velocity_m_s(np.asarray(foot.markers_m[:, 0]), rate_hz) - floor
    v_fore = smooth_velocity_m_s(mean_visible(np.asarray(foot.markers_m[:, 1:])), rate_hz) - floor
    v = walking_speed_m_s(recording, landmarks, floor)
    fore = np.linalg.norm(v_fore, axis=1)
    heel = np.linalg.norm(v_heel, axis=1)
    slower = np.fmin(heel, fore)
    swinging = np.nan_to_num(level_speed_m_s(0.5 * (v_heel + v_fore)))
    contacts: list[Contact] = []
    strike_s: float | None = None
    flat = False
    swung_s, down_again = -np.inf, -1
    for i, j in true_runs(swinging > SWING_SPEED_SHARE * v):
        if i < down_again:
            continue
        fastest = i + int(np.argmax(swinging[i:j]))
        lift_off_s = _crossing_s(time_s, fore, fastest, -1, LIFT_OFF_SPEED_SHARE * v)
        landing_s = _crossing_s(time_s, slower, fastest, 1, STRIKE_SPEED_SHARE * v)
        if lift_off_s is not None and landing_s is not None and landing_s - lift_off_s < MIN_SWING_S:
            continue
        is_same_swing = strike_s is None and lift_off_s is None and time_s[i] - swung_s < SHORTEST_STANCE_S
        if not (contacts and is_same_swing):
            before = _marker_contact(foot.side, strike_s, lift_off_s, flat)
            contacts.append(replace(before, begins_after_s=swung_s, ends_before_s=float(time_s[fastest])))
        strike_s, flat = None, False
        if landing_s is not None:
            heel_s, fore_s = (_crossing_s(time_s, one, fastest, 1, STRIKE_SPEED_SHARE * v) for one in (heel, fore))
            flat = heel_s is not None and fore_s is not None and fore_s - heel_s < FLAT_LEAD_S
            up = landing_velocities(time_s, v_heel, v_fore, landing_s) / v
            strike_s = landing_s + STRIKE_DELAY_S - _sinking_s(up)
        swung_s = float(time_s[j - 1])
        down_again = j if landing_s is None else int(np.searchsorted(time_s, landing_s))
    contacts.append(replace(_marker_contact(foot.side, strike_s, None, flat), begins_after_s=swung_s))
    if len(contacts) == 1:
        return contacts
    # The first and the last are no contacts if the recording begins and ends in a swing.
    first, last = (int(one.strike_s is None and one.lift_off_s is None) for one in (contacts[0], contacts[-1]))
    return contacts[first : len(contacts) - last]


def _marker_contact(side: Side, strike_s: float | None, lift_off_s: float | None, flat: bool) -> Contact:
    error = FLAT_STRIKE_ERROR if flat else MARKER_ERROR["strike"]
    return Contact(side, strike_s, lift_off_s, strike_error=error, lands_flat=flat)


def landing_velocities(time_s: Series, v_heel: Points, v_fore: Points, landing_s: float) -> Float[np.ndarray, "2 lags"]:
    """Vertical velocities of heel and forefoot at ``SINKING_LAGS_S`` after ``landing_s``; NaN outside the recording."""
    at_s = landing_s + SINKING_LAGS_S
    return np.array([np.interp(at_s, time_s, v[:, 2], left=np.nan, right=np.nan) for v in (v_heel, v_fore)])


def _sinking_s(up: Float[np.ndarray, "2 lags"]) -> float:
    """Time by which a landing with the relative vertical velocities ``up`` is early; 0 if one is not known."""
    early_s = float(np.sum(SINKING_WEIGHTS_S * up)) - SINKING_MEAN_S
    return float(np.clip(early_s, -MAX_SINKING_S, MAX_SINKING_S)) if np.isfinite(early_s) else 0.0


def _crossing_s(time_s: Series, speed: Series, start: int, way: Literal[-1, 1], level: float) -> float | None:
    """Time at which ``speed`` falls to ``level``, from ``start`` on forwards or backwards; None at a gap or the end."""
    k = start
    while 0 <= k < len(speed) and speed[k] > level:
        k += way
    if not 0 <= k < len(speed) or np.isnan(speed[k]):
        return None
    if k == start:
        return float(time_s[k])
    share = (level - speed[k]) / (speed[k - way] - speed[k])
    return float(time_s[k] + share * (time_s[k - way] - time_s[k]))


def _apply_plate_events(
    contacts: Mapping[Side, list[Contact]], recording: Recording, plate: Plate, feet: Sequence[Foot], latency_s: float
) -> None:
    """Replace the marker events in ``contacts`` by the matching events of one plate."""
    time_s = recording.time_s
    for begins, ends in plate_events(plate, recording.force_rate_hz):
        first_s = (0.0 if begins is None else begins.at_s) - latency_s
        last_s = (recording.duration_s if ends is None else ends.at_s) - latency_s
        loaded = (time_s >= first_s) & (time_s <= last_s)
        if not loaded.any():
            continue
        standing = [
            f
            for f in feet
            if np.mean((markers_on_plate(recording, plate, f) & f.resting)[loaded].any(axis=1)) > MIN_LOADED_SHARE
        ]
        if begins is not None:
            _set_nearest(contacts, standing, "strike", first_s, (first_s, last_s), EventError(0.0, begins.sd_s))
        if ends is not None:
            _set_nearest(contacts, standing, "lift_off", last_s, (first_s, last_s), EventError(0.0, ends.sd_s))


def _set_nearest(
    contacts: Mapping[Side, list[Contact]],
    standing: Sequence[Foot],
    event: Literal["strike", "lift_off"],
    at_s: float,
    load_s: tuple[float, float],
    error: EventError,
) -> None:
    """Set ``event`` to ``at_s`` with ``error`` in the contact on the plate whose marker event is nearest.

    A contact without this marker event is used if no other matches.
    """
    best: tuple[float, list[Contact], int] | None = None
    for foot in standing:
        own = contacts[foot.side]
        for k, contact in enumerate(own):
            seen_s = contact.strike_s if event == "strike" else contact.lift_off_s
            overlaps = (
                contact.start_s < load_s[1] - MAX_SOURCE_DIFFERENCE_S
                and contact.end_s > load_s[0] + MAX_SOURCE_DIFFERENCE_S
            )
            away = MAX_SOURCE_DIFFERENCE_S if seen_s is None else abs(seen_s - at_s)
            if overlaps and away <= MAX_SOURCE_DIFFERENCE_S and (best is None or away < best[0]):
                best = away, own, k
    if best is None:
        return
    _, own, k = best
    if event == "strike":
        own[k] = replace(own[k], strike_s=at_s, strike_source="plates", strike_error=error)
    else:
        own[k] = replace(own[k], lift_off_s=at_s, lift_off_source="plates", lift_off_error=error)


def _stance_differences(
    timed: Mapping[Side, list[Contact]], by_markers: Mapping[Side, list[Contact]]
) -> dict[EventKind, list[PlateDifference]]:
    """Differences of the events by markers from those of ``timed``, in the whole stances that plates time."""
    differences: dict[EventKind, list[PlateDifference]] = {"strike": [], "lift_off": []}
    for side, contacts in timed.items():
        for c, m in zip(contacts, by_markers[side], strict=True):
            if not c.strike_source == c.lift_off_source == "plates":
                continue
            if c.strike_s is not None and m.strike_s is not None:
                late = PlateDifference(m.strike_s - c.strike_s, m.strike_error.own_s, m.lands_flat)
                differences["strike"].append(late)
            if c.lift_off_s is not None and m.lift_off_s is not None:
                differences["lift_off"].append(PlateDifference(m.lift_off_s - c.lift_off_s, m.lift_off_error.own_s))
    return differences


def _shift_to_plates(
    contacts: Mapping[Side, list[Contact]], own: EventDifferences, session: Sequence[EventDifferences]
) -> None:
    """Shift the events by markers by the common difference of their recording and session to the plates.

    The strikes of flat feet follow the recording alone.
    """
    for kind in MARKER_ERROR:
        others = [[one for one in other[kind] if not one.lands_flat] for other in session]
        of_recording, of_session = common_difference(kind, own[kind]), common_difference(kind, own[kind], others)
        for one_side in contacts.values():
            one_side[:] = [
                _shift_contact(contact, kind, of_recording if kind == "strike" and contact.lands_flat else of_session)
                for contact in one_side
            ]


def _shift_contact(contact: Contact, kind: EventKind, late: tuple[float, float] | None) -> Contact:
    """The contact with its event ``kind``, if it is by markers, earlier by the first of ``late``; see there."""
    if late is None:
        return contact
    shift_s, remaining_s = late
    if kind == "strike" and contact.strike_source == "markers" and contact.strike_s is not None:
        error = EventError(remaining_s, contact.strike_error.own_s)
        return replace(contact, strike_s=contact.strike_s - shift_s, strike_error=error)
    if kind == "lift_off" and contact.lift_off_source == "markers" and contact.lift_off_s is not None:
        error = EventError(remaining_s, contact.lift_off_error.own_s)
        return replace(contact, lift_off_s=contact.lift_off_s - shift_s, lift_off_error=error)
    return contact
