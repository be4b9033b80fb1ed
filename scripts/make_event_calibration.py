"""Judge the calibration of marker events by plates (``walking.event_calibration``) on real walks; print a table.

make_event_calibration.py NAME=FOLDER...    C3D files of walks below each folder, a source each

Every event of a whole stance on plates is timed by the markers and calibrated by the other events of its recording, of
its recording and session, or of the other recordings of its session alone; never by itself. A session is a person: the
digits and letters that ``PERSON`` finds in a path, else the recording alone. Recordings with the same differences are
copies and count once.
"""

import re
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from make_event_table import latency_s
from stridelab.errors import StridelabError
from stridelab.recordings.foot_contact import find_feet, foot_outline
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import outline_off_plates
from stridelab.recordings.reader import read_recording
from stridelab.walking.event_calibration import (
    MARKER_ERROR,
    EventKind,
    PlateDifference,
    common_difference,
)
from stridelab.walking.gait_events import contacts_of_foot, find_contacts
from stridelab.walking.low_passed_plates import LEAD_SD_S
from stridelab.walking.preconditions import require_walk

PERSON: Final = re.compile(r"(NP\d{4}|HC\d{3}[A-D]|20\d{5}(?=_C)|(?<=/)(PC|TD)\d{3}|(?<=/)00\d\d(?=_Davis)|patient\d)")
LEAST_ON_PLATES: Final = 0.9
WITHIN_S: Final = 0.015
MOVED: Final = re.compile(r"static|_ST\.|calib|_out\.c3d|run|sprint|jog|jump|squat|stair", re.IGNORECASE)
"""In the names of files that are no walks, or copies of them."""
Others = Literal["recording", "recording and session", "session alone"]
Differences = dict[EventKind, list[tuple[PlateDifference, bool, float]]]
"""Differences of a recording by kind of event, with whether the whole foot was on plates, since only these are judged,
and the standard deviation of the event on the plate in seconds."""
UNCERTAIN_S: Final = LEAD_SD_S
"""Deviation from which a strike on a plate is no sharp reference: that of a force that was low-passed."""


@dataclass(frozen=True)
class Calibrated:
    """An event by markers: how late it is before and after, and the standard deviation that is stated then."""

    source: str
    recording: str
    late_s: float
    rest_s: float
    sd_s: float
    lands_flat: bool
    plate_sd_s: float


def main() -> None:
    """Read the folders of the command line and print the table."""
    sessions: dict[tuple[str, str], dict[str, Differences]] = defaultdict(dict)
    copies = set()
    for source, folder in (argument.split("=") for argument in sys.argv[1:]):
        for path in sorted(Path(folder).rglob("*.[cC]3[dD]")):
            if MOVED.search(f"{path.relative_to(folder)}"):
                continue
            known = tried_differences(path)
            key = tuple(round(one.late_s, 4) for many in known.values() for one, *_ in many)
            if key and key not in copies:
                copies.add(key)
                person = PERSON.search(f"{path}")
                sessions[source, person.group() if person else f"{path}"][f"{path}"] = known
    sys.stdout.write("| event | calibrated by | source | n | within 15 ms: before | after | median | band holds |\n")
    sys.stdout.write("| --- | --- | --- | --- | --- | --- | --- | --- |\n")
    for kind in MARKER_ERROR:
        for others in ("recording", "recording and session", "session alone"):
            rows = [row for (name, _), known in sessions.items() for row in left_out(name, kind, others, known)]
            groups = {
                name: [row for row in rows if row.source == name] for name in sorted({row.source for row in rows})
            }
            groups |= {"all": rows, "crouch": [row for row in rows if "crouch" in row.recording]}
            if kind == "strike":
                groups |= {"heel strikes": [row for row in rows if not row.lands_flat]}
                groups |= {"flat": [row for row in rows if row.lands_flat]}
                groups |= {"on sharp plates": [row for row in rows if row.plate_sd_s < UNCERTAIN_S]}
                groups |= {"on uncertain plates": [row for row in rows if row.plate_sd_s >= UNCERTAIN_S]}
            for name, own in groups.items():
                if own:
                    sys.stdout.write(f"| {kind} | {others} | {name} | {' | '.join(timing_columns(own))} |\n")


def timing_columns(rows: Sequence[Calibrated]) -> list[str]:
    """Number, shares within 15 ms, medians of the sizes and the coverage of the band."""
    before, after, sd = (np.array([getattr(row, name) for row in rows]) for name in ("late_s", "rest_s", "sd_s"))
    shares = [f"{100 * np.mean(np.abs(late) <= WITHIN_S):.0f} %" for late in (before, after)]
    medians = [f"{1e3 * np.median(np.abs(late)):.1f}" for late in (before, after)]
    return [
        f"{len(rows)}",
        *shares,
        f"{medians[0]}, {medians[1]} ms",
        f"{100 * np.mean(abs(after) <= 1.96 * sd):.0f} %",
    ]


def left_out(source: str, kind: EventKind, others: Others, session: dict[str, Differences]) -> Iterator[Calibrated]:
    """Events of a session, each calibrated by the others; those that no other event informs are left out."""
    for name, known in session.items():
        rest = [[one for one, *_ in own[kind]] for other, own in session.items() if other != name]
        heels = [[one for one in own if not one.lands_flat] for own in rest]
        for k, (one, is_judged, plate_sd_s) in enumerate(known[kind]):
            own = [] if others == "session alone" else [other for j, (other, *_) in enumerate(known[kind]) if j != k]
            late = common_difference(kind, own, [] if others == "recording" or one.lands_flat else heels)
            if is_judged and late is not None:
                sd_s = float(np.hypot(late[1], one.own_s))
                yield Calibrated(source, name, one.late_s, one.late_s - late[0], sd_s, one.lands_flat, plate_sd_s)


def tried_differences(path: Path) -> Differences:
    """Differences of the stances that plates time; empty if the file is no walk of two marked feet over plates."""
    differences: Differences = {kind: [] for kind in MARKER_ERROR}
    try:
        recording = read_recording(path)
        landmarks = dict(identify(list(recording.markers_m)).landmarks)
        feet = find_feet(recording, landmarks)
        plates = [plate for plate in recording.plates if plate.use]
        if len(feet) < 2 or not plates:
            return differences
        contacts = find_contacts(recording, landmarks, latency_s=latency_s(recording, landmarks))
        require_walk(recording, landmarks, contacts)
    except StridelabError as error:
        sys.stderr.write(f"{path.name}: {error.message}\n")
        return differences
    for foot in feet:
        off = outline_off_plates(recording, plates, foot, foot_outline(recording, landmarks, foot))
        own = [contact for contact in contacts if contact.side == foot.side]
        for c, m in zip(own, contacts_of_foot(recording, landmarks, foot), strict=True):
            if not c.strike_source == c.lift_off_source == "plates":
                continue
            stance = (recording.time_s > c.start_s) & (recording.time_s < c.end_s)
            is_whole = bool(stance.any()) and float(off[stance].mean()) <= 1.0 - LEAST_ON_PLATES
            if c.strike_s is not None and m.strike_s is not None:
                late = PlateDifference(m.strike_s - c.strike_s, m.strike_error.own_s, m.lands_flat)
                differences["strike"].append((late, is_whole, c.strike_error.own_s))
            if c.lift_off_s is not None and m.lift_off_s is not None:
                late = PlateDifference(m.lift_off_s - c.lift_off_s, m.lift_off_error.own_s)
                differences["lift_off"].append((late, is_whole, c.lift_off_error.own_s))
    return differences


if __name__ == "__main__":
    main()
