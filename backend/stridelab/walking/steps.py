"""Steps of a walk: what lies between the contacts of both feet."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from stridelab.conventions import Vector3
from stridelab.recordings.feet import Foot, find_feet, ground_velocity_m_s
from stridelab.recordings.recording import Recording, Side, Window
from stridelab.walking.contacts import Contact, find_contacts
from stridelab.walking.gait_step import MOST_MISSING, GaitStep, TimingSource
from stridelab.walking.marker_motion import pelvis_m


def find_steps(
    recording: Recording,
    landmarks: Mapping[str, str],
    windows: Sequence[Window] = (),
    *,
    latency_s: float = 0.0,
    ahead: Vector3 | None = None,
    contacts: Sequence[Contact] | None = None,
) -> tuple[GaitStep, ...]:
    """All whole steps in order of time; ``windows`` are where all contact force is measured.

    ``latency_s`` > 0 is by how much the force is late. ``ahead`` is the direction of the walk; that of the recording
    unless stated, and each step's own where the recording has none. ``contacts`` are those of ``find_contacts`` if they
    are known already. Empty where there is no whole step.
    """
    if contacts is None:
        contacts = find_contacts(recording, landmarks, latency_s=latency_s)
    feet = {foot.side: foot for foot in find_feet(recording, landmarks)}
    steps = []
    for before, after in _swings(contacts):
        other = _stance_during(contacts, before, after)
        if other is None or before.lift_off_s is None or after.strike_s is None or other.lift_off_s is None:
            continue
        slack_s = MOST_MISSING * (other.lift_off_s - before.lift_off_s)
        inside = any(
            w.start_s - slack_s <= before.lift_off_s and other.lift_off_s <= w.end_s + slack_s for w in windows
        )
        period_s = after.strike_s - other.strike_s if other.strike_s else other.lift_off_s - before.lift_off_s
        towards = ahead if ahead is not None else recording.walking_direction
        length_m, speed_m_s = _length_and_speed(recording, landmarks, feet, before, after, other, towards)
        steps.append(
            GaitStep(
                side=before.side,
                lift_off_s=before.lift_off_s,
                strike_s=after.strike_s,
                next_lift_off_s=other.lift_off_s,
                period_s=period_s,
                length_m=length_m,
                speed_m_s=speed_m_s,
                measured=inside,
                source=_source(before, after, other),
                prior_strike_s=other.strike_s,
            )
        )
    return tuple(sorted(steps, key=lambda step: step.lift_off_s))


def _swings(contacts: Sequence[Contact]) -> list[tuple[Contact, Contact]]:
    """Contacts of one foot before and after each of its swings."""
    found: list[tuple[Contact, Contact]] = []
    sides: tuple[Side, ...] = ("left", "right")
    for side in sides:
        own = [contact for contact in contacts if contact.side == side]
        found += itertools.pairwise(own)
    return found


def _stance_during(contacts: Sequence[Contact], before: Contact, after: Contact) -> Contact | None:
    """The contact of the other foot that bears the whole swing and lasts into double support; None in flight."""
    for contact in contacts:
        if contact.side != before.side and contact.start_s < before.end_s and contact.end_s > after.start_s:
            return contact
    return None


def _source(before: Contact, after: Contact, other: Contact) -> TimingSource:
    sources = {before.lift_off_source, after.strike_source, other.lift_off_source}
    return "mixed" if len(sources) > 1 else next(iter(sources))


def _length_and_speed(
    recording: Recording,
    landmarks: Mapping[str, str],
    feet: Mapping[Side, Foot],
    before: Contact,
    after: Contact,
    other: Contact,
    ahead: Vector3 | None,
) -> tuple[float | None, float]:
    """From where the other heel stands to where this one lands, and the pelvis' speed from lift-off to lift-off."""
    assert before.lift_off_s is not None
    assert after.strike_s is not None
    assert other.lift_off_s is not None
    time_s = recording.time_s
    floor = ground_velocity_m_s(
        recording, [f.markers_m[:, k] for f in feet.values() for k in range(f.markers_m.shape[1])]
    )

    def at(track: np.ndarray, when_s: float) -> Vector3:
        carried = track - floor * time_s[:, None]
        return np.array([np.interp(when_s, time_s, carried[:, axis]) for axis in range(3)])

    pelvis = pelvis_m(recording, landmarks)
    way = (at(pelvis, other.lift_off_s) - at(pelvis, before.lift_off_s)) * [1.0, 1.0, 0.0]
    if ahead is None:
        ahead = way / max(float(np.linalg.norm(way)), 1e-9)
    stands = at(feet[other.side].markers_m[:, 0], before.lift_off_s)
    lands = at(feet[before.side].markers_m[:, 0], after.strike_s)
    length = float((lands - stands) @ ahead)
    return (length if np.isfinite(length) else None), float(way @ ahead) / (other.lift_off_s - before.lift_off_s)
