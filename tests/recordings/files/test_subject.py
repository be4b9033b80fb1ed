"""What a file says of the person."""

from stridelab.recordings.files.metadata import read_joint_widths_m, read_subject
from stridelab.recordings.recording import Subject


def test_the_subject_of_a_rehazenter_file_is_read() -> None:
    subject, remarks = read_subject({"age": 48.0, "gender": 0.0, "weight": 59.8, "height": 1.71, "R_legLength": 0.819})
    assert subject == Subject(1.71, 59.8, "female", 48.0)
    assert remarks == ()


def test_processing_group_is_in_millimetres() -> None:
    assert read_subject({"Bodymass": 85.0, "Height": 1679.0})[0] == Subject(1.679, 85.0)
    assert read_subject({"BodyMass": 67.0, "HEIGHT": 182.0})[0] == Subject(1.82, 67.0)


def test_placeholder_values_are_dropped_with_a_remark() -> None:
    subject, remarks = read_subject({"age": 99.0, "mass": 0.0, "height": -1.0})
    assert subject == Subject()
    assert [remark.code for remark in remarks] == ["filler-in-subject"] * 3


def test_gender_code_other_than_zero_or_one_is_unknown() -> None:
    assert read_subject({"gender": 2.0})[0].sex is None
    assert read_subject({"gender": 1.0})[0].sex == "male"


def test_joint_widths_are_in_millimetres_and_absurd_ones_are_left_out() -> None:
    stated = {"LKneeWidth": 124.0, "RAnkleWidth": 65.0, "LElbowWidth": 0.0, "LHandWidth": -17.9, "HipWidth": 123.8}
    assert read_joint_widths_m(stated) == {"l_knee": 0.124, "r_ankle": 0.065}
