"""Plates in other axes than the markers are turned if the centres of pressure then lie at the feet."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.recordings.file_axes import with_common_axes
from stridelab.recordings.files.c3d import read_c3d
from stridelab.recordings.force_plates import plate_wrench
from stridelab.recordings.reader import read_recording
from support.recordings.c3d_files import FLAT_CORNERS_MM, PlateChannels, write_file

N, RATE = 200, 10
TIME = np.linspace(0.0, 2.0, N * RATE)
LOAD_N = np.clip(3000.0 * np.minimum(TIME - 0.4, 1.6 - TIME), 0.0, 700.0)
FORCE_N = np.column_stack([0.06 * LOAD_N * np.sin(9 * TIME), 0.02 * LOAD_N, -LOAD_N])
"""In the axes of a plate whose z points down: what the foot does to it."""
COP_M = np.column_stack([0.06 * np.sin(2 * TIME), 0.02 * np.cos(3 * TIME), 0.0 * TIME])
SIGNALS = np.column_stack([-FORCE_N, -1000.0 * np.cross(COP_M, FORCE_N)])
BODY_MM = {"HEE": (-110, 40), "TOE": (90, 40), "ANK": (-70, 80), "KNE": (-20, 480), "ASI": (90, 950), "PSI": (-90, 970)}
"""Ahead of the middle and above the floor."""
UP_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns axes with z up into axes with y up; its inverse, into axes with y down."""
UP_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


def person(ahead_mm: float = 250.0, *, lying: bool = False) -> dict[str, np.ndarray]:
    """Right foot in the middle of the plate, left foot 25 cm beside it."""
    places = {
        side + name: np.array([ahead_mm + x, 200.0 + y, z]) for name, (x, z) in BODY_MM.items() for side, y in SIDES
    }
    if lying:
        places = {label: np.array([place[2] - 500.0, place[1], 320.0]) for label, place in places.items()}
    rng = np.random.default_rng(3)
    return {label: place + rng.normal(0.0, 1.0, (N, 3)) for label, place in places.items()}


SIDES = (("R", 0.0), ("L", 250.0))


def written(folder: Path, markers: dict[str, np.ndarray], turn: np.ndarray) -> Path:
    plate = PlateChannels(2, SIGNALS, corners_mm=FLAT_CORNERS_MM @ turn.T)
    return write_file(folder / "a.c3d", markers, plates=[plate])


def codes(path: Path) -> set[str]:
    return {remark.code for remark in read_recording(path).remarks}


@pytest.mark.parametrize("turn", [UP_Y, UP_Y.T, UP_X, UP_X.T])
def test_plates_with_another_vertical_are_turned_under_the_feet(tmp_path: Path, turn: np.ndarray) -> None:
    """An export with z upwards for the markers, and y or x, upwards or downwards, for the plates."""
    recording = read_recording(written(tmp_path, person(), np.eye(3)))
    assert "plate-axes-turned" not in {remark.code for remark in recording.remarks}
    turned = read_recording(written(tmp_path, person(), turn))
    assert turned.up_axis == "+z"
    assert "plate-axes-turned" in {remark.code for remark in turned.remarks}
    for name in ("corners_m", "force_n", "moment_nm"):
        np.testing.assert_allclose(
            getattr(turned.plates[0], name), getattr(recording.plates[0], name), atol=1e-6, err_msg=name
        )
    np.testing.assert_allclose(turned.markers_m["RHEE"], recording.markers_m["RHEE"])


def test_contacts_of_a_force_file_are_turned_too(tmp_path: Path) -> None:
    """A force file is y up by convention, and the markers beside it may not be."""
    raw = read_c3d(written(tmp_path, person(), UP_Y))
    (signals,) = raw.plates
    contact, _ = plate_wrench(signals, np.array([0.0, 1.0, 0.0]), raw.force_rate_hz)
    turned, up, remarks = with_common_axes(replace(raw, plates=(), contacts=(contact,)))
    assert (up, [remark.code for remark in remarks]) == ("+z", ["plate-axes-turned"])
    np.testing.assert_allclose(turned.contacts[0].corners_m, FLAT_CORNERS_MM / 1000.0, atol=1e-9)
    np.testing.assert_allclose(turned.contacts[0].force_n[:, 2], LOAD_N, atol=1e-6)


def test_a_person_who_lies_on_a_plate_is_not_turned(tmp_path: Path) -> None:
    path = written(tmp_path, person(lying=True), np.eye(3))
    assert read_recording(path).up_axis == "+z"
    assert codes(path) & {"plate-axes-turned", "plate-axes-differ"} == {"plate-axes-differ"}


def test_plates_away_from_the_feet_are_left_in_their_axes(tmp_path: Path) -> None:
    """Nothing shows how a plate is turned whose centre of pressure lies at no foot."""
    remarks = codes(written(tmp_path, person(ahead_mm=1500.0), UP_Y))
    assert remarks & {"plate-axes-turned", "plate-axes-differ"} == {"plate-axes-differ"}
