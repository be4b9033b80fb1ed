"""Calibration of marker events by plates: drawn sessions, and schematic walks whose instants are known."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.recordings.recording import Recording
from stridelab.walking.event_calibration import (
    FLAT_STRIKE_ERROR,
    MARKER_ERROR,
    MAX_SHIFT_S,
    RECORDING_SD_S,
    SESSION_SD_S,
    EventKind,
    PlateDifference,
    common_difference,
)
from stridelab.walking.gait_events import find_contacts, plate_differences
from support.recordings.walks import LANDMARKS, delayed, heel_first, walk

OWN_S = MARKER_ERROR["strike"].own_s


def drawn(rng: np.random.Generator, session_s: float, n: int) -> tuple[float, list[PlateDifference]]:
    """Constant of a recording, and ``n`` differences in it."""
    constant_s = session_s + rng.normal(0.0, RECORDING_SD_S)
    return constant_s, [PlateDifference(constant_s + rng.normal(0.0, OWN_S), OWN_S) for _ in range(n)]


@pytest.mark.parametrize(("n_own", "n_others"), [(2, 0), (0, 1), (0, 3), (1, 2)])
def test_the_stated_deviation_is_that_of_the_errors_that_remain(n_own: int, n_others: int) -> None:
    """2000 drawn sessions: the constant, less the shift, over its stated deviation has the size 1, within a tenth.

    0.86 with three other recordings, from which an excess is estimated that is not there.
    """
    rng = np.random.default_rng(5)
    scaled, left = [], []
    for _ in range(2000):
        session_s = rng.normal(0.0, SESSION_SD_S["strike"])
        constant_s, own = drawn(rng, session_s, n_own)
        late = common_difference("strike", own, [drawn(rng, session_s, 2)[1] for _ in range(n_others)])
        assert late is not None
        scaled.append((constant_s - late[0]) / late[1])
        left.append(constant_s - late[0])
    assert (0.8 if n_others > 2 else 0.9) < np.std(scaled) < 1.1
    assert abs(np.mean(scaled)) < 0.1
    assert np.std(left) < 0.6 * MARKER_ERROR["strike"].common_s


def test_recordings_that_contradict_each_other_count_for_less() -> None:
    """Two recordings 2 and 40 ms late, as in a session of several ways to walk, against two that are 21 ms late."""
    agree, contradict = (
        common_difference("strike", (), [[PlateDifference(late_s, OWN_S)] * 3 for late_s in two])
        for two in ((0.021, 0.021), (0.002, 0.040))
    )
    assert agree is not None
    assert contradict is not None
    assert contradict[0] < 0.8 * agree[0]
    assert contradict[1] > 3.0 * agree[1]


@pytest.mark.parametrize("kind", ["strike", "lift_off"])
def test_without_a_usable_difference_nothing_is_shifted(kind: EventKind) -> None:
    assert common_difference(kind, ()) is None
    assert common_difference(kind, (), [[], [PlateDifference(1.01 * MAX_SHIFT_S, OWN_S)]]) is None


def strikes_s(recording: Recording, **how: object) -> np.ndarray:
    contacts = find_contacts(recording, LANDMARKS, **how)  # type: ignore[arg-type]
    return np.array([contact.strike_s for contact in contacts if contact.strike_s is not None])


def without_plates(recording: Recording) -> Recording:
    return replace(recording, plates=tuple(replace(plate, use=False) for plate in recording.plates))


@pytest.mark.parametrize("late_frames", [0, 1])
def test_a_recording_without_strikes_on_plates_follows_its_session(late_frames: int) -> None:
    """Markers 0 or 10 ms late: another recording of the session brings its strikes to within 4 ms of the plates'."""
    recording = delayed(heel_first(walk([2, 3])), late_frames)
    off = without_plates(recording)
    known = plate_differences(recording, LANDMARKS)
    assert [len(known[kind]) for kind in ("strike", "lift_off")] == [2, 2]
    on_plates = [c for c in find_contacts(recording, LANDMARKS) if c.strike_source == "plates"]
    following = find_contacts(off, LANDMARKS, session=[known])
    for contact in on_plates:
        (same,) = [c for c in following if c.side == contact.side and abs(c.start_s - contact.start_s) < 0.2]
        assert same.strike_source == "markers"
        assert same.start_s == pytest.approx(contact.start_s, abs=0.004)
        assert same.strike_error.common_s < 0.6 * MARKER_ERROR["strike"].common_s
        assert same.strike_error.own_s == OWN_S
        assert same.lift_off_error.common_s < 0.7 * MARKER_ERROR["lift_off"].common_s
    shift_s = strikes_s(off) - strikes_s(off, session=[known])
    assert np.ptp(shift_s) < 1e-12


def test_a_recording_with_strikes_on_plates_believes_itself_more_than_its_session() -> None:
    recording = delayed(heel_first(walk([2, 3])), 2)
    own = strikes_s(recording) - strikes_s(recording, plates=False)
    other = {kind: [replace(one, late_s=0.0) for one in many] for kind, many in plate_differences(
        recording, LANDMARKS).items()}  # fmt: skip
    both = strikes_s(recording, session=[other]) - strikes_s(recording, plates=False)
    off = ~np.isclose(strikes_s(recording), strikes_s(recording, session=[other]))
    assert off.any()
    assert np.all(both[off] > own[off])
    assert np.all(both[off] < 0.5 * own[off])


def test_flat_landings_neither_inform_nor_follow_a_session() -> None:
    """The feet of the schematic walk land flat: their strikes follow the plates of their own recording alone."""
    flat = walk([2, 3])
    contacts = find_contacts(flat, LANDMARKS, plates=False)
    assert all(c.lands_flat and c.strike_error == FLAT_STRIKE_ERROR for c in contacts if c.strike_s is not None)
    heels = delayed(heel_first(flat), 2)
    assert not any(c.lands_flat for c in find_contacts(heels, LANDMARKS, plates=False))
    session = [plate_differences(heels, LANDMARKS)]
    assert np.array_equal(strikes_s(without_plates(flat), session=session), strikes_s(without_plates(flat)))
    off, known = without_plates(heels), [plate_differences(delayed(flat, 2), LANDMARKS)]
    assert all(one.lands_flat for one in known[0]["strike"])
    assert np.array_equal(strikes_s(off, session=known), strikes_s(off))
