"""Plate types 1 to 4 against wrenches put together by hand; repair of ORIGIN, sign and zero."""

from pathlib import Path

import ezc3d
import numpy as np
import pytest

from stridelab.recordings.force_plates import find_tare, plate_axes, with_session_zeros
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import PlateSwitches, Recording
from stridelab.service.kinds.parse_upload import plate_info
from support.recordings.c3d_files import FLAT_CORNERS_MM, PlateChannels, write_file

N = 1000
CENTRE_M = np.array([0.25, 0.2, 0.0])
R = plate_axes(FLAT_CORNERS_MM / 1000.0)
LOADED = (np.arange(N) >= 300) & (np.arange(N) < 900)


def body_wrench() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force on the body, centre of pressure and free moment of a foot on the plate (world frame), half of the time."""
    t = np.linspace(0.0, 1.0, N)
    force = (
        np.column_stack([60.0 * np.sin(6 * t), 20.0 * np.cos(5 * t), 600.0 + 100.0 * np.sin(9 * t)]) * LOADED[:, None]
    )
    cop = CENTRE_M + np.column_stack([0.1 * np.sin(2 * t), 0.05 * np.cos(3 * t), np.zeros(N)])
    free = np.column_stack([np.zeros(N), np.zeros(N), 3.0 * np.sin(4 * t)]) * LOADED[:, None]
    return force, cop, free


def markers(height_mm: float = 900.0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    return {
        f"M{i}": np.array([250.0, 200.0, height_mm]) + rng.normal(0, 300.0, 3) + np.zeros((100, 3)) for i in range(8)
    }


def in_plate_axes(force: np.ndarray, moment_at_centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return force @ R, moment_at_centre @ R


def type2_channels(origin_mm: np.ndarray) -> np.ndarray:
    """What a sensor reads whose surface centre is at ``origin_mm`` from it: F, and M_s = M_c + o x F."""
    force, cop, free = body_wrench()
    F, M_c = in_plate_axes(force, np.cross(cop - CENTRE_M, force) + free)
    return np.column_stack([F, 1000.0 * (M_c + np.cross(origin_mm / 1000.0, F))])


def check(recording: Recording, tolerance: float = 1e-4) -> None:
    force, cop, free = body_wrench()
    (plate,) = recording.plates
    np.testing.assert_allclose(plate.force_n, force, atol=tolerance)
    np.testing.assert_allclose(plate.moment_nm, np.cross(cop, force) + free, atol=tolerance)


def codes(recording: Recording) -> set[str]:
    return {remark.code for remark in recording.remarks}


def test_type_2_is_force_and_moment_about_its_origin(tmp_path: Path) -> None:
    origin = np.array([1.0, -2.0, -40.0])
    plate = PlateChannels(2, type2_channels(origin), origin_mm=tuple(origin))
    check(read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate])))


def test_an_offset_of_the_moments_is_corrected_by_its_switch(tmp_path: Path) -> None:
    """The sensor is 5 mm aside and 60 mm deeper than the file states, in the axes of the recording."""
    deeper = np.array([0.005, 0.0, -0.06])
    sensor = R.T @ -deeper
    plate = PlateChannels(2, type2_channels(1000.0 * sensor), origin_mm=(0.0, 0.0, 0.0))
    path = write_file(tmp_path / "a.c3d", markers(), plates=[plate])
    offset_m = (deeper[0], deeper[1], deeper[2])
    check(read_recording(path, plate_switches={1: PlateSwitches(moment_offset_m=offset_m)}))
    (plain,) = read_recording(path).plates
    (corrected,) = read_recording(path, plate_switches={1: PlateSwitches(moment_offset_m=offset_m)}).plates
    assert np.abs(plain.moment_nm - corrected.moment_nm).max() > 1.0


def test_type_1_is_force_centre_of_pressure_and_free_moment(tmp_path: Path) -> None:
    force, cop, free = body_wrench()
    F, T = in_plate_axes(force, free)
    p = 1000.0 * (cop - CENTRE_M) @ R
    plate = PlateChannels(1, np.column_stack([F, p[:, :2], 1000.0 * T[:, 2]]))
    check(read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate])))


def test_type_3_sums_four_sensors(tmp_path: Path) -> None:
    """Truth by adding r x F over the corner sensors, 53 mm below the surface."""
    rng = np.random.default_rng(2)
    a, b, depth = 0.21, 0.15, 0.053
    eight = np.abs(rng.normal(0.0, 10.0, (N, 8))) * LOADED[:, None]
    eight[:, 4:] *= -20.0
    x12, x34, y14, y23, *z = eight.T
    positions = [(a, b, 0.0), (-a, b, 0.0), (-a, -b, 0.0), (a, -b, 0.0)]
    zero = np.zeros(N)
    forces = [np.column_stack([zero, zero, z[k]]) for k in range(4)]
    total = sum(forces) + np.column_stack([x12 + x34, y14 + y23, zero])
    moment = sum(np.cross(position, force) for position, force in zip(positions, forces, strict=True))
    moment = moment + np.cross((0.0, b, 0.0), np.column_stack([x12, zero, zero]))
    moment += np.cross((0.0, -b, 0.0), np.column_stack([x34, zero, zero]))
    moment += np.cross((a, 0.0, 0.0), np.column_stack([zero, y14, zero]))
    moment += np.cross((-a, 0.0, 0.0), np.column_stack([zero, y23, zero]))
    at_surface = moment - np.cross((0.0, 0.0, -depth), total)
    plate = PlateChannels(3, eight, origin_mm=(1000 * a, 1000 * b, -1000 * depth))
    (read,) = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate])).plates
    world = total @ R.T
    np.testing.assert_allclose(read.force_n, world, atol=1e-4)
    np.testing.assert_allclose(read.moment_nm, at_surface @ R.T + np.cross(CENTRE_M, world), atol=1e-4)


def test_type_4_has_a_calibration_matrix(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    matrix = np.diag([2.0, 3.0, 4.0, 500.0, 600.0, 700.0]) + rng.normal(0.0, 0.05, (6, 6))
    raw = type2_channels(np.array([0.0, 0.0, -30.0])) @ np.linalg.inv(matrix).T
    plate = PlateChannels(4, raw, origin_mm=(0.0, 0.0, -30.0), calibration=matrix)
    check(read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate])), tolerance=2e-3)


def test_type_4_matrix_stored_by_row(tmp_path: Path) -> None:
    matrix = np.diag([2.0, 3.0, 4.0, 500.0, 600.0, 700.0])
    matrix[0, 1] = 0.3
    raw = type2_channels(np.zeros(3)) @ np.linalg.inv(matrix).T
    plate = PlateChannels(4, raw, calibration=matrix.T)
    extra = {("FORCE_PLATFORM", "MATRIX_STORE"): ["BYROW"]}
    check(read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate], parameters=extra)), tolerance=2e-3)


@pytest.mark.parametrize(("kind", "width"), [(2, 6), (3, 8), (4, 6)])
def test_types_agree_with_ezc3d(kind: int, width: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    signals = rng.normal(0.0, 40.0, (N, width)) * LOADED[:, None]
    signals[:, 2 if kind != 3 else 4] -= 600.0 * LOADED
    matrix = np.eye(6) + rng.normal(0.0, 0.1, (6, 6)) if kind == 4 else None
    plate = PlateChannels(kind, signals, origin_mm=(120.0, 90.0, -40.0), calibration=matrix)
    path = write_file(tmp_path / "a.c3d", markers(), plates=[plate])
    other = ezc3d.c3d(str(path), extract_forceplat_data=True)["data"]["platform"][0]
    from stridelab.recordings.files.c3d import read_c3d

    (read,) = read_c3d(path).plates
    force = other["force"].T
    np.testing.assert_allclose(read.force_n @ R.T, force, atol=1e-9)
    at_centre = (read.moment_nm - np.cross(read.origin_m, read.force_n)) @ R.T
    np.testing.assert_allclose(at_centre, other["moment"].T / 1000.0, atol=1e-9)


def test_moments_in_newton_metres(tmp_path: Path) -> None:
    signals = type2_channels(np.zeros(3))
    signals[:, 3:] /= 1000.0
    path = write_file(tmp_path / "a.c3d", markers(), plates=[PlateChannels(2, signals)], moment_unit="Nm")
    check(read_recording(path))


def test_origin_written_upside_down_is_turned_whole(tmp_path: Path) -> None:
    """Vicon writes the vector from the surface to the sensor: z positive, x and y with it."""
    origin = np.array([15.0, -12.0, -40.0])
    plate = PlateChannels(2, type2_channels(origin), origin_mm=tuple(-origin))
    check(read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate])))


def test_origin_of_a_treadmill_corner_is_decided_by_the_centre_of_pressure(tmp_path: Path) -> None:
    """Moments about a corner, ORIGIN negated, z = 0: nothing but the COP tells."""
    origin = np.array([-241.0, -180.0, 0.0])
    plate = PlateChannels(2, type2_channels(origin), origin_mm=tuple(-origin))
    recording = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate]))
    assert "plate-origin-negated" in codes(recording)
    check(recording)


def test_right_origin_of_a_corner_is_not_changed(tmp_path: Path) -> None:
    origin = np.array([-241.0, -180.0, 0.0])
    plate = PlateChannels(2, type2_channels(origin), origin_mm=tuple(origin))
    recording = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate]))
    assert "plate-origin-negated" not in codes(recording)
    check(recording)


def test_plate_turned_by_180_degrees(tmp_path: Path) -> None:
    """The corners' order is the plate's rotation: the same channels on a turned plate push the other way."""
    plate = PlateChannels(2, type2_channels(np.zeros(3)))
    turned = PlateChannels(2, plate.signals, corners_mm=np.roll(FLAT_CORNERS_MM, 2, axis=0))
    (a,) = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate])).plates
    (b,) = read_recording(write_file(tmp_path / "b.c3d", markers(), plates=[turned])).plates
    np.testing.assert_allclose(a.force_n * [-1, -1, 1], b.force_n, atol=1e-6)


def test_channels_with_the_opposite_sign_are_turned(tmp_path: Path) -> None:
    plate = PlateChannels(2, -type2_channels(np.zeros(3)))
    recording = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate]))
    assert "plate-sign-reversed" in codes(recording)
    check(recording)


def test_tare_is_subtracted(tmp_path: Path) -> None:
    offset = np.array([3.0, -2.0, -17.0, 400.0, -300.0, 50.0])
    plate = PlateChannels(2, type2_channels(np.zeros(3)) + offset)
    recording = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate]))
    assert "plate-tared" in codes(recording)
    assert recording.plates[0].tare_force_n[2] == pytest.approx(17.0)
    check(recording)


def test_large_offset_is_subtracted_where_the_file_names_the_empty_samples(tmp_path: Path) -> None:
    """FORCE_PLATFORM:ZERO = [1 10] in files that were recorded expecting it."""
    offset = np.array([0.0, 0.0, 250.0, 0.0, 0.0, 0.0])
    plate = PlateChannels(2, type2_channels(np.zeros(3)) + offset)
    check(read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate], zero=(1, 10))))


def test_plate_that_is_never_unloaded_is_not_tared(tmp_path: Path) -> None:
    standing = np.tile([0.0, 0.0, -650.0, 0.0, 0.0, 0.0], (N, 1))
    recording = read_recording(
        write_file(tmp_path / "a.c3d", markers(), plates=[PlateChannels(2, standing)], zero=(1, 10))
    )
    assert "tare-refused" in codes(recording)
    assert recording.plates[0].force_n[:, 2].mean() == pytest.approx(650.0)


OFFSET = np.array([2.0, -1.5, -12.0, 400.0, 900.0, -300.0])
"""What the channels of a plate read unloaded, in N and N mm; its z axis points down."""


def test_another_trial_of_the_session_gives_the_zero_of_a_plate(tmp_path: Path) -> None:
    origin = np.array([1.0, -2.0, -40.0])
    true = type2_channels(origin)
    loaded = np.tile(true[500], (N, 1))
    read = {}
    for name, signals in {"walk": true + OFFSET, "static": loaded + OFFSET, "exact": loaded}.items():
        channels = PlateChannels(2, signals, origin_mm=tuple(origin))
        read[name] = read_recording(write_file(tmp_path / f"{name}.c3d", markers(), plates=[channels]))
    walk = plate_info(read["walk"].plates[0], 1000.0)
    assert walk.zero is not None
    assert plate_info(read["static"].plates[0], 1000.0).zero is None
    zeroed = with_session_zeros(read["static"], {1: walk.zero})
    (plate,), (exact,) = zeroed.plates, read["exact"].plates
    assert abs(read["static"].plates[0].force_n[0, 2] - exact.force_n[0, 2]) > 10.0
    np.testing.assert_allclose(plate.force_n, exact.force_n, atol=1e-3)
    np.testing.assert_allclose(plate.moment_nm, exact.moment_nm, atol=1e-3)
    assert plate.zero_is_known
    assert next(remark.message for remark in zeroed.remarks if remark.code == "tare-from-session").startswith(
        "Plate 1 reads +12.0 N unloaded"
    )
    assert with_session_zeros(read["walk"], {1: [1.0] * 6}).plates == read["walk"].plates, "it has its own zero"


def test_tare_ignores_a_light_brush() -> None:
    """A foot that brushes the plate for 30 samples does not move the zero."""
    force = np.zeros((N, 3))
    force[:, 2] = 5.0 + 600.0 * LOADED
    force[100:130, 2] += 30.0
    tare = find_tare(force, np.zeros((N, 3)), force[:, 2], None, 1000.0)
    assert not tare.never_unloaded
    assert tare.force_n[2] == pytest.approx(5.0)


@pytest.mark.parametrize("rate_hz", [240.0, 300.0, 1000.0])
def test_the_flights_of_a_run_show_the_zero_of_a_treadmill(rate_hz: float) -> None:
    """Flights of 0.1 s are 24 samples at 240 Hz."""
    time_s = np.arange(round(6.0 * rate_hz)) / rate_hz
    force = np.zeros((len(time_s), 3))
    force[:, 2] = 17.0 + 1500.0 * np.maximum(np.sin(np.pi * ((time_s % 0.36) / 0.26)), 0.0) * (time_s % 0.36 < 0.26)
    tare = find_tare(force, np.zeros_like(force), force[:, 2], None, rate_hz)
    assert not tare.never_unloaded
    assert tare.force_n[2] == pytest.approx(17.0, abs=1.0)


@pytest.mark.parametrize(
    ("corners", "reason"),
    [
        (np.zeros((4, 3)), "long"),
        (FLAT_CORNERS_MM[[0, 2, 1, 3]], "rectangle"),
        (np.full((4, 3), np.nan), "numbers"),
    ],
)
def test_garbage_corners_leave_the_plate_out(corners: np.ndarray, reason: str, tmp_path: Path) -> None:
    plate = PlateChannels(2, type2_channels(np.zeros(3)), corners_mm=corners)
    recording = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate]))
    assert recording.plates == ()
    (remark,) = [remark for remark in recording.remarks if remark.code == "plate-unusable"]
    assert reason in remark.message


def test_unknown_plate_type_is_left_out(tmp_path: Path) -> None:
    plate = PlateChannels(7, type2_channels(np.zeros(3)))
    recording = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate]))
    assert recording.plates == ()
    assert "plate-unusable" in codes(recording)


def test_a_plate_with_missing_channels_is_left_out(tmp_path: Path) -> None:
    plate = PlateChannels(2, type2_channels(np.zeros(3)))
    extra = {("FORCE_PLATFORM", "CHANNEL"): np.arange(4, 10)[:, None]}
    recording = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[plate], parameters=extra))
    assert "plate-unusable" in codes(recording)


@pytest.mark.parametrize("value", [1e30, -np.inf])
def test_a_plate_with_a_damaged_channel_is_left_out(value: float, tmp_path: Path) -> None:
    channels = type2_channels(np.zeros(3))
    channels[7, 2] = value
    recording = read_recording(write_file(tmp_path / "a.c3d", markers(), plates=[PlateChannels(2, channels)]))
    assert recording.plates == ()
    (remark,) = [remark for remark in recording.remarks if remark.code == "plate-unusable"]
    assert "impossible" in remark.message
