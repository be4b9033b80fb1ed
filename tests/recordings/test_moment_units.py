"""The unit of the plates' moments: the centre of pressure decides, and a plate that no unit explains is left out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.recordings.force_windows import require_windows
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import PlateSwitches, Recording
from support.recordings.c3d_files import FLAT_CORNERS_MM, PlateChannels, write_file

N = 1000
LOADED = ((np.arange(N) >= 300) & (np.arange(N) < 900)).astype(float)
TIME = np.linspace(0.0, 1.0, N)
FORCE_N = np.column_stack([40.0 * np.sin(6 * TIME), 20.0 * np.cos(5 * TIME), -650.0 - 90.0 * np.sin(9 * TIME)])
FORCE_N *= LOADED[:, None]
"""In the plate's axes, whose z points down."""
COP_M = np.column_stack([0.12 * (TIME - 0.6), 0.05 * np.cos(3 * TIME), np.zeros(N)])
"""In the plate's axes, from the middle of its surface: a foot rolls over."""
DEEP_M = np.array([0.001, -0.002, -0.04])
MOMENT_NM = np.cross(COP_M, FORCE_N) + np.cross(DEEP_M, FORCE_N)


BESIDE_MM = FLAT_CORNERS_MM + np.array([600.0, 0.0, 0.0])
"""Corners of a second plate."""


def markers() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    place = np.array([250.0, 200.0, 900.0])
    return {f"M{i}": place + rng.normal(0, 300.0, 3) + np.zeros((100, 3)) for i in range(8)}


def plate(per_nm: float, corners_mm: np.ndarray = FLAT_CORNERS_MM, share: float = 1.0) -> PlateChannels:
    signals = share * np.column_stack([FORCE_N, per_nm * MOMENT_NM])
    return PlateChannels(2, signals, corners_mm=corners_mm, origin_mm=tuple(1000.0 * DEEP_M))


def read(folder: Path, stated: str, *plates: PlateChannels, **options: object) -> Recording:
    return read_recording(write_file(folder / "a.c3d", markers(), plates=plates, moment_unit=stated), **options)


def codes(recording: Recording) -> list[str]:
    return [remark.code for remark in recording.remarks]


def pressure_m(recording: Recording, index: int = 0) -> np.ndarray:
    one = recording.plates[index]
    f, nu = one.force_n[400:800], one.moment_nm[400:800]
    return np.column_stack([-nu[:, 1], nu[:, 0]]) / f[:, 2:]


@pytest.mark.parametrize(
    ("stated", "per_nm", "corrected"),
    [("Nm", 1.0, False), ("Nmm", 1e3, False), ("Nm", 1e3, True), ("Nmm", 1.0, True), ("N.m", 1e3, True)],
)
def test_the_centre_of_pressure_decides_the_unit(tmp_path: Path, stated: str, per_nm: float, corrected: bool) -> None:
    recording = read(tmp_path, stated, plate(per_nm))
    middle_m = FLAT_CORNERS_MM.mean(axis=0)[:2] / 1000.0
    true_m = middle_m + COP_M[400:800, :2] * [-1.0, 1.0]
    np.testing.assert_allclose(pressure_m(recording), true_m, atol=1e-4)
    assert ("moment-unit-corrected" in codes(recording)) == corrected


def test_the_remark_says_which_unit_and_why(tmp_path: Path) -> None:
    (remark,) = [r for r in read(tmp_path, "Nm", plate(1e3)).remarks if r.code == "moment-unit-corrected"]
    assert "in Nm; N mm is used" in remark.message
    assert "100%" in remark.message
    assert "0%" in remark.message


def test_an_unused_plate_gets_the_unit_of_the_others(tmp_path: Path) -> None:
    """Its noise of 2 N mm would else be one of 2 Nm."""
    idle = plate(1.0, BESIDE_MM, share=0.0)
    noise = np.random.default_rng(3).normal(0.0, 2.0, idle.signals.shape)
    recording = read(tmp_path, "Nm", plate(1e3), replace(idle, signals=noise))
    other = recording.plates[1]
    about_middle = other.moment_nm - np.cross(other.corners_m.mean(axis=0), other.force_n)
    assert float(np.std(about_middle[:, 2])) < 0.02


def test_a_plate_that_no_unit_explains_is_left_out_and_cannot_be_switched_on(tmp_path: Path) -> None:
    """The second plate's corners are 3 m from where it is: the moments about its own sensor are those of the first."""
    wrong = plate(1e3)
    wrong.signals[:, 3:5] += 3000.0 * wrong.signals[:, [2]]
    recording = read(tmp_path, "Nmm", plate(1e3), replace(wrong, corners_mm=BESIDE_MM))
    assert [one.use for one in recording.plates] == [True, False]
    (remark,) = [r for r in recording.remarks if r.code == "cop-never-on-plate"]
    assert remark.message.startswith("Plate 2 was left out")
    alone = read(tmp_path, "Nmm", wrong, plate_switches={1: PlateSwitches(use=True)})
    assert not alone.plates[0].use
    with pytest.raises(NotEstimable) as refusal:
        require_windows(alone, {})
    assert refusal.value.code == "cop-off-all-plates"
    assert "Plate 1" in refusal.value.faults[0].message
