"""Trials of an OpenSim model: model, joint angles and forces in a zip, against the closed form of a rocking human."""

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from stridelab.errors import UnreadableFile
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording
from support.recordings.body_model_files import (
    MASS_KG,
    RATE_HZ,
    human_links,
    model_text,
    rocking_angles,
    rocking_com_m,
    rocking_forces,
    rocking_members,
    storage_text,
    write_zip,
)
from support.recordings.fuzzing import trc_text

MEMBERS = rocking_members(2.0)
TIME = np.arange(200) / RATE_HZ
ANGLES = rocking_angles(TIME)


def read(folder: Path, changes: Mapping[str, str | None] = MappingProxyType({})) -> Recording:
    members = {name: text for name, text in {**MEMBERS, **changes}.items() if text is not None}
    return read_recording(write_zip(folder / "trial.zip", members))


def com_m(recording: Recording) -> np.ndarray:
    """Centre of mass of the segments, turned back to y up."""
    com = np.sum([s.mass_kg * s.com_m for s in recording.segments.values()], axis=0) / MASS_KG
    return np.column_stack([com[:, 0], com[:, 2], -com[:, 1]])


def codes(recording: Recording) -> set[str]:
    return {remark.code for remark in recording.remarks}


def test_the_segments_give_the_centre_of_mass(tmp_path: Path) -> None:
    recording = read(tmp_path)
    np.testing.assert_allclose(com_m(recording), rocking_com_m(TIME), atol=1e-9)
    assert recording.subject.mass_kg == MASS_KG
    assert set(recording.markers_m) == {link.body for link in human_links()}
    np.testing.assert_allclose(recording.markers_m["calcn_r"][0], [-0.12, -0.09, 0.04], atol=1e-9)
    assert (recording.up_axis, recording.marker_rate_hz, recording.force_rate_hz) == ("+y", RATE_HZ, 500.0)
    np.testing.assert_allclose(recording.plates[0].force_n[:, 2].mean(), 9.81 * MASS_KG, rtol=0.02)
    assert "body-model" in codes(recording)
    assert not codes(recording) & {"coordinates-missing", "unit-corrected", "resampled", "no-force-file"}


def in_degrees(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {
        name: track if name == "time" or (name.startswith("pelvis_t") and name != "pelvis_tilt") else np.degrees(track)
        for name, track in columns.items()
    }


@pytest.mark.parametrize("header", ["Coordinates\ninDegrees=yes\n", "name a\ndatacolumns 20\n", "inDegrees = Yes\n"])
def test_angles_in_degrees_by_the_header(tmp_path: Path, header: str) -> None:
    recording = read(tmp_path, {"rocking_ik.mot": storage_text(in_degrees(ANGLES), header=header)})
    np.testing.assert_allclose(com_m(recording), rocking_com_m(TIME), atol=1e-9)
    assert "unit-corrected" not in codes(recording)


@pytest.mark.parametrize("header", ["Coordinates\ninDegrees=no\n", "Coordinates\n"])
def test_angles_that_no_joint_can_have_are_degrees_whatever_the_header_states(tmp_path: Path, header: str) -> None:
    recording = read(tmp_path, {"rocking_ik.mot": storage_text(in_degrees(ANGLES), header=header)})
    np.testing.assert_allclose(com_m(recording), rocking_com_m(TIME), atol=1e-9)
    assert "unit-corrected" in codes(recording)


def test_states_of_opensim_4_name_the_path_of_each_coordinate(tmp_path: Path) -> None:
    states = {"time": TIME}
    for name, track in ANGLES.items():
        if name != "time":
            states |= {f"/jointset/j/{name}/value": track, f"/jointset/j/{name}/speed": 99.0 + 0 * TIME}
    recording = read(tmp_path, {"rocking_ik.mot": None, "states.sto": storage_text(states)})
    np.testing.assert_allclose(com_m(recording), rocking_com_m(TIME), atol=1e-9)


def test_speeds_beside_the_angles_are_not_taken_for_angles(tmp_path: Path) -> None:
    speeds = storage_text(ANGLES, header="Speeds\n")
    np.testing.assert_allclose(com_m(read(tmp_path, {"u.sto": speeds})), rocking_com_m(TIME), atol=1e-9)


def test_uneven_times_are_interpolated(tmp_path: Path) -> None:
    uneven = np.sort(np.concatenate([TIME, TIME[50:90] + 0.004]))
    recording = read(tmp_path, {"rocking_ik.mot": storage_text(rocking_angles(uneven)), "rocking_grf.mot": None})
    np.testing.assert_allclose(com_m(recording), rocking_com_m(recording.time_s), atol=1e-4)
    assert {"resampled", "no-force-file"} <= codes(recording)


def test_a_coordinate_without_values_keeps_its_default_with_a_remark(tmp_path: Path) -> None:
    fewer = {name: track for name, track in ANGLES.items() if name != "knee_angle_r"}
    recording = read(tmp_path, {"rocking_ik.mot": storage_text(fewer)})
    np.testing.assert_allclose(com_m(recording), rocking_com_m(TIME), atol=1e-9)
    assert any("knee_angle_r" in r.message for r in recording.remarks if r.code == "coordinates-missing")


def test_external_loads_name_the_columns_of_the_forces(tmp_path: Path) -> None:
    force_s = np.arange(0.0, 2.0, 0.002)
    renamed = {
        name.replace("ground_force_v", "FP1_F").replace("ground_force_p", "FP1_P"): track
        for name, track in rocking_forces(force_s).items()
    }
    loads = (
        '<?xml version="1.0"?><OpenSimDocument Version="40000"><ExternalLoads><objects><ExternalForce name="a">'
        "<applied_to_body>calcn_r</applied_to_body><force_identifier>FP1_F</force_identifier>"
        "<point_identifier>FP1_P</point_identifier><torque_identifier/></ExternalForce></objects></ExternalLoads>"
        "</OpenSimDocument>"
    )
    forces = storage_text(renamed, header="grf\n")
    read_here = read(tmp_path, {"rocking_grf.mot": forces, "loads.xml": loads})
    usual = read(tmp_path)
    np.testing.assert_allclose(read_here.plates[0].force_n, usual.plates[0].force_n, atol=1e-9)
    np.testing.assert_allclose(read_here.plates[0].moment_nm, usual.plates[0].moment_nm, atol=1e-9)
    assert not read(tmp_path, {"rocking_grf.mot": forces}).plates


def test_forces_of_a_part_cut_the_trial_to_the_common_time(tmp_path: Path) -> None:
    part = storage_text(rocking_forces(np.arange(0.5, 1.5, 0.002)), header="grf\n")
    recording = read(tmp_path, {"rocking_grf.mot": part})
    assert recording.n_frames == 101
    assert all(len(segment.com_m) == 101 for segment in recording.segments.values())
    np.testing.assert_allclose(com_m(recording)[0], rocking_com_m(np.array([0.5]))[0], atol=1e-9)
    assert "cut-to-common-time" in codes(recording)


def test_markers_beside_the_model_are_left_out_with_a_remark(tmp_path: Path) -> None:
    recording = read(tmp_path, {"walk.trc": trc_text()})
    assert "markers-not-used" in codes(recording)
    assert "M0" not in recording.markers_m


def test_a_model_without_angles_leaves_the_markers_to_be_read(tmp_path: Path) -> None:
    recording = read(tmp_path, {"walk.trc": trc_text(), "rocking_ik.mot": None, "rocking_grf.mot": None})
    assert not recording.segments
    assert "M0" in recording.markers_m


WITHOUT_HEIGHT = storage_text({name: track for name, track in ANGLES.items() if name != "pelvis_ty"})
DECREASING = storage_text(ANGLES | {"time": TIME[::-1]})
STANDING_STILL = storage_text(ANGLES | {"time": 0 * TIME})


@pytest.mark.parametrize(
    ("changes", "code", "why"),
    [
        ({"rocking_ik.mot": None}, "motion-missing", "subject.osim"),
        ({"other.osim": MEMBERS["subject.osim"]}, "zip-several-trials", "more than one OpenSim model"),
        ({"second.mot": MEMBERS["rocking_ik.mot"]}, "zip-several-trials", "more than one file of joint angles"),
        ({"grf2.mot": MEMBERS["rocking_grf.mot"]}, "zip-several-trials", "more than one file of ground forces"),
        ({"rocking_ik.mot": WITHOUT_HEIGHT}, "motion-incomplete", "no values of pelvis_ty"),
        ({"rocking_ik.mot": DECREASING}, "motion-broken", "no increasing time"),
        ({"rocking_ik.mot": STANDING_STILL}, "motion-broken", "do not increase"),
        ({"rocking_ik.mot": MEMBERS["rocking_ik.mot"] + "9.99\tmuch"}, "motion-broken", "line"),
        ({"subject.osim": MEMBERS["subject.osim"].replace("</Model>", "")}, "osim-broken", "well-formed"),
        ({"loads.xml": "<ExternalLoads><objects>"}, "external-loads-broken", "loads.xml"),
        ({"rocking_ik.mot": storage_text(rocking_angles(TIME + 50.0))}, "times-do-not-overlap", "50"),
    ],
)
def test_files_that_make_no_trial_are_refused_by_name(
    tmp_path: Path, changes: dict[str, str | None], code: str, why: str
) -> None:
    with pytest.raises(UnreadableFile, match=why) as refused:
        read(tmp_path, changes)
    assert refused.value.code == code


def test_a_body_without_mass_is_refused(tmp_path: Path) -> None:
    weightless = re.sub(r"<mass>[^<]*</mass>", "<mass>0</mass>", model_text(human_links()))
    with pytest.raises(UnreadableFile, match="no mass"):
        read(tmp_path, {"subject.osim": weightless})


@pytest.mark.parametrize(
    ("name", "content", "advice"),
    [
        ("subject.osim", MEMBERS["subject.osim"], "joint angles"),
        ("renamed.txt", MEMBERS["subject.osim"], "joint angles"),
        ("walk.mot", MEMBERS["rocking_ik.mot"], "into one zip with their model"),
        ("walk.b3d", "\x00\x01", "into one zip"),
        ("walk.mvn", "\x00\x01", "MVNX"),
    ],
)
def test_a_part_of_a_trial_alone_names_what_is_missing(tmp_path: Path, name: str, content: str, advice: str) -> None:
    (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(UnreadableFile, match=advice) as refused:
        read_recording(tmp_path / name)
    assert refused.value.code == "unknown-format"
