"""Steps of a walk from the contacts of both feet.

A step lasts from the lift-off of one foot to the next lift-off of the other: single support, then double support.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stridelab.conventions import Points, Series, Vector3
from stridelab.recordings.foot_contact import Foot, find_feet, ground_of_feet_m_s
from stridelab.recordings.plate_contacts import mean_visible
from stridelab.recordings.recording import Recording, Side, Window
from stridelab.walking.event_calibration import MARKER_ERROR, EventError
from stridelab.walking.gait_events import Contact, find_contacts
from stridelab.walking.marker_kinematics import pelvis_m

TimingSource = Literal["plates", "markers", "mixed"]
MAX_MISSING_SHARE: Final = 0.08
"""Share of a step that may be missing at either end, because the detection of windows is conservative."""
MIN_PROGRESS_M: Final = 0.3
"""Shortest way between footprints of one foot that gives a direction."""


@dataclass(frozen=True, kw_only=True)
class GaitStep:
    """One step in seconds of the recording: the foot ``side`` swings from ``lift_off_s`` to ``strike_s``.

    Double support lasts from ``strike_s`` to ``next_lift_off_s``, the lift-off of the other foot. ``period_s`` is the
    time from the previous strike to this strike, or from lift-off to lift-off if the previous strike is unknown.
    ``length_m`` is the distance along the walk from the heel of the standing foot to the heel of ``side``, each read
    while flat, at the lift-off of the other foot; None if a heel is hidden. ``measured`` states whether all contact
    force was measured throughout. ``source`` is the source of the timing. ``prior_strike_s`` is the strike of the
    standing foot, ``stance_end_s`` the lift-off that ends the stance of ``side`` after its strike; None if unknown. The
    errors are those of the events of the same names.
    """

    side: Side
    lift_off_s: float
    strike_s: float
    next_lift_off_s: float
    period_s: float
    length_m: float | None
    speed_m_s: float
    measured: bool
    source: TimingSource
    prior_strike_s: float | None = None
    stance_end_s: float | None = None
    lift_off_error: EventError = MARKER_ERROR["lift_off"]
    strike_error: EventError = MARKER_ERROR["strike"]
    next_lift_off_error: EventError = MARKER_ERROR["lift_off"]
    prior_strike_error: EventError = MARKER_ERROR["strike"]

    @property
    def start_s(self) -> float:
        """Start of single support."""
        return self.lift_off_s

    @property
    def end_s(self) -> float:
        """End of double support."""
        return self.next_lift_off_s

    @property
    def double_support_s(self) -> tuple[float, float]:
        """Start and end of double support."""
        return (self.strike_s, self.next_lift_off_s)


def find_steps(
    recording: Recording,
    landmarks: Mapping[str, str],
    windows: Sequence[Window] = (),
    *,
    latency_s: float = 0.0,
    ahead: Vector3 | None = None,
    contacts: Sequence[Contact] | None = None,
) -> tuple[GaitStep, ...]:
    """All whole steps in order of time, possibly none; ``windows`` are the intervals with all contact force measured.

    ``latency_s`` > 0 is the delay of the force. ``ahead`` is the walking direction, by default that of the recording,
    else from the first to the last position of the pelvis. ``contacts`` are those of ``find_contacts``, computed if not
    given.
    """
    if contacts is None:
        contacts = find_contacts(recording, landmarks, latency_s=latency_s)
    if not contacts:
        return ()
    walk = _FloorRelative.from_recording(
        recording, landmarks, ahead if ahead is not None else recording.walking_direction
    )
    steps = []
    for before, after in _swing_pairs(contacts):
        other = _stance_during(contacts, before, after)
        if other is None or before.lift_off_s is None or after.strike_s is None or other.lift_off_s is None:
            continue
        start_s, strike_s, end_s = before.lift_off_s, after.strike_s, other.lift_off_s
        slack_s = MAX_MISSING_SHARE * (end_s - start_s)
        steps.append(
            GaitStep(
                side=before.side,
                lift_off_s=start_s,
                strike_s=strike_s,
                next_lift_off_s=end_s,
                period_s=end_s - start_s if other.strike_s is None else strike_s - other.strike_s,
                length_m=walk.length_m(before.side, start_s, strike_s, end_s),
                speed_m_s=walk.speed_m_s(start_s, end_s),
                measured=any(w.start_s - slack_s <= start_s and end_s <= w.end_s + slack_s for w in windows),
                source=_timing_source(before, after, other),
                prior_strike_s=other.strike_s,
                stance_end_s=after.lift_off_s,
                lift_off_error=before.lift_off_error,
                strike_error=after.strike_error,
                next_lift_off_error=other.lift_off_error,
                prior_strike_error=other.strike_error,
            )
        )
    return tuple(sorted(steps, key=lambda step: step.lift_off_s))


def find_one_sided_steps(recording: Recording, contacts: Sequence[Contact]) -> tuple[GaitStep, ...]:
    """Swings of the only marked foot as steps, whose times, lengths and speeds beside those of this foot are NaN.

    ``contacts`` are those of this foot. Strides from strike to strike need no other foot.
    """
    unknown = float("nan")
    return tuple(
        GaitStep(
            side=after.side,
            lift_off_s=before.lift_off_s,
            strike_s=after.strike_s,
            next_lift_off_s=unknown,
            period_s=unknown,
            length_m=None,
            speed_m_s=unknown,
            measured=False,
            source=_timing_source(before, after, after),
            stance_end_s=after.lift_off_s,
            lift_off_error=before.lift_off_error,
            strike_error=after.strike_error,
        )
        for before, after in itertools.pairwise(contacts)
        if before.lift_off_s is not None and after.strike_s is not None
    )


def footprint_direction(recording: Recording, feet: Sequence[Foot], contacts: Sequence[Contact]) -> Vector3 | None:
    """Line of progression through the footprints, a unit vector on the floor; None with too few footprints.

    The forefoot stands at p_k in contact k, and s_k is 1 for the left and -1 for the right foot. Across the walk,
    ``y_k = a + b x_k + w s_k`` by least squares gives the slope b of the line and half of the width w. Two footprints
    of one foot and one of the other suffice, and two of the only marked foot. The body itself sways: its mean velocity
    over a step or two deviates by several degrees, which changes the width of a step by centimetres.
    """
    prints: list[tuple[float, float, float]] = []
    for foot in feet:
        fore = mean_visible(np.asarray(foot.markers_m[:, 1:])) - foot.ground_m_s * recording.time_s[:, None]
        rests = foot.resting[:, 1:].all(axis=1) & np.isfinite(fore).all(axis=1)
        for contact in contacts:
            during = (recording.time_s > contact.start_s) & (recording.time_s < contact.end_s) & rests
            if contact.side == foot.side and during.any():
                x, y = np.median(fore[during, :2], axis=0)
                prints.append((float(x), float(y), 1.0 if foot.side == "left" else -1.0))
    table = np.array(prints).reshape(-1, 3)
    sides = [int((table[:, 2] == side).sum()) for side in (1.0, -1.0)]
    if (min(sides) < 1 and len(feet) > 1) or max(sides) < 2:
        return None
    once = max((table[table[:, 2] == side][:, :2] for side in (1.0, -1.0)), key=len)
    way = once[-1] - once[0]
    if float(np.linalg.norm(way)) < MIN_PROGRESS_M:
        return None
    for _ in range(2):
        ahead = way / np.linalg.norm(way)
        x, y = table[:, :2] @ ahead, table[:, :2] @ [-ahead[1], ahead[0]]
        slope = float(np.linalg.lstsq(np.column_stack([np.ones(len(x)), x, table[:, 2]]), y, rcond=None)[0][1])
        way = ahead + slope * np.array([-ahead[1], ahead[0]])
    ahead = way / np.linalg.norm(way)
    return np.array([ahead[0], ahead[1], 0.0])


def _swing_pairs(contacts: Sequence[Contact]) -> list[tuple[Contact, Contact]]:
    """Contacts of one foot before and after each of its swings."""
    swings: list[tuple[Contact, Contact]] = []
    sides: tuple[Side, ...] = ("left", "right")
    for side in sides:
        swings += itertools.pairwise(contact for contact in contacts if contact.side == side)
    return swings


def _stance_during(contacts: Sequence[Contact], before: Contact, after: Contact) -> Contact | None:
    """Contact of the other foot that lasts through the whole swing into double support; None in flight."""
    for contact in contacts:
        if contact.side != before.side and contact.start_s < before.end_s and contact.end_s > after.start_s:
            return contact
    return None


def _timing_source(before: Contact, after: Contact, other: Contact) -> TimingSource:
    sources = {before.lift_off_source, after.strike_source, other.lift_off_source}
    return "mixed" if len(sources) > 1 else next(iter(sources))


@dataclass(frozen=True)
class _FloorRelative:
    """Pelvis relative to the floor, heels in the laboratory, the surface under each foot, the direction of the walk."""

    time_s: Series
    pelvis_m: Points
    heels_m: Mapping[Side, Points]
    ground_m_s: Mapping[Side, Vector3]
    ahead: Vector3

    @classmethod
    def from_recording(
        cls, recording: Recording, landmarks: Mapping[str, str], ahead: Vector3 | None
    ) -> "_FloorRelative":
        feet = find_feet(recording, landmarks)
        pelvis = pelvis_m(recording, landmarks) - ground_of_feet_m_s(feet) * recording.time_s[:, None]
        if ahead is None:
            seen = pelvis[np.isfinite(pelvis).all(axis=1)]
            ahead = seen[-1] - seen[0]
        level = ahead * [1.0, 1.0, 0.0]
        heels = {foot.side: foot.markers_m[:, 0] for foot in feet}
        ground = {foot.side: foot.ground_m_s for foot in feet}
        return cls(recording.time_s, np.asarray(pelvis), heels, ground, level / np.linalg.norm(level))

    def length_m(self, side: Side, lift_off_s: float, strike_s: float, next_lift_off_s: float) -> float | None:
        """Distance from the other heel to this heel at the strike; None if one is hidden.

        Both heels are read while the foot is flat, at the lift-off of the other foot, and carried to the strike by
        their belts. So two steps add up to a stride: until it is flat, the heel of a landing foot still moves ahead.
        """
        other: Side = "left" if side == "right" else "right"
        landed_m, other_m = (
            self._ahead_m(self.heels_m[foot], flat_s) + self._carried_m(foot, strike_s - flat_s)
            for foot, flat_s in ((side, next_lift_off_s), (other, lift_off_s))
        )
        return landed_m - other_m if np.isfinite(landed_m - other_m) else None

    def speed_m_s(self, start_s: float, end_s: float) -> float:
        """Mean speed of the pelvis; NaN if it is hidden."""
        return (self._ahead_m(self.pelvis_m, end_s) - self._ahead_m(self.pelvis_m, start_s)) / (end_s - start_s)

    def _carried_m(self, side: Side, duration_s: float) -> float:
        """Way along the walk of the surface under a foot."""
        return float(self.ground_m_s[side] @ self.ahead) * duration_s

    def _ahead_m(self, track: Points, at_s: float) -> float:
        return float(np.interp(at_s, self.time_s, track @ self.ahead))
