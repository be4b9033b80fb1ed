"""When each foot is on the ground: from the plates where they see it, from the markers where they miss it.

``recordings.foot_contact`` answers a cautious question (may this foot touch the ground?) and errs to the side of
contact. Here the instants themselves are wanted, without bias. With v the speed of the pelvis, a foot has left the
ground when its forefoot moves at 0.9 v over the floor, and has landed when its heel (or its forefoot, whichever is
first) is slower than 0.45 v. Both limits are where the plates see it, with force and markers on one clock, in 11 adults
at two speeds, 7 children and on a treadmill: the medians of these sets lie from -2 to +9 ms at lift-off (sd 8) and from
-12 to +13 ms at the strike (sd 9), and none is beyond 25 ms. At 0.35 m/s one lift-off was 93 ms late.

When the load on a plate begins and ends.

A contact is loaded from the plate's threshold (20 N) on. Some laboratories store plates with a dead band: the
Rehazenter files hold nothing below 53 N. There the foot strikes before and leaves after the first and the last sample
that is stored, and the line through the nearest samples says when the load was zero: 10 ms earlier and 11 ms later at
a normal pace (C4). Double support without this is 27 ms shorter than in the files' events, with it 8 ms.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from stridelab.conventions import Series
from stridelab.recordings.foot_contact import Foot, find_feet, ground_velocity_m_s
from stridelab.recordings.foot_on_plate import mean_seen, on_plate
from stridelab.recordings.gap_filling import runs
from stridelab.recordings.plate_contacts import loaded_intervals
from stridelab.recordings.recording import Plate, Recording, Side
from stridelab.walking.marker_kinematics import level_speed_m_s, smooth_velocity_m_s, walking_speed_m_s

LEAVING, LANDED = 0.9, 0.45
"""Of the walking speed: of the forefoot at lift-off, of the heel at the strike."""
SWINGING: Final = 0.9
"""Of the walking speed: a faster foot swings. Its fastest instant is at 3.5, in the first step from rest at 1.5."""
LEAST_SWING_S: Final = 0.15
"""A foot that is off the ground for less did not step: a marker has jumped."""
SAME_S: Final = 0.1
"""Plate and markers mean the same instant if they differ by less; else the foot stood beside the plate meanwhile."""
MOSTLY: Final = 0.5
"""Share of a plate's load during which a foot must be over it to be the foot that loads it."""

EventSource = Literal["plates", "markers"]


@dataclass(frozen=True)
class Contact:
    """One foot on the ground, in seconds of the markers' clock; None where the recording does not show it."""

    side: Side
    strike_s: float | None
    lift_off_s: float | None
    strike_source: EventSource = "markers"
    lift_off_source: EventSource = "markers"

    @property
    def start_s(self) -> float:
        """When it begins, for comparisons."""
        return -np.inf if self.strike_s is None else self.strike_s

    @property
    def end_s(self) -> float:
        """When it ends, for comparisons."""
        return np.inf if self.lift_off_s is None else self.lift_off_s


def find_contacts(
    recording: Recording, landmarks: Mapping[str, str], *, latency_s: float = 0.0, plates: bool = True
) -> tuple[Contact, ...]:
    """All contacts of both feet in order of time; nothing where the feet are not marked.

    ``latency_s`` > 0 is by how much the force is late: plates are read in the markers' clock. ``plates`` False leaves
    them out, which tells how good the markers are.
    """
    feet = find_feet(recording, landmarks)
    if not feet:
        return ()
    by_markers = {foot.side: contacts_of_foot(recording, landmarks, foot) for foot in feet}
    if plates:
        for plate in recording.plates:
            if plate.use:
                _correct(by_markers, recording, plate, feet, latency_s)
    both = [contact for contacts in by_markers.values() for contact in contacts]
    return tuple(sorted(both, key=lambda contact: (contact.start_s, contact.end_s)))


def contacts_of_foot(recording: Recording, landmarks: Mapping[str, str], foot: Foot) -> list[Contact]:
    """Contacts of one foot between its swings, by its markers alone."""
    rate_hz, time_s = recording.marker_rate_hz, recording.time_s
    floor = ground_velocity_m_s(recording, [foot.markers_m[:, k] for k in range(foot.markers_m.shape[1])])
    v_heel = smooth_velocity_m_s(np.asarray(foot.markers_m[:, 0]), rate_hz) - floor
    v_fore = smooth_velocity_m_s(mean_seen(np.asarray(foot.markers_m[:, 1:])), rate_hz) - floor
    v = walking_speed_m_s(recording, landmarks, floor)
    fore = np.linalg.norm(v_fore, axis=1)
    slower = np.fmin(np.linalg.norm(v_heel, axis=1), fore)
    swinging = np.nan_to_num(level_speed_m_s(0.5 * (v_heel + v_fore)))
    contacts: list[Contact] = []
    strike_s: float | None = None
    down_again = -1
    for i, j in runs(swinging > SWINGING * v):
        if i < down_again:
            continue
        fastest = i + int(np.argmax(swinging[i:j]))
        lift_off_s = _crossing_s(time_s, fore, fastest, -1, LEAVING * v)
        landing_s = _crossing_s(time_s, slower, fastest, 1, LANDED * v)
        if lift_off_s is not None and landing_s is not None and landing_s - lift_off_s < LEAST_SWING_S:
            continue
        contacts.append(Contact(foot.side, strike_s, lift_off_s))
        strike_s = landing_s
        down_again = len(time_s) if strike_s is None else int(np.searchsorted(time_s, strike_s))
    contacts.append(Contact(foot.side, strike_s, None))
    return [c for c in contacts if len(contacts) == 1 or c.strike_s is not None or c.lift_off_s is not None]


def _crossing_s(time_s: Series, speed: Series, start: int, way: Literal[-1, 1], level: float) -> float | None:
    """When ``speed`` passes ``level``, from sample ``start`` on forwards or backwards; None before a gap or the end."""
    k = start
    while 0 <= k < len(speed) and speed[k] > level:
        k += way
    if not 0 <= k < len(speed) or np.isnan(speed[k]):
        return None
    if k == start:
        return float(time_s[k])
    share = (level - speed[k]) / (speed[k - way] - speed[k])
    return float(time_s[k] + share * (time_s[k - way] - time_s[k]))


def _correct(
    contacts: Mapping[Side, list[Contact]], recording: Recording, plate: Plate, feet: Sequence[Foot], latency_s: float
) -> None:
    """Put the instants of one plate in the place of those of the markers where both mean the same."""
    time_s = recording.time_s
    for begins_s, ends_s in contact_intervals(plate, recording.force_rate_hz):
        first_s = (begins_s or 0.0) - latency_s
        last_s = (recording.duration_s if ends_s is None else ends_s) - latency_s
        loaded = (time_s >= first_s) & (time_s <= last_s)
        if not loaded.any():
            continue
        standing = [
            f for f in feet if np.mean((on_plate(recording, plate, f) & f.resting)[loaded].any(axis=1)) > MOSTLY
        ]
        if begins_s is not None:
            _set_nearest(contacts, standing, "strike", first_s, (first_s, last_s))
        if ends_s is not None:
            _set_nearest(contacts, standing, "lift_off", last_s, (first_s, last_s))


def _set_nearest(
    contacts: Mapping[Side, list[Contact]],
    standing: Sequence[Foot],
    event: Literal["strike", "lift_off"],
    at_s: float,
    load_s: tuple[float, float],
) -> None:
    """Of the contacts on the plate, the one that the markers see begin or end nearest to ``at_s`` gets that instant.

    One whose beginning (or end) the markers do not see gets it where no other does.
    """
    best: tuple[float, list[Contact], int] | None = None
    for foot in standing:
        own = contacts[foot.side]
        for k, contact in enumerate(own):
            seen_s = contact.strike_s if event == "strike" else contact.lift_off_s
            overlaps = contact.start_s < load_s[1] - SAME_S and contact.end_s > load_s[0] + SAME_S
            away = SAME_S if seen_s is None else abs(seen_s - at_s)
            if overlaps and away <= SAME_S and (best is None or away < best[0]):
                best = away, own, k
    if best is None:
        return
    _, own, k = best
    if event == "strike":
        own[k] = replace(own[k], strike_s=at_s, strike_source="plates")
    else:
        own[k] = replace(own[k], lift_off_s=at_s, lift_off_source="plates")


DEAD_BAND: Final = 1.5
"""A contact whose first (last) sample carries this many thresholds was cut."""
RISE_S, FALL_S = 0.005, 0.01
"""Stretches through which the line goes: a heel loads faster than toes unload."""
MOST_BEFORE_S, MOST_AFTER_S = 0.02, 0.03


def contact_intervals(plate: Plate, rate_hz: float) -> list[tuple[float | None, float | None]]:
    """Start and end of each contact in seconds of the force's clock; None where the recording cuts it off."""
    load = np.linalg.norm(plate.force_n, axis=1)
    found: list[tuple[float | None, float | None]] = []
    for start_s, end_s in loaded_intervals(plate, rate_hz):
        i, j = round(start_s * rate_hz), round(end_s * rate_hz)
        begins = None if i == 0 else start_s - _beyond_s(load[i:], plate.threshold_n, rate_hz, RISE_S, MOST_BEFORE_S)
        last = j >= len(load) - 1
        ends = None if last else end_s + _beyond_s(load[j::-1], plate.threshold_n, rate_hz, FALL_S, MOST_AFTER_S)
        found.append((begins, ends))
    return found


def _beyond_s(load: np.ndarray, threshold_n: float, rate_hz: float, stretch_s: float, most_s: float) -> float:
    """How long before the first sample of ``load`` it was zero; 0 where nothing was cut."""
    if load[0] < DEAD_BAND * threshold_n:
        return 0.0
    n = min(max(3, round(stretch_s * rate_hz)), len(load))
    slope, at_start = np.polyfit(np.arange(n) / rate_hz, load[:n], 1)
    return float(min(max(at_start / slope, 0.0), most_s)) if slope > 0.0 else most_s
