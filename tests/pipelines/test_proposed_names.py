"""A walk of unknown labels that are named by likeness and place: estimated, and never with a good verdict."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recordings.test_proposed_set import WORDS, side_and_name
from stridelab.errors import NotEstimable
from stridelab.pipelines.estimate_com import ComResult, estimate_com
from stridelab.pipelines.session_values import TrialFacts, select_static_trial, session_values
from stridelab.pipelines.trial import examine_trial
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.marker_sets import PROPOSED, identify
from stridelab.recordings.recording import Recording
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.marker_sets import SourceMarkerSet
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.kinds.parse_upload import recording_facts
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.command_line import quiet


@pytest.fixture(scope="module")
def known_labels() -> Recording:
    """A walk over two plates with labels of a shipped set, of which only the landmarks of ``WORDS`` are marked."""
    made = record(HumanWalker(mass_kg=72.0, duration_s=3.0, seed=4).walk(), MeasurementNoise(), 4, lab="two_plates")
    landmarks = identify(tuple(made.recording.markers_m)).landmarks
    kept = [label for mark, label in landmarks.items() if side_and_name(mark)[1] in WORDS]
    return replace(made.recording, carried={}, markers_m={label: made.recording.markers_m[label] for label in kept})


@pytest.fixture(scope="module")
def unknown_labels(known_labels: Recording) -> Recording:
    """The same walk with labels that no set knows."""
    words = {"l": "_Left", "r": "_Right", "": ""}
    marks = {label: mark for mark, label in identify(tuple(known_labels.markers_m)).landmarks.items()}
    names = {label: WORDS[side_and_name(mark)[1]] + words[side_and_name(mark)[0]] for label, mark in marks.items()}
    assert identify(tuple(names.values())).name is None
    return replace(known_labels, markers_m={names[label]: track for label, track in known_labels.markers_m.items()})


def estimate_recording(folder: Path, recording: Recording, **source: object) -> ComResult:
    folder.mkdir()
    write_c3d(folder / "trial", recording)
    stated = RecordingSource.model_validate({"file": "trial", "filename": "walk.c3d", **source})
    return estimate_com(EstimateComTask(recording=stated, input=EstimateComInput(recording_id="r")), folder, quiet)


def test_the_result_is_that_of_the_known_labels_and_is_doubted(
    known_labels: Recording, unknown_labels: Recording, tmp_path: Path
) -> None:
    named, proposed = (
        estimate_recording(tmp_path / "known", known_labels),
        estimate_recording(tmp_path / "strange", unknown_labels),
    )
    assert np.nanmax(np.linalg.norm(named.estimate.com_m - proposed.estimate.com_m, axis=1)) < 0.005
    assert named.summary.quality is not None
    assert proposed.summary.quality is not None
    assert (named.summary.quality.verdict, proposed.summary.quality.verdict) == ("good", "doubtful")
    assert [check.name for check in proposed.summary.quality.checks if not check.passed] == ["proposed_names"]
    codes = {remark.code: remark.message for remark in proposed.summary.warnings}
    assert "l_knee_lateral KneeLatPt_Left" in codes["marker-set-proposed"]
    assert "the names are not checked" in codes["doubtful"]
    assert proposed.summary.proposed_names["l_knee_lateral"] == "KneeLatPt_Left"
    assert named.summary.proposed_names == {}
    assert "marker-set-proposed" not in {remark.code for remark in named.summary.warnings}


def test_names_that_a_user_confirms_are_not_doubted(unknown_labels: Recording, tmp_path: Path) -> None:
    names = estimate_recording(tmp_path / "proposed", unknown_labels).summary.proposed_names
    summary = estimate_recording(tmp_path / "confirmed", unknown_labels, marker_map=names).summary
    assert summary.quality is not None
    assert summary.quality.verdict == "good"
    assert summary.proposed_names == {}


def test_a_user_who_names_markers_is_not_overruled(unknown_labels: Recording, tmp_path: Path) -> None:
    """Neither beside a map, even an incomplete one, nor where a user's set alone is to be used."""
    with pytest.raises(NotEstimable) as refused:
        estimate_recording(tmp_path / "map", unknown_labels, marker_map={"c7": "NeckC7"})
    assert refused.value.code == "unknown-marker-set"
    own = SourceMarkerSet(name="lab", landmarks={"l_asis": "A", "r_asis": "B"}, required=["l_asis"])
    with pytest.raises(NotEstimable) as refused:
        estimate_recording(tmp_path / "set", unknown_labels, marker_sets=[own], shipped_sets=False)
    assert refused.value.code == "unknown-marker-set"


def test_a_static_trial_is_not_named_by_a_proposal(unknown_labels: Recording, tmp_path: Path) -> None:
    write_c3d(tmp_path / "trial", unknown_labels)
    source = RecordingSource(file="trial", filename="walk.c3d")
    assert examine_trial(source, tmp_path).match.name == PROPOSED
    assert examine_trial(source, tmp_path, propose=False).match.name is None


def test_other_trials_take_nothing_from_proposed_names(
    known_labels: Recording, unknown_labels: Recording, tmp_path: Path
) -> None:
    facts = []
    for name, recording in (("known", known_labels), ("other", known_labels), ("strange", unknown_labels)):
        write_c3d(tmp_path / name, recording)
        read = recording_facts(examine_trial(RecordingSource(file=name, filename=name), tmp_path))
        facts.append(TrialFacts(recording_id=name, filename=name, sha256=name, facts=read))
    own, other, proposed = facts
    assert proposed.facts.marker_set == PROPOSED
    assert session_values("s", own, [other]) is not None
    assert session_values("s", own, [proposed]) is None
    assert session_values("s", proposed, [own]) is not None
    still = replace(proposed, facts=proposed.facts.model_copy(update={"still": True}))
    assert select_static_trial(own, [still]) is None
