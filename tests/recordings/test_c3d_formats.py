"""C3D files of every machine and number format, with lists of any length: each reads as the same recording."""

import struct
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
import pytest

from stridelab.errors import UnreadableFile
from stridelab.recordings.files.c3d_byte_orders import check_c3d
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording
from support.recordings.c3d_files import (
    PlateChannels,
    as_written_by,
    parameter_at,
    small_trial,
    with_integer_samples,
    with_parameter,
    write_file,
)

BLOCK = 512
STEPS_MM = (0.1, 0.05, 0.01, 0.02, 0.2, 0.3, 1 / 12, 0.125, 0.0625, 1.0)
"""Scales of points; those that are no power of two have any bits in their mantissa."""


def points(n_frames: int = 20) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(4)
    tracks = {f"M{i}": rng.uniform(-300.0, 300.0, (n_frames, 3)) for i in range(7)}
    tracks["M3"][:4] = np.nan  # at an end, where gaps are not filled
    return tracks


def float_file(folder: Path, **options: Any) -> bytes:
    """An Intel float file with a plate whose signals are whole counts."""
    signals = np.random.default_rng(5).integers(-900, 900, (200, 6)).astype(float)
    extra = {("ANALOG", "FORMAT"): ["SIGNED  "], ("POINT", "SCALE"): [-0.1]} | options.pop("parameters", {})
    path = write_file(folder / "float.c3d", points(), plates=[PlateChannels(2, signals)], parameters=extra, **options)
    return path.read_bytes()


def read(folder: Path, content: bytes) -> Recording:
    (folder / "made.c3d").write_bytes(content)
    return read_recording(folder / "made.c3d")


def assert_same(recording: Recording, expected: Recording, within_m: float) -> None:
    assert set(recording.markers_m) == set(expected.markers_m)
    for label, track in expected.markers_m.items():
        np.testing.assert_allclose(recording.markers_m[label], track, atol=within_m)
    assert recording.force_rate_hz == expected.force_rate_hz
    for plate, expected_plate in zip(recording.plates, expected.plates, strict=True):
        np.testing.assert_allclose(plate.force_n, expected_plate.force_n, atol=1e-3)


@pytest.mark.parametrize("step_mm", STEPS_MM)
@pytest.mark.parametrize("machine", ["intel", "dec", "sgi"])
def test_integer_files_of_every_scale_and_machine(machine: str, step_mm: float, tmp_path: Path) -> None:
    content = float_file(tmp_path)
    whole = with_integer_samples(content, step_mm)
    assert len(whole) < 0.6 * len(content) + 4 * BLOCK
    recording = read(tmp_path, as_written_by(machine, whole))
    assert_same(recording, read(tmp_path, content), 0.51e-3 * step_mm)
    assert np.isnan(recording.markers_m["M3"]).sum() == np.isnan(read(tmp_path, content).markers_m["M3"]).sum()


@pytest.mark.parametrize("machine", ["dec", "sgi"])
def test_float_files_of_other_machines(machine: str, tmp_path: Path) -> None:
    content = float_file(tmp_path)
    assert_same(read(tmp_path, as_written_by(machine, content)), read(tmp_path, content), 1e-7)


@pytest.mark.parametrize("machine", ["intel", "dec", "sgi"])
def test_an_integer_file_that_ends_early_is_still_refused(machine: str, tmp_path: Path) -> None:
    whole = as_written_by(machine, with_integer_samples(float_file(tmp_path), 0.1))
    with pytest.raises(UnreadableFile) as refused:
        read(tmp_path, whole[: len(whole) - 2 * BLOCK])
    assert refused.value.code == "truncated-file"


@pytest.mark.parametrize("machine", ["intel", "dec", "sgi"])
def test_unsigned_analog_counts(machine: str, tmp_path: Path) -> None:
    """Counts from 0 to 65535 about an offset of 32768, as ANALOG:FORMAT says."""
    signed = float_file(tmp_path)
    stated = float_file(tmp_path, parameters={("ANALOG", "FORMAT"): ["UNSIGNED"]})
    recording = read(tmp_path, as_written_by(machine, with_integer_samples(stated, 0.1, unsigned=True)))
    assert_same(recording, read(tmp_path, signed), 0.06e-3)


def test_a_negative_offset_is_subtracted_with_its_sign(tmp_path: Path) -> None:
    expected = read(tmp_path, float_file(tmp_path))
    content = bytearray(float_file(tmp_path))
    at = parameter_at(bytes(content), "ANALOG", "OFFSET")
    struct.pack_into("<6h", content, at + 3, *([-30] * 6))
    start = (struct.unpack_from("<H", content, 16)[0] - 1) * BLOCK
    frames = np.frombuffer(bytes(content[start:]), "<f4")[: 20 * (4 * 7 + 60)].reshape(20, -1).copy()
    frames[:, 28:] -= 30.0
    content[start : start + frames.nbytes] = frames.tobytes()
    assert_same(read(tmp_path, bytes(content)), expected, 1e-9)


@pytest.mark.parametrize("stated", [0, 1, 2])
def test_a_section_that_states_too_few_blocks_is_followed_up_to_the_data(stated: int, tmp_path: Path) -> None:
    content = bytearray(float_file(tmp_path, parameters={("COPYRIGHT", "NOTICE"): ["word " * 20] * 12}))
    assert content[514] > 3
    content[514] = stated
    assert_same(read(tmp_path, bytes(content)), read(tmp_path, float_file(tmp_path)), 1e-9)


def test_a_last_record_with_an_offset_out_of_the_section_is_read(tmp_path: Path) -> None:
    """Nothing but zeros follows it, so that all parameters have been read."""
    content = bytearray(float_file(tmp_path))
    group, name = "EZC3D", "CONTACT"
    at = parameter_at(bytes(content), group, name)
    struct.pack_into("<H", content, at - 2, 60000)
    assert_same(read(tmp_path, bytes(content)), read(tmp_path, float_file(tmp_path)), 1e-9)


@pytest.mark.parametrize("n_channels", [256, 922])
def test_more_channels_than_one_list_holds(n_channels: int, tmp_path: Path) -> None:
    """SCALE, OFFSET and LABELS go on in SCALE2 ...; a plate's channels may be in the last of them."""
    rng = np.random.default_rng(6)
    idle = PlateChannels(2, np.zeros((40, n_channels - 6)))
    signals = rng.integers(-900, 0, (40, 6)).astype(float)
    content = _many(tmp_path, np.concatenate([idle.signals, signals], axis=1))
    recording = read(tmp_path, content)
    alone = write_file(tmp_path / "alone.c3d", points(4), plates=[PlateChannels(2, signals)])
    assert_same(recording, read_recording(alone), 1e-9)
    assert check_c3d(tmp_path / "made.c3d").layout.n_channels == n_channels


def _many(folder: Path, signals: np.ndarray) -> bytes:
    n = signals.shape[1]
    names = [f"c{i}" for i in range(n)]
    extra: dict[tuple[str, str], Any] = {}
    for k in range(0, n, 255):
        number = str(k // 255 + 1) if k else ""
        part = names[k : k + 255]
        extra["ANALOG", f"LABELS{number}"] = part
        extra["ANALOG", f"UNITS{number}"] = (
            ["N"] * len(part) if n - k > 255 else (["N"] * (len(part) - 3) + ["Nmm"] * 3)
        )
        extra["ANALOG", f"SCALE{number}"] = [1.0] * len(part)
        extra["ANALOG", f"OFFSET{number}"] = [0] * len(part)
    plate = PlateChannels(2, signals[:, -6:])
    extra["FORCE_PLATFORM", "CHANNEL"] = np.arange(n - 5, n + 1).reshape(6, 1)
    return write_file(folder / "many.c3d", points(4), plates=[plate], parameters=extra, analogs=signals).read_bytes()


def test_a_plate_on_channels_without_a_scale_is_left_out(tmp_path: Path) -> None:
    content = bytearray(float_file(tmp_path))
    at = parameter_at(bytes(content), "ANALOG", "SCALE")
    content[at - 2 - len("SCALE") : at - 2] = b"SCALX"
    recording = read(tmp_path, bytes(content))
    assert recording.plates == ()
    remark = next(remark for remark in recording.remarks if remark.code == "plate-unusable")
    assert "scale" in remark.message


def test_a_name_in_small_letters_names_the_same_parameter(tmp_path: Path) -> None:
    """ezc3d knows capitals only, and ends the process where it misses the offsets."""
    content = bytearray(float_file(tmp_path))
    at = parameter_at(bytes(content), "ANALOG", "OFFSET")
    content[at - 2 - len("OFFSET") : at - 2] = b"oFFSET"
    assert_same(read(tmp_path, bytes(content)), read(tmp_path, float_file(tmp_path)), 1e-9)


def test_offsets_may_be_floats(tmp_path: Path) -> None:
    content = float_file(tmp_path)
    changed = with_parameter(content, "ANALOG", "OFFSET", bytes([4, 1, 6]) + bytes(24))
    assert_same(read(tmp_path, changed), read(tmp_path, content), 1e-9)


def test_a_rate_ratio_that_is_not_whole_is_handled(tmp_path: Path) -> None:
    """The header states 10 samples a frame; 1000 / 105 Hz would be 9, and every frame after the first one garbage."""
    content = bytearray(float_file(tmp_path))
    for at, value in ((20, 105.0), (parameter_at(bytes(content), "POINT", "RATE") + 2, 105.0)):
        struct.pack_into("<f", content, at, value)
    recording, expected = read(tmp_path, bytes(content)), read(tmp_path, float_file(tmp_path))
    for label, track in expected.markers_m.items():
        np.testing.assert_allclose(recording.markers_m[label], track, atol=1e-9)
    assert recording.force_rate_hz == pytest.approx(1050.0)


def test_rates_may_be_given_by_the_header_only(tmp_path: Path) -> None:
    """As BTS writes it: without POINT:RATE, ezc3d took the analog samples for points, metres off."""
    whole = float_file(tmp_path)
    content = bytearray(whole)
    for group in ("POINT", "ANALOG"):
        at = parameter_at(bytes(content), group, "RATE")
        content[at - 2 - len("RATE") : at - 2] = b"ETAR"
    assert_same(read(tmp_path, bytes(content)), read(tmp_path, whole), 1e-9)


def test_frame_counts_of_parameters_and_header_may_differ(tmp_path: Path) -> None:
    """The header and the size of the file say 20 frames."""
    content = bytearray(float_file(tmp_path))
    at = parameter_at(bytes(content), "POINT", "FRAMES")
    struct.pack_into("<h", content, at + 2, 21)
    assert read(tmp_path, bytes(content)).n_frames == 20


def test_a_wrong_point_count_in_the_header_is_corrected(tmp_path: Path) -> None:
    """Its 3 points would leave most of the file behind the frames; POINT:USED fits."""
    content = bytearray(float_file(tmp_path))
    struct.pack_into("<H", content, 2, 3)
    assert_same(read(tmp_path, bytes(content)), read(tmp_path, float_file(tmp_path)), 1e-9)


def test_a_long_description_is_read(tmp_path: Path) -> None:
    """ezc3d takes a length above 127 for negative and asks for memory without end."""
    content = float_file(tmp_path)
    changed = with_parameter(content, "POINT", "UNITS", bytes([255, 1, 2]) + b"mm", b"x" * 200)
    assert_same(read(tmp_path, changed), read(tmp_path, content), 1e-9)


def test_messages_of_the_library_are_not_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: str) -> None:
        raise MemoryError("std::bad_alloc")

    (tmp_path / "a.c3d").write_bytes(float_file(tmp_path))
    monkeypatch.setattr("stridelab.recordings.files.c3d_ezc3d.ezc3d.c3d", fail)
    with pytest.raises(UnreadableFile) as refused:
        read_recording(tmp_path / "a.c3d")
    assert refused.value.code == "c3d-unreadable"
    assert "bad_alloc" not in repr((refused.value.message, refused.value.faults))


def test_a_short_hole_of_a_force_channel_is_bridged_and_named(tmp_path: Path) -> None:
    """Zeros in its place would be half a weight for ten milliseconds."""
    path = small_trial(tmp_path / "hole.c3d")
    content = ezc3d.c3d(str(path))
    content["data"]["analogs"][0, 2, 500:510] = np.nan
    content.write(str(path))
    recording = read_recording(path)
    np.testing.assert_allclose(recording.plates[0].force_n[495:515, 2], recording.plates[0].force_n[490, 2], atol=1e-3)
    assert "force-samples-missing" in {remark.code for remark in recording.remarks}
