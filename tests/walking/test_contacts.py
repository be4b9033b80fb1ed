"""Contacts of a schematic walk whose instants are known exactly, and markers against plates on real walks."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.latency import estimate_latency
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording
from stridelab.walking import gait_events
from stridelab.walking.event_calibration import MARKER_ERROR
from stridelab.walking.gait_events import MAX_SINKING_S, STRIKE_DELAY_S, Contact, find_contacts
from stridelab.walking.low_passed_plates import low_pass_lead_s
from support.recordings.walks import LANDMARKS, STANCE_S, STEP_S, delayed, heel_first, walk

LOADED_S = 0.003
"""A foot of the schematic walk carries 20 N this long after it landed."""
MARKERS_S = 0.025


def strike_s(k: int) -> float:
    return STEP_S * k - 0.3


def of_stance(contacts: tuple[Contact, ...], k: int) -> Contact:
    """The detected contact of stance ``k``."""
    middle = strike_s(k) + STANCE_S / 2
    (contact,) = [c for c in contacts if c.side == ("left", "right")[k % 2] and c.start_s < middle < c.end_s]
    return contact


def test_plates_time_a_contact_where_there_is_one() -> None:
    contacts = find_contacts(walk([2, 3]), LANDMARKS)
    for k in (2, 3):
        contact = of_stance(contacts, k)
        assert (contact.strike_source, contact.lift_off_source) == ("plates", "plates")
        assert contact.strike_s == pytest.approx(strike_s(k) + LOADED_S, abs=0.0011)
        assert contact.lift_off_s == pytest.approx(strike_s(k) + STANCE_S - LOADED_S, abs=0.0011)


def test_markers_time_the_others_without_bias() -> None:
    contacts = find_contacts(walk([2, 3]), LANDMARKS, plates=False)
    late = []
    for k in range(2, 6):
        contact = of_stance(contacts, k)
        assert contact.strike_source == contact.lift_off_source == "markers"
        assert contact.strike_s is not None
        assert contact.lift_off_s is not None
        late += [contact.strike_s - strike_s(k), contact.lift_off_s - strike_s(k) - STANCE_S]
    assert np.abs(late).max() < MARKERS_S
    assert abs(np.mean(late)) < 0.01


def test_sides_alternate_in_order_of_time_and_no_contact_is_reported_twice() -> None:
    contacts = find_contacts(walk([2, 3]), LANDMARKS)
    inside = [c for c in contacts if c.strike_s is not None and c.lift_off_s is not None]
    assert [c.side for c in inside] == ["left", "right", "left", "right"]
    assert [c.strike_s for c in inside] == sorted(c.start_s for c in inside)


def test_the_latency_of_the_force_moves_the_times_of_the_plates() -> None:
    plain, moved = (of_stance(find_contacts(walk([2, 3]), LANDMARKS, latency_s=s), 2) for s in (0.0, 0.018))
    assert plain.start_s - moved.start_s == pytest.approx(0.018)
    assert plain.end_s - moved.end_s == pytest.approx(0.018)


def test_markers_are_shifted_by_their_mean_difference_to_the_plates_of_the_recording() -> None:
    """All markers 20 ms late: the plates below stances 2 and 3 inform the strikes of 4 and 5, where there is none."""
    recording = heel_first(walk([2, 3]))
    late = delayed(recording, 2)
    plain, alone = find_contacts(late, LANDMARKS, plates=False), find_contacts(recording, LANDMARKS, plates=False)
    shifted = find_contacts(late, LANDMARKS)
    for k in (4, 5):
        assert of_stance(plain, k).strike_s == pytest.approx(of_stance(alone, k).start_s + 0.02, abs=0.002)
        contact = of_stance(shifted, k)
        assert contact.strike_source == "markers"
        on_plate_s = strike_s(k) + LOADED_S
        assert abs(contact.start_s - on_plate_s) < 0.15 * abs(of_stance(plain, k).start_s - on_plate_s)
        assert contact.strike_error.common_s < 0.5 * MARKER_ERROR["strike"].common_s
        assert contact.strike_error.own_s == MARKER_ERROR["strike"].own_s


def test_a_foot_that_sinks_before_and_not_after_lands_earlier_up_to_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit shows with weights of a thousand times their size; without velocities only the delay remains."""
    recording = walk([2, 3])
    last = np.searchsorted(recording.time_s, strike_s(5) + 0.05)
    cut = replace(recording, markers_m={label: track[:last] for label, track in recording.markers_m.items()})
    strikes = {}
    for size in (0.0, 1.0, 1000.0):
        weights_s = size * gait_events.SINKING_WEIGHTS_S if size else np.zeros((2, 8))
        with monkeypatch.context() as changed:
            changed.setattr(gait_events, "SINKING_WEIGHTS_S", weights_s)
            changed.setattr(gait_events, "SINKING_MEAN_S", 0.0)
            contacts = find_contacts(cut, LANDMARKS, plates=False)
        strikes[size] = [contact.strike_s for contact in contacts if contact.strike_s is not None]
    crossing, plain, large = (np.array(strikes[size]) for size in (0.0, 1.0, 1000.0))
    assert len(crossing) >= 4
    assert np.all((plain[:-1] < crossing[:-1]) & (plain[:-1] > crossing[:-1] - 0.02))
    assert large[:-1] == pytest.approx(crossing[:-1] - MAX_SINKING_S)
    assert plain[-1] == crossing[-1] == large[-1]
    assert crossing[-1] > strike_s(5) - MARKERS_S + STRIKE_DELAY_S


def test_a_plate_under_half_of_a_contact_does_not_end_it() -> None:
    """The plate loses its foot 0.25 s before it lifts, as when the forefoot stands beside: the markers are believed."""
    recording = walk([2, 3])
    first = recording.plates[0]
    force = first.force_n.copy()
    force[round(1000 * (strike_s(2) + STANCE_S - 0.25)) :] = 0.0
    contacts = find_contacts(replace(recording, plates=(replace(first, force_n=force), recording.plates[1])), LANDMARKS)
    contact = of_stance(contacts, 2)
    assert (contact.strike_source, contact.lift_off_source) == ("plates", "markers")
    assert contact.lift_off_s == pytest.approx(strike_s(2) + STANCE_S, abs=MARKERS_S)


def test_plates_that_are_switched_off_time_no_contact() -> None:
    recording = walk([2, 3])
    off = tuple(replace(plate, use=False) for plate in recording.plates)
    assert all(c.strike_source == "markers" for c in find_contacts(replace(recording, plates=off), LANDMARKS))


def test_a_marker_that_jumps_is_no_swing() -> None:
    """Both forefoot markers of a standing foot are swapped with something else for 40 ms."""
    recording = walk([2, 3])
    i = round(100 * (strike_s(3) + 0.3))
    markers = dict(recording.markers_m)
    for label in ("r_heel", "r_mt1", "r_mt5"):
        markers[label] = markers[label].copy()
        markers[label][i : i + 4] += [0.25, 0.0, 0.1]
    jumped = find_contacts(replace(recording, markers_m=markers), LANDMARKS, plates=False)
    plain = find_contacts(recording, LANDMARKS, plates=False)
    assert [c.side for c in jumped] == [c.side for c in plain]


def test_feet_without_markers_have_no_contacts() -> None:
    assert find_contacts(walk([2, 3]), {}) == ()


@dataclass(frozen=True)
class Timed:
    """A real walk: contacts with plates and by markers alone, on the markers' clock."""

    recording: Recording
    plates: tuple[Contact, ...]
    markers: tuple[Contact, ...]


@pytest.fixture(scope="module")
def walks(data_dir: Path) -> list[Timed]:
    """Eleven adults at their own pace and seven children."""
    gait = data_dir / "gait"
    if not gait.is_dir():
        pytest.skip("real recordings are not on this machine (STRIDELAB_TEST_DATA)")
    files = [*gait.glob("rehazenter-adult-walking/*/*_C4_*.c3d"), *gait.glob("biomechzoo-sample-study/*/Straight*.c3d")]
    return [timed(path) for path in sorted(files)]


def timed(path: Path) -> Timed:
    recording = read_recording(path)
    landmarks = identify(list(recording.markers_m)).landmarks
    geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
    wrench_at = partial(_wrench, recording, measured_windows(recording, landmarks))
    assert recording.subject.mass_kg is not None
    latency = estimate_latency(geometric, wrench_at, recording.subject.mass_kg)
    with_plates = find_contacts(recording, landmarks, latency_s=latency.latency_s if latency.significant else 0.0)
    return Timed(recording, with_plates, find_contacts(recording, landmarks, plates=False))


def _wrench(recording: Recording, windows, latency_s: float):  # type: ignore[no-untyped-def]
    return wrench_track(recording, windows, latency_s=latency_s)


def differences_s(walks: list[Timed], event: str) -> np.ndarray:
    """Markers minus plates at all events that both see."""
    differences = []
    for one in walks:
        for contact in one.plates:
            if getattr(contact, f"{event}_source") != "plates":
                continue
            times = [
                getattr(c, f"{event}_s")
                for c in one.markers
                if c.side == contact.side and c.start_s < contact.end_s and c.end_s > contact.start_s
            ]
            at = getattr(contact, f"{event}_s")
            differences += [t - at for t in times if t is not None]
    return np.array(differences)


@pytest.mark.parametrize(("event", "least"), [("strike", 30), ("lift_off", 34)])
def test_markers_are_within_25_ms_of_the_plates(walks: list[Timed], event: str, least: int) -> None:
    late_s = differences_s(walks, event)
    assert len(late_s) >= least
    assert np.abs(late_s).max() <= MARKERS_S
    assert abs(np.median(late_s)) < 0.012


def double_support_off_s(one: Timed) -> float:
    """Double support on plates minus that of the file's events."""
    strikes = {c.strike_s: c for c in one.plates if c.strike_source == "plates" and c.strike_s is not None}
    lifts = [(c, c.lift_off_s) for c in one.plates if c.lift_off_source == "plates" and c.lift_off_s is not None]
    (pair,) = [
        (s, lift_off_s) for s, struck in strikes.items() for c, lift_off_s in lifts
        if c.side != struck.side and 0.0 < c.end_s - s < 0.3
    ]  # fmt: skip
    stored = [
        min((e.time_s for e in one.recording.events if e.kind == kind), key=lambda t: abs(t - at))
        for kind, at in (("foot_strike", pair[0]), ("foot_off", pair[1]))
    ]
    return (pair[1] - pair[0]) - (stored[1] - stored[0])


def is_low_passed(one: Timed) -> bool:
    leads = [low_pass_lead_s(plate, one.recording.force_rate_hz) for plate in one.recording.plates]
    return any(lead_s is not None for lead_s in leads)


def test_double_support_on_plates_is_that_of_the_files_events(walks: list[Timed]) -> None:
    """Within 15 ms in the seven walks whose force is stored as measured; the events are whole frames of 10 ms."""
    off_s = [double_support_off_s(one) for one in walks if not is_low_passed(one)]
    assert len(off_s) == 7
    assert np.abs(off_s).max() <= 0.0151
    assert abs(np.mean(off_s)) < 0.01


def test_double_support_on_low_passed_plates_is_shorter_than_in_the_files_events(walks: list[Timed]) -> None:
    """Those events lie before the first and after the last load that is stored, where the filter has smeared it."""
    off_s = [double_support_off_s(one) for one in walks if is_low_passed(one)]
    assert len(off_s) == 11
    assert -0.03 < np.mean(off_s) < -0.01
