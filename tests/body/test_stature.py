"""The stature in a file against the legs: another person's data, or another unit, are named and not used."""

from dataclasses import replace

import pytest

from stridelab.body.segment_model import without_foreign_subject
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Recording, Subject
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise


def walk(height_m: float = 1.75) -> Recording:
    walker = HumanWalker(height_m, 70.0, "male", speed_m_s=1.2, duration_s=1.0, seed=1).walk()
    return record(walker, MeasurementNoise(), 1, lab="walkway").recording


@pytest.mark.parametrize(
    ("stated_m", "is_used"), [(1.75, True), (1.5, True), (2.0, True), (0.95, False), (2.6, False), (None, True)]
)
def test_a_height_that_the_legs_contradict_is_not_used(stated_m: float | None, is_used: bool) -> None:
    subject = Subject(stated_m, 33.0, "female", 7.0)
    recording = replace(walk(), subject=subject)
    checked = without_foreign_subject(recording, identify(list(recording.markers_m)).landmarks)
    assert checked.subject == (subject if is_used else Subject())
    remarks = [remark for remark in checked.remarks if remark.code == "subject-of-another-body"]
    assert len(remarks) == (not is_used)
    for remark in remarks:
        assert (
            f"a subject of {stated_m:.2f} m and 33 kg, and its markers show the legs of a person of" in remark.message
        )


@pytest.mark.parametrize("height_m", [1.0, 1.4, 2.0])
def test_children_and_tall_people_have_the_legs_of_their_height(height_m: float) -> None:
    recording = replace(walk(height_m), subject=Subject(height_m))
    assert without_foreign_subject(recording, identify(list(recording.markers_m)).landmarks) is recording


def test_without_legs_nothing_is_compared() -> None:
    recording = replace(walk(), subject=Subject(0.5))
    assert without_foreign_subject(recording, {}) is recording
