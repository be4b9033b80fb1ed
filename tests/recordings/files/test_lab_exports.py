"""Text exports of Qualisys and Vicon Nexus: what is read of them is the recording from which they were written."""

import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import UnreadableFile
from stridelab.recordings.files import trc_mot
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording
from support.command_line import SAMPLE
from support.recordings.export_files import nexus_csv, qualisys_forces, qualisys_markers, write_qualisys


@cache
def walk() -> Recording:
    """Frames 100 to 300 of the sample: both of its plates are loaded."""
    recording = read_recording(SAMPLE / "recording.c3d")
    ratio = round(recording.force_rate_hz / recording.marker_rate_hz)
    part = slice(100 * ratio, 300 * ratio)
    plates = tuple(replace(p, force_n=p.force_n[part], moment_nm=p.moment_nm[part]) for p in recording.plates)
    return replace(recording, markers_m={k: v[100:300] for k, v in recording.markers_m.items()}, plates=plates)


def codes(recording: Recording) -> set[str]:
    return {remark.code for remark in recording.remarks}


def refusal(folder: Path, text: str, name: str = "walk.tsv") -> UnreadableFile:
    (folder / name).write_text(text)
    with pytest.raises(UnreadableFile) as refused:
        read_recording(folder / name)
    return refused.value


def assert_same(recording: Recording, frames: slice = slice(None)) -> None:
    """Markers to a micrometre, force and moment about the world's origin where the plate is loaded."""
    true = walk()
    assert recording.up_axis == "+z"
    assert (recording.marker_rate_hz, recording.force_rate_hz) == (true.marker_rate_hz, true.force_rate_hz)
    assert list(recording.markers_m) == list(true.markers_m)
    for label, track in true.markers_m.items():
        np.testing.assert_allclose(recording.markers_m[label], track[frames], atol=2e-6)
    ratio = round(true.force_rate_hz / true.marker_rate_hz)
    samples = slice(ratio * (frames.start or 0), ratio * (frames.stop or true.n_frames))
    for plate, expected in zip(recording.plates, true.plates, strict=True):
        loaded = expected.loaded[samples] & (expected.force_n[samples, 2] > 50.0)
        np.testing.assert_allclose(plate.force_n[loaded], expected.force_n[samples][loaded], atol=1e-4)
        np.testing.assert_allclose(plate.moment_nm[loaded], expected.moment_nm[samples][loaded], atol=0.3)


@pytest.mark.parametrize("numbered", [False, True])
def test_a_qualisys_export_is_the_recording(numbered: bool, tmp_path: Path) -> None:
    recording = read_recording(write_qualisys(tmp_path / "walk.zip", walk(), numbered=numbered))
    assert_same(recording)
    for plate, expected in zip(recording.plates, walk().plates, strict=True):
        np.testing.assert_allclose(plate.corners_m, expected.corners_m, atol=1e-6)
    assert "free-moment-unknown" not in codes(recording)


def test_a_short_gap_of_an_exported_force_is_bridged_and_named(tmp_path: Path) -> None:
    at = int(np.argmax(walk().plates[0].force_n[:, 2] > 400.0))
    force_n = walk().plates[0].force_n.copy()
    force_n[at : at + 5] = np.nan
    holed = replace(walk(), plates=(replace(walk().plates[0], force_n=force_n), *walk().plates[1:]))
    recording = read_recording(write_qualisys(tmp_path / "walk.zip", holed, numbered=False))
    bridged_n, true_n = recording.plates[0].force_n[at : at + 5], walk().plates[0].force_n[at : at + 5]
    np.testing.assert_allclose(bridged_n, true_n, atol=20.0)
    assert "force-samples-missing" in codes(recording)


@pytest.mark.parametrize("moment_mm", [True, False])
def test_forces_in_the_axes_of_their_plate_are_turned(moment_mm: bool, tmp_path: Path) -> None:
    """Moments in N mm or N m; a plate without corners is refused."""
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr("walk.tsv", qualisys_markers(walk()))
        for plate in walk().plates:
            text = qualisys_forces(plate, walk().force_rate_hz, local=True, moment_mm=moment_mm)
            archive.writestr(f"walk_f_{plate.index}.tsv", text)
    recording = read_recording(tmp_path / "walk.zip")
    assert_same(recording)
    assert "free-moment-unknown" not in codes(recording)
    with zipfile.ZipFile(tmp_path / "bare.zip", "w") as archive:
        archive.writestr("walk.tsv", qualisys_markers(walk()))
        text = qualisys_forces(walk().plates[0], walk().force_rate_hz, local=True)
        archive.writestr("walk_f_1.tsv", "\n".join(line for line in text.split("\n") if "CORNER" not in line))
    with pytest.raises(UnreadableFile, match="its header does not state the corners"):
        read_recording(tmp_path / "bare.zip")


@pytest.mark.parametrize(("marker_s", "force_s"), [(2.0, 2.0), (2.0, 1.9), (1.9, 2.0)])
def test_files_that_begin_at_other_times_are_read_from_the_later_one(
    marker_s: float, force_s: float, tmp_path: Path
) -> None:
    """The sample, cut to 2 s on; one of its files begins 0.1 s earlier."""
    true = walk()
    early = round(0.1 * true.marker_rate_hz), round(0.1 * true.force_rate_hz)
    late = replace(
        true,
        markers_m={k: v[early[0] :] for k, v in true.markers_m.items()},
        plates=tuple(replace(p, force_n=p.force_n[early[1] :], moment_nm=p.moment_nm[early[1] :]) for p in true.plates),
    )
    markers, forces = (late if start_s == 2.0 else true for start_s in (marker_s, force_s))
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr("walk.tsv", qualisys_markers(markers, numbered=True, start_s=marker_s))
        for plate in forces.plates:
            text = qualisys_forces(plate, true.force_rate_hz, numbered=True, start_s=force_s)
            archive.writestr(f"walk_f_{plate.index}.tsv", text)
    recording = read_recording(tmp_path / "walk.zip")
    assert_same(recording, slice(early[0], None))
    assert ("cut-to-common-time" in codes(recording)) == (marker_s != force_s)


def test_files_of_other_times_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr("walk.tsv", qualisys_markers(walk(), numbered=True, start_s=0.0))
        text = qualisys_forces(walk().plates[0], walk().force_rate_hz, numbered=True, start_s=60.0)
        archive.writestr("walk_f_1.tsv", text)
    with pytest.raises(UnreadableFile) as refused:
        read_recording(tmp_path / "walk.zip")
    assert refused.value.code == "times-do-not-overlap"


def test_qualisys_markers_alone_have_no_plates(tmp_path: Path) -> None:
    (tmp_path / "walk.tsv").write_text(qualisys_markers(walk()))
    recording = read_recording(tmp_path / "walk.tsv")
    assert (recording.plates, "no-force-file" in codes(recording)) == ((), True)


@pytest.mark.parametrize("mark", [",", "\t"])
@pytest.mark.parametrize("first_frame", [1, 841])
def test_a_nexus_export_is_the_recording(mark: str, first_frame: int, tmp_path: Path) -> None:
    """Its force acts on the plate, and points down."""
    events = "Events,,\n100,,\nSubject,Context,Name,Time (s)\nAnn,Left,Foot Strike,0.5"
    text = nexus_csv(walk(), mark=mark, first_frame=first_frame, sections=[events])
    (tmp_path / "walk.csv").write_text("\ufeff" + text)
    assert_same(read_recording(tmp_path / "walk.csv"))


def test_forces_that_began_before_the_markers_are_read_from_the_first_frame(tmp_path: Path) -> None:
    true = walk()
    later = replace(true, markers_m={label: track[50:] for label, track in true.markers_m.items()})
    devices, trajectories = nexus_csv(true).split("\n\n")[0], nexus_csv(replace(later, plates=()), first_frame=51)
    (tmp_path / "walk.csv").write_text(f"{devices}\n\n{trajectories}")
    assert_same(read_recording(tmp_path / "walk.csv"), slice(50, None))


def test_forces_that_end_early_cut_the_markers(tmp_path: Path) -> None:
    lines = nexus_csv(walk()).split("\n\n")
    devices = lines[0].splitlines()
    ratio = round(walk().force_rate_hz / walk().marker_rate_hz)
    (tmp_path / "walk.csv").write_text("\n".join(devices[: 5 + 150 * ratio]) + "\n\n" + lines[1])
    recording = read_recording(tmp_path / "walk.csv")
    assert "cut-to-common-time" in codes(recording)
    assert_same(recording, slice(0, 150))


def test_a_moment_that_fits_no_point_gives_no_free_moment(tmp_path: Path) -> None:
    true = walk()
    rng = np.random.default_rng(1)
    noisy = tuple(replace(p, moment_nm=p.moment_nm + rng.normal(0.0, 60.0, p.moment_nm.shape)) for p in true.plates)
    text = nexus_csv(replace(true, plates=noisy)).split("\n\n")[0]
    cop = nexus_csv(true).split("\n\n")
    rows = [
        ",".join([*bad.split(",")[:8], *good.split(",")[8:11], *bad.split(",")[11:17], *good.split(",")[17:]])
        for bad, good in zip(text.splitlines(), cop[0].splitlines(), strict=True)
    ]
    (tmp_path / "walk.csv").write_text("\n".join(rows) + "\n\n" + cop[1])
    assert "free-moment-unknown" in codes(read_recording(tmp_path / "walk.csv"))


def test_centres_of_pressure_in_the_axes_of_the_plate_are_refused(tmp_path: Path) -> None:
    true = walk()
    far = replace(true.plates[0], corners_m=true.plates[0].corners_m + np.array([3.0, 0.0, 0.0]))
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr("walk.tsv", qualisys_markers(true))
        head = qualisys_forces(far, true.force_rate_hz).split("\n")[:16]
        rows = qualisys_forces(true.plates[0], true.force_rate_hz).split("\n")[16:]
        archive.writestr("walk_f_1.tsv", "\n".join(head + rows))
    with pytest.raises(UnreadableFile) as refused:
        read_recording(tmp_path / "walk.zip")
    assert (refused.value.code, refused.value.faults[0].where) == ("forces-elsewhere", "walk_f_1.tsv")


def test_a_broken_tsv_is_refused_by_file_and_line(tmp_path: Path) -> None:
    good = qualisys_markers(walk())
    lines = good.splitlines()
    cases = {
        "states 'fast' as FREQUENCY": good.replace("FREQUENCY\t100", "FREQUENCY\tfast", 1),
        "FREQUENCY of 0 Hz": good.replace("FREQUENCY\t100", "FREQUENCY\t0", 1),
        "no line MARKER_NAMES": good.replace("MARKER_NAMES", "NAMES"),
        "holds 6D data": good.replace("INCLUDED\t3D", "INCLUDED\t6D"),
        "belong to the": "\n".join([*lines[:14], lines[14] + "\t1\t2\t3", *lines[15:]]),
        "line 15, column 1 holds 'x'": "\n".join([*lines[:14], "x" + lines[14][lines[14].index("\t") :], *lines[15:]]),
    }
    for what, text in cases.items():
        error = refusal(tmp_path, text)
        assert (error.code, what in error.message, "walk.tsv" in error.message) == ("tsv-broken", True, True), what
    assert refusal(tmp_path, "\n".join(lines[:10])).code == "no-frames"


def test_a_broken_csv_is_refused_by_file_and_line(tmp_path: Path) -> None:
    good = nexus_csv(replace(walk(), plates=()))
    lines = good.splitlines()
    cases = {
        "line 2 holds no rate": good.replace("\n100\n", "\nfast\n", 1),
        "line 2 states a rate of -1 Hz": good.replace("\n100\n", "\n-1\n", 1),
        "does not begin with Frame": good.replace("Frame,Sub Frame", "Time,Sub Frame"),
        "not numbered frame by frame": "\n".join([*lines[:9], *lines[10:]]),
        "before its first frame": "\n".join(lines[:5]),
        "several units": good.replace(",,mm,", ",,m,", 1),
        "no columns X, Y, Z": good.replace("X,Y,Z", "RX,RY,RZ"),
        "line 9, column 3 holds 'x'": "\n".join([*lines[:8], "4,0,x," + lines[8].split(",", 3)[3], *lines[9:]]),
    }
    for what, text in cases.items():
        error = refusal(tmp_path, text, "walk.csv")
        assert (error.code, what in error.message, "walk.csv" in error.message) == ("csv-broken", True, True), what
    error = refusal(tmp_path, nexus_csv(walk()).split("\n\n")[0], "walk.csv")
    assert (error.code, "it has Devices" in error.message) == ("no-markers", True)


@pytest.mark.parametrize(("name", "make"), [("walk.tsv", qualisys_markers), ("walk.csv", nexus_csv)])
def test_a_file_too_large_is_refused_before(name: str, make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(trc_mot, "MAX_MEMBER_BYTES", 2**10)
    assert refusal(tmp_path, make(walk()), name).code == f"{name[-3:]}-too-large"


UNKNOWN = {
    "a.tdf": (b"\x82\x4b\x60\x41\xd3\x11\x84\xca" + bytes(60), "a BTS file (its first bytes are 82 4b 60 41"),
    "a.mvn": (bytes(range(100)), "an Xsens MVN recording"),
    "renamed.txt": (b"HIERARCHY\nROOT Hips", "a BVH file"),
    "a.b3d": (bytes(range(100)), "an AddBiomechanics file of all trials"),
    "a.trb": (bytes(range(1, 100)), "a binary Cortex file"),
    "a.qtm": (bytes(range(100)), "a Qualisys Track Manager file"),
    "a.x1d": (bytes(range(100)), "raw camera data of Vicon"),
    "a.x2d": (bytes(range(100)), "raw camera data of Vicon"),
    "a.v": (bytes(range(100)), "a Vicon trial"),
    "a.bvh": (b"HIERARCHY\n", "a BVH file"),
    "walk_f_1.tsv": (b"NO_OF_SAMPLES\t5\nFORCE_PLATE_NAME\tA\n", "the forces of a Qualisys export"),
    "a.dat": (b"\xff\x00\x01" * 9, "of no known format (its first bytes are ff 00 01"),
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_an_unknown_format_is_named_with_what_to_do(name: str, tmp_path: Path) -> None:
    content, what = UNKNOWN[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UnreadableFile) as refused:
        read_recording(tmp_path / name)
    assert refused.value.code == "unknown-format"
    assert f"{name} is {what}" in refused.value.message
    assert any(word in refused.value.message.partition("). ")[2] for word in ("C3D", "TRC", "TSV"))


EMG = "Devices\n2000\n,,EMG - Voltage,\nFrame,Sub Frame,e1,e2\n,,V,V\n" + "".join(
    f"{1 + k // 20},{k % 20},0.1,0.2\n" for k in range(4000)
)


@pytest.mark.parametrize("first", [True, False])
def test_the_plates_are_read_beside_a_second_section_of_devices(first: bool, tmp_path: Path) -> None:
    devices, trajectories = nexus_csv(walk()).split("\n\n")
    parts = [EMG.rstrip(), devices] if first else [devices, EMG.rstrip()]
    (tmp_path / "walk.csv").write_text("\n\n".join([*parts, trajectories]))
    assert_same(read_recording(tmp_path / "walk.csv"))


@pytest.mark.parametrize("mark", ["\t", ";"])
def test_an_export_of_nexus_may_have_decimal_commas(mark: str, tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text(nexus_csv(walk(), mark=mark).replace(".", ","))
    assert_same(read_recording(tmp_path / "walk.csv"))
