"""Compare marker algorithms for foot strikes and lift-offs with plates on real walks; print a Markdown table.

make_event_table.py FOLDER...    C3D files below the folders; a person is the first part of a file's name

Algorithms: speeds of heel and forefoot (``walking.gait_events``, as Ghoussayni et al. 2004), heel and toe relative to
the pelvis (Zeni et al. 2008, doi:10.1016/j.gaitpost.2007.07.007), vertical velocity of the foot (O'Connor et al. 2007,
doi:10.1016/j.gaitpost.2006.05.016). The offset of each algorithm is the mean over every other
person in the order of their names; the rest of the people test it.
"""

import re
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import Points, Series
from stridelab.errors import StridelabError
from stridelab.estimation.latency import estimate_latency
from stridelab.recordings.foot_contact import Foot, find_feet, foot_outline
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import mean_visible, outline_off_plates, wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, Window, WrenchTrack
from stridelab.walking.gait_events import Contact, contacts_of_foot, find_contacts
from stridelab.walking.marker_kinematics import pelvis_m

NEAR_S = 0.15
"""Largest difference of an event by markers from that by plates."""
Landmarks = dict[str, str]
Events = dict[str, list[float]]
"""Times of ``strike`` and ``lift_off``."""


def main() -> None:
    """Read the folders of the command line and print the table."""
    rows: dict[tuple[str, str], list[tuple[str, str, float]]] = defaultdict(list)
    for folder in sys.argv[1:]:
        for path in sorted(Path(folder).rglob("*.c3d")):
            try:
                for algorithm, event, late_s in compare_events(path):
                    rows[algorithm, event].append((re.split("[_A-D]", path.stem.lstrip("HC"))[0], path.stem, late_s))
            except StridelabError as error:
                sys.stderr.write(f"{path.name}: {error.message}\n")
    lines = [
        "| algorithm | event | people, events | offset | held out: bias | sd | within 15 ms | shifted to plates |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [table_row(algorithm, event, errors) for (algorithm, event), errors in sorted(rows.items())]
    sys.stdout.write("\n".join([*lines, ""]))


def table_row(algorithm: str, event: str, errors: Sequence[tuple[str, str, float]]) -> str:
    """Figures of one algorithm: offset of half of the people, errors of the other half, and with the own mean removed.

    The last column leaves out the event itself from the mean of its recording.
    """
    people = sorted({person for person, _, _ in errors})
    tuned = set(people[::2])
    means = [np.mean([late for who, _, late in errors if who == person]) for person in people[::2]]
    offset = float(np.median(means))
    rest = np.array([late - offset for person, _, late in errors if person not in tuned])
    walks: dict[str, list[float]] = defaultdict(list)
    for person, walk, late in errors:
        if person not in tuned:
            walks[walk].append(late)
    alone = [
        value - float(np.mean(values[:k] + values[k + 1 :]))
        for values in walks.values()
        for k, value in enumerate(values)
        if len(values) > 1
    ]
    cells = [f"{1e3 * x:.0f} ms" for x in (offset, rest.mean(), rest.std())]
    shares = [f"{100 * np.mean(np.abs(x) <= 0.015):.0f} %" for x in (rest, np.array(alone))]
    return f"| {algorithm} | {event} | {len(people)}, {len(errors)} | {' | '.join(cells)} | {' | '.join(shares)} |"


def compare_events(path: Path) -> list[tuple[str, str, float]]:
    """Algorithm, event and its time minus that of the plates, for stances of which the whole foot is on plates."""
    recording = read_recording(path)
    landmarks = dict(identify(list(recording.markers_m)).landmarks)
    feet = {foot.side: foot for foot in find_feet(recording, landmarks)}
    plates = [plate for plate in recording.plates if plate.use]
    if not feet or not plates:
        return []
    rows = []
    events_by_side = {side: by_algorithm(recording, landmarks, foot) for side, foot in feet.items()}
    for contact in find_contacts(recording, landmarks, latency_s=latency_s(recording, landmarks)):
        if contact.strike_source != "plates" or contact.lift_off_source != "plates":
            continue
        outline = foot_outline(recording, landmarks, feet[contact.side])
        stance = (recording.time_s > contact.start_s) & (recording.time_s < contact.end_s)
        off = outline_off_plates(recording, plates, feet[contact.side], outline)
        if not stance.any() or off[stance].mean() > 0.1:
            continue
        for algorithm, events in events_by_side[contact.side].items():
            for event, at_s in (("strike", contact.start_s), ("lift-off", contact.end_s)):
                late = min((t - at_s for t in events[event]), key=abs, default=np.inf)
                if abs(late) < NEAR_S:
                    rows.append((algorithm, event, float(late)))
    return rows


def latency_s(recording: Recording, landmarks: Landmarks) -> float:
    """Delay of the force; 0 if it is not significant or cannot be estimated."""
    try:
        geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
        wrench = partial(wrench_at, recording, measured_windows(recording, landmarks))
        latency = estimate_latency(geometric, wrench, recording.subject.mass_kg or 70.0)
    except StridelabError:
        return 0.0
    return latency.latency_s if latency.significant else 0.0


def wrench_at(recording: Recording, windows: tuple[Window, ...], delay_s: float) -> WrenchTrack:
    """The wrench read ``delay_s`` later."""
    return wrench_track(recording, windows, latency_s=delay_s)


def by_algorithm(recording: Recording, landmarks: Landmarks, foot: Foot) -> dict[str, Events]:
    """Events of one foot by each algorithm."""
    rate_hz = recording.marker_rate_hz
    heel, fore = np.asarray(foot.markers_m[:, 0]), mean_visible(np.asarray(foot.markers_m[:, 1:]))
    pelvis = pelvis_m(recording, landmarks)
    travel = np.nanmean(np.gradient(pelvis, axis=0) * rate_hz - foot.ground_m_s, axis=0) * [1.0, 1.0, 0.0]
    ahead = travel / np.linalg.norm(travel)
    contacts: list[Contact] = contacts_of_foot(recording, landmarks, foot)
    heel_ahead, fore_ahead = (low_pass(track - pelvis, rate_hz, 10.0) @ ahead for track in (heel, fore))
    rising = np.gradient(low_pass(0.5 * (heel + fore), rate_hz, 7.0)[:, 2]) * rate_hz
    low = np.nanmin(heel[:, 2]) + 0.35 * np.ptp(heel[np.isfinite(heel[:, 2]), 2])
    middle_heel, middle_fore = np.nanmedian(heel_ahead), np.nanmedian(fore_ahead)
    return {
        "speeds of heel and forefoot": {
            "strike": [c.strike_s for c in contacts if c.strike_s is not None],
            "lift-off": [c.lift_off_s for c in contacts if c.lift_off_s is not None],
        },
        "Zeni 2008": {
            "strike": peaks_s(heel_ahead, rate_hz, lambda k: bool(heel_ahead[k] > middle_heel + 0.1)),
            "lift-off": peaks_s(-fore_ahead, rate_hz, lambda k: bool(fore_ahead[k] < middle_fore - 0.1)),
        },
        "O'Connor 2007": {
            "strike": peaks_s(-rising, rate_hz, lambda k: bool(heel[k, 2] < low and rising[k] < -0.1)),
            "lift-off": peaks_s(rising, rate_hz, lambda k: bool(rising[k] > 0.3)),
        },
    }


def low_pass(track: Points, rate_hz: float, cut_hz: float) -> Points:
    """Fourth-order zero-phase Butterworth of each visible run; NaN elsewhere."""
    smooth = np.full_like(track, np.nan)
    sections = butter(2, cut_hz, fs=rate_hz, output="sos")
    for i, j in true_runs(np.isfinite(track).all(axis=1)):
        if j - i > 15:
            smooth[i:j] = sosfiltfilt(sections, track[i:j], axis=0)
    return smooth


def peaks_s(track: Series, rate_hz: float, accept: Callable[[int], bool]) -> list[float]:
    """Times of local maxima, with a parabola through three samples."""
    peaks = []
    for k in range(1, len(track) - 1):
        a, b, c = track[k - 1 : k + 2]
        if b >= a and b > c and accept(k):
            peaks.append((k + 0.5 * (a - c) / (a - 2.0 * b + c)) / rate_hz)
    return peaks


if __name__ == "__main__":
    main()
