"""Markers among a file's points."""

from collections.abc import Sequence

from stridelab.recordings.files.metadata import model_frames, select_labels, without_prefix


def pick(labels: list[str], outputs: Sequence[str] = ()) -> dict[str, int]:
    return select_labels(labels, [10] * len(labels), outputs, ()).column


def test_prefix_up_to_the_last_colon() -> None:
    assert without_prefix("Lab:Person:LASI") == "LASI"
    assert without_prefix("r asis") == "r asis"
    assert pick(["S:LASI", "S:RASI"]) == {"LASI": 0, "RASI": 1}


def test_unlabelled_points_are_left_out() -> None:
    choice = select_labels(["*115", "LASI", "", "*", "Unlabeled 3", "uname"], [5] * 6, [], [])
    assert choice.column == {"LASI": 1, "uname": 5}
    assert [remark.code for remark in choice.remarks] == ["unlabelled-points"]


def test_of_two_columns_with_one_name_the_more_complete_one_is_used() -> None:
    choice = select_labels(["LASI", "LASI", "RASI"], [3, 9, 9], [], [])
    assert choice.column == {"LASI": 1, "RASI": 2}
    assert [remark.code for remark in choice.remarks] == ["duplicate-labels"]


def test_of_two_subjects_the_more_complete_one_is_used_and_none_is_named() -> None:
    labels = ["Anna:LASI", "Anna:RASI", "Berta:LASI", "Berta:RASI", "ball"]
    choice = select_labels(labels, [1, 1, 9, 9, 9], [], [])
    assert choice.column == {"LASI": 2, "RASI": 3, "ball": 4}
    (remark,) = choice.remarks
    assert remark.code == "several-subjects"
    assert "Anna" not in remark.message
    assert "Berta" not in remark.message


def test_markers_of_both_prefixes_of_one_person_are_used() -> None:
    """Body and cluster of one subject share no marker name."""
    assert set(pick(["body:LASI", "cluster:T1"])) == {"LASI", "T1"}


def test_angles_powers_forces_and_moments_are_no_positions() -> None:
    labels = [
        "LASI",
        "LHipAngles",
        "LHipPower",
        "LHipForce",
        "LHipMoment",
        "LNormalisedGRF",
        "PELAng",
        "LPelvisAnglesROT",
    ]
    assert list(pick(labels)) == ["LASI"]
    assert list(pick(["LASI", "LFETBA"], outputs=["LFETBA"])) == ["LASI"]


def test_outputs_of_models_are_positions_but_no_markers() -> None:
    labels = ["PELO", "PELA", "PELL", "PELP", "LASI", "CentreOfMass", "LHJC", "Extra"]
    choice = select_labels(labels, [9] * 8, [], ["Extra"])
    assert choice.outputs == {"PELO", "PELA", "PELL", "PELP", "CentreOfMass", "LHJC", "Extra"}
    assert "LASI" in choice.column


def test_four_labels_are_a_segment_frame_only_together() -> None:
    assert model_frames(["LTOE", "LTOO", "LTOA", "LTOL", "LTOP"]) == {"LTOO", "LTOA", "LTOL", "LTOP"}
    assert model_frames(["PELO", "PELA"]) == frozenset()


def test_cluster_markers_are_taken_for_oxford_points_only_beside_its_frames() -> None:
    assert select_labels(["LTIB1", "LANK"], [9, 9], [], []).outputs == frozenset()
    assert "LTIB1" in select_labels(["LTIB1", "LHDF0"], [9, 9], [], []).outputs
