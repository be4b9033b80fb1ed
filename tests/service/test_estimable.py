"""What a recording says of its estimates is what the job does: the same code, and nothing refused that would work."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stridelab.errors import StridelabError
from stridelab.estimation import differentiation
from stridelab.pipelines.trial import examine_trial
from stridelab.recordings import force_windows
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, Subject
from stridelab.schemas.methods import METHODS
from stridelab.schemas.recordings import EstimateOffer, PlateSwitch, RecordingFacts, SubjectFields
from stridelab.schemas.tasks import RecordingSource
from stridelab.service import estimable
from stridelab.service.estimable import estimate_offers
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.service.kinds.parse_upload import recording_facts as facts_of
from support.command_line import SAMPLE, estimate_task, quiet
from support.service.stored_rows import facts

NO_SUBJECT = SubjectFields()


def offers(
    known: RecordingFacts, subject: SubjectFields | None = None, *, alone: bool = True
) -> dict[str, EstimateOffer]:
    estimate_offered = estimate_offers(known, known.subject if subject is None else subject, no_other_mass_source=alone)
    assert [offer.method for offer in estimate_offered] == list(METHODS)
    for offer in estimate_offered:
        assert offer.possible == (offer.code is None) == (offer.reason is None)
    return {offer.method: offer for offer in estimate_offered}


def codes(
    known: RecordingFacts, subject: SubjectFields | None = None, *, alone: bool = True
) -> tuple[str | None, str | None]:
    """Codes of the methods with force, which are one, and of the geometry."""
    offered = offers(known, subject, alone=alone)
    (force,) = {offer.code for method, offer in offered.items() if method != "geometry"}
    return force, offered["geometry"].code


def test_the_limits_are_those_of_the_estimators() -> None:
    assert estimable.SHORTEST_WINDOW_S == differentiation.SHORTEST_WINDOW_S
    assert estimable.MIN_WINDOW_S == force_windows.MIN_WINDOW_S
    assert estimable.MIN_FRAMES == force_windows.MIN_FRAMES


def test_a_stated_static_trial_may_name_the_labels_of_an_unknown_set() -> None:
    unknown = facts(marker_set=None)
    assert codes(unknown) == ("unknown-marker-set", "unknown-marker-set")
    stated = estimate_offers(unknown, NO_SUBJECT, no_other_mass_source=False, static_stated=True)
    assert {offer.code for offer in stated} == {None}


def cut(recording: Recording, start: int, stop: int) -> Recording:
    """Frames ``start`` to ``stop`` of the markers, with the force of that time."""
    ratio = round(recording.force_rate_hz / recording.marker_rate_hz)
    plates = tuple(
        replace(
            plate,
            force_n=plate.force_n[ratio * start : ratio * stop],
            moment_nm=plate.moment_nm[ratio * start : ratio * stop],
        )
        for plate in recording.plates
    )
    markers = {label: track[start:stop] for label, track in recording.markers_m.items()}
    return replace(recording, markers_m=markers, plates=plates)


def slow(recording: Recording, n: int) -> Recording:
    """``n`` frames and samples, one a second: long enough, and too few."""
    frames = {label: track[200 : 200 + n] for label, track in recording.markers_m.items()}
    few = tuple(
        replace(p, force_n=p.force_n[200 : 200 + n], moment_nm=p.moment_nm[200 : 200 + n]) for p in recording.plates
    )
    return replace(recording, markers_m=frames, plates=few, marker_rate_hz=1.0, force_rate_hz=1.0)


def bare(recording: Recording) -> Recording:
    return replace(recording, plates=())


def unloaded(recording: Recording) -> Recording:
    return replace(
        recording, plates=tuple(replace(p, force_n=0 * p.force_n, moment_nm=0 * p.moment_nm) for p in recording.plates)
    )


def renamed(recording: Recording) -> Recording:
    return replace(recording, markers_m={f"Q{i}": track for i, track in enumerate(recording.markers_m.values())})


def without_subject(recording: Recording) -> Recording:
    return replace(recording, subject=Subject())


def beside(recording: Recording) -> Recording:
    """The plates lie ten metres away, and so do the feet's forces: no foot is on them."""
    moved = []
    for plate in recording.plates:
        away = np.array([0.0, 10.0, 0.0])
        moment_nm = plate.moment_nm + np.cross(away, plate.force_n)
        moved.append(replace(plate, corners_m=plate.corners_m + away, moment_nm=moment_nm))
    return replace(recording, plates=tuple(moved))


def swapped(recording: Recording) -> Recording:
    """Every marker of the left side has the name of the right one, and the other way round."""
    other = {"L": "R", "R": "L"}
    names = {label: f"{other[label[0]]}{label[1:]}" for label in recording.markers_m if label[0] in other}
    names = {label: name for label, name in names.items() if name in recording.markers_m}
    markers = {names.get(label, label): track for label, track in recording.markers_m.items()}
    return replace(recording, markers_m=markers, events=())


def overloaded(limit_n: float) -> Callable[[Recording], Recording]:
    """The plates cannot measure more than ``limit_n`` upwards."""

    def change(recording: Recording) -> Recording:
        plates = [
            replace(plate, force_n=np.minimum(plate.force_n, [np.inf, np.inf, limit_n])) for plate in recording.plates
        ]
        return replace(recording, plates=tuple(plates))

    return change


CASES: dict[str, tuple[Callable[[Recording], Recording], dict[int, dict[str, Any]]]] = {
    "whole": (lambda r: r, {}),
    "no plates": (bare, {}),
    "no plates, no subject": (lambda r: without_subject(bare(r)), {}),
    "plates off": (lambda r: r, {1: {"use": False}, 2: {"use": False}}),
    "one plate off": (lambda r: r, {1: {"use": False}}),
    "unloaded": (unloaded, {}),
    "beside the plates": (beside, {}),
    "unknown labels": (renamed, {}),
    "one frame": (lambda r: cut(r, 200, 201), {}),
    "two frames": (lambda r: cut(r, 200, 202), {}),
    "two slow frames": (lambda r: slow(r, 2), {}),
    "two slow frames without plates": (lambda r: bare(slow(r, 2)), {}),
    "five slow frames": (lambda r: slow(r, 5), {}),
    "0.38 s": (lambda r: cut(r, 200, 238), {}),
    "0.42 s": (lambda r: cut(r, 200, 242), {}),
    "short on the plates": (lambda r: cut(r, 100, 222), {}),
    "no mass": (lambda r: without_subject(cut(r, 195, 240)), {}),
    "left and right exchanged": (swapped, {}),
    "left and right exchanged, no plates": (lambda r: swapped(bare(r)), {}),
    "left and right exchanged, short": (lambda r: bare(swapped(cut(r, 200, 238))), {}),
    "overloaded": (overloaded(100.0), {}),
    "overloaded at times": (overloaded(600.0), {}),
}

UNSEEN = {"0.42 s"}
"""Only the estimator sees that the longest time on one foot is too short."""


@pytest.mark.parametrize("case", CASES)
def test_the_advance_check_agrees_with_the_job(case: str, tmp_path: Path) -> None:
    change, plates = CASES[case]
    recording = read_recording(SAMPLE / "recording.c3d")
    write_c3d(tmp_path / "trial.c3d", change(recording))
    switches = {index: PlateSwitch(**switch) for index, switch in plates.items()}
    known = facts_of(examine_trial(RecordingSource(file="trial.c3d", filename="trial.c3d", plates=switches), tmp_path))
    offered = offers(known)
    for method in ("smoother", "complementary", "geometry"):
        folder = tmp_path / method
        task = estimate_task(tmp_path / "trial.c3d", folder, method=method)
        task = task.model_copy(update={"recording": task.recording.model_copy(update={"plates": switches})})
        refusal: StridelabError | None = None
        try:
            estimate_com.run(task, folder, quiet)
        except StridelabError as error:
            refusal = error
        offer = offered[method]
        if refusal is None or case in UNSEEN:
            assert offer.possible, f"{method} gives an estimate"
        else:
            assert offer.code == refusal.code, f"{method}: {refusal}"


SAME = {"no plates", "plates off", "unloaded", "one frame", "two frames", "two slow frames"}


@pytest.mark.parametrize("case", sorted(SAME))
def test_the_reason_is_the_sentence_of_the_job(case: str, tmp_path: Path) -> None:
    change, plates = CASES[case]
    write_c3d(tmp_path / "trial.c3d", change(read_recording(SAMPLE / "recording.c3d")))
    switches = {index: PlateSwitch(**switch) for index, switch in plates.items()}
    known = facts_of(examine_trial(RecordingSource(file="trial.c3d", filename="trial.c3d", plates=switches), tmp_path))
    task = estimate_task(tmp_path / "trial.c3d", tmp_path / "job", method="smoother")
    task = task.model_copy(update={"recording": task.recording.model_copy(update={"plates": switches})})
    with pytest.raises(StridelabError) as refusal:
        estimate_com.run(task, tmp_path / "job", quiet)
    assert offers(known)["smoother"].reason == refusal.value.message


def test_a_mass_may_come_from_elsewhere() -> None:
    unweighed = facts(subject={}, mass_from_force_kg=None, windows_s=[(0.2, 0.8)])
    assert codes(unweighed) == ("mass-unknown", None)
    assert codes(unweighed, SubjectFields(mass_kg=60.0)) == (None, None)
    assert codes(unweighed, alone=False) == (None, None)
    assert codes(facts(subject={}, windows_s=[(0.2, 0.8)])) == (None, None)


def test_windows_that_another_mass_closed_are_no_refusal() -> None:
    """Where force is missing follows from the mass: one that is stated later may open the windows again."""
    remark = {"code": "force-missing", "message": "The plates carry less at 0.10 to 0.90 s."}
    for windows_s in ([], [(0.2, 0.5)]):
        closed = facts(windows_s=windows_s, warnings=[remark])
        assert codes(closed)[0] in {"no-measured-window", "window-too-short"}
        assert codes(closed, SubjectFields(mass_kg=70.0)) == (None, None)
    assert "0.10 to 0.90 s" in str(offers(facts(windows_s=[], warnings=[remark]))["smoother"].reason)


def test_plates_whose_unit_is_wrong_are_named() -> None:
    off = [plate.model_copy(update={"use": False}) for plate in facts().plates]
    remark = {"code": "cop-never-on-plate", "message": "Plate 1 is left out."}
    assert codes(facts(plates=off, warnings=[remark])) == ("cop-off-all-plates", None)
    assert codes(facts(plates=off)) == ("plates-switched-off", None)


@pytest.mark.parametrize("changes", [{"marker_set": None}, {"n_frames": 1, "duration_s": 0.01}, {"duration_s": 0.2}])
def test_some_recordings_no_method_takes(changes: dict[str, Any]) -> None:
    assert not any(offer.possible for offer in offers(facts(**changes)).values())


def test_nothing_is_refused_of_recordings_that_give_an_estimate(gait: Path, tmp_path: Path) -> None:
    for n, path in enumerate(sorted((gait / "rehazenter-adult-walking").rglob("*_C4_*.c3d"))[:4]):
        folder = tmp_path / str(n)
        task = estimate_task(path, folder, method="complementary")
        known = facts_of(examine_trial(task.recording, folder))
        estimate_com.run(task, folder, quiet)
        assert codes(known, NO_SUBJECT if known.subject.mass_kg is None else None) == (None, None), path.name


@pytest.mark.parametrize("static_stated", [False, True])
def test_exchanged_sides_are_known_before_any_job(static_stated: bool, tmp_path: Path) -> None:
    write_c3d(tmp_path / "trial.c3d", swapped(read_recording(SAMPLE / "recording.c3d")))
    known = facts_of(examine_trial(RecordingSource(file="trial.c3d", filename="trial.c3d"), tmp_path))
    made = estimate_offers(known, known.subject, no_other_mass_source=True, static_stated=static_stated)
    assert {offer.code for offer in made} == {"sides-swapped"}
    assert {offer.reason for offer in made} == {
        "Markers labelled right lie on the left: labels are swapped, or the axes of the file are mirrored."
    }
    whole = facts_of(examine_trial(RecordingSource(file="recording.c3d", filename="recording.c3d"), SAMPLE))
    assert all(offer.possible for offer in offers(whole).values())
