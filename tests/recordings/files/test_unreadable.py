"""Files that are no recordings: each refused by name, never by a crash."""

import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import InvalidInput, UnreadableFile
from stridelab.recordings.files import opensim_zip
from stridelab.recordings.files.trc_mot import parse_mot
from stridelab.recordings.reader import read_recording
from support.recordings.c3d_files import PlateChannels, with_dec_floats, write_file

TRC = """PathFileType\t4\t(X/Y/Z)\ta.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits
100\t100\t2\t1\tmm
Frame#\tTime\tA\t\t
\t\tX1\tY1\tZ1

1\t0\t1\t2\t3
2\t0.01\t1\t2\t3
"""
COLUMNS = "\t".join(f"ground_force_{kind}{axis}" for kind in "vp" for axis in "xyz")
MOT = f"grf\nversion=1\nnRows=2\nnColumns=7\nendheader\ntime\t{COLUMNS}\n"
MOT += "0\t0\t700\t0\t0\t0\t0\n0.01\t0\t700\t0\t0\t0\t0\n"


def good(folder: Path) -> bytes:
    rng = np.random.default_rng(0)
    points = {f"M{i}": rng.normal(900.0, 300.0, (20, 3)) for i in range(6)}
    return write_file(folder / "good.c3d", points, plates=[PlateChannels(2, rng.normal(0, 1, (200, 6)))]).read_bytes()


def refusal(path: Path) -> UnreadableFile:
    with pytest.raises(UnreadableFile) as refused:
        read_recording(path)
    assert refused.value.message.endswith((".", ")."))
    return refused.value


def refused_bytes(folder: Path, content: bytes, name: str = "trial.c3d") -> UnreadableFile:
    path = folder / name
    path.write_bytes(content)
    return refusal(path)


def refused_zip(folder: Path, members: dict[str, str]) -> UnreadableFile:
    path = folder / "trial.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, text in members.items():
            packed.writestr(name, text)
    return refusal(path)


def test_an_empty_file_is_refused_by_name(tmp_path: Path) -> None:
    error = refused_bytes(tmp_path, b"")
    assert error.code == "empty-file"
    assert error.faults[0].where == "trial.c3d"


@pytest.mark.parametrize("content", [b"\x00", b"hello world" * 100, b"%PDF-1.7" + bytes(2000), bytes(4096)])
def test_other_kinds_of_file_are_refused(content: bytes, tmp_path: Path) -> None:
    assert refused_bytes(tmp_path, content).code in {"unknown-format", "not-c3d"}


def test_the_content_decides_the_format_and_not_the_name(tmp_path: Path) -> None:
    (tmp_path / "trial.txt").write_bytes(good(tmp_path))
    assert read_recording(tmp_path / "trial.txt").n_frames == 20


@pytest.mark.parametrize("keep", [2, 300, 512, 513, 700, 1024])
def test_a_file_truncated_in_header_or_parameters_is_refused(keep: int, tmp_path: Path) -> None:
    assert refused_bytes(tmp_path, good(tmp_path)[:keep]).code in {"truncated-file", "c3d-parameters-broken"}


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_file_truncated_in_the_frames_is_refused(share: float, tmp_path: Path) -> None:
    """Cut inside the data section (it starts at the block named in the header)."""
    content = good(tmp_path)
    start = (struct.unpack_from("<H", content, 16)[0] - 1) * 512
    error = refused_bytes(tmp_path, content[: start + int(share * 20 * (6 * 16 + 60 * 4))])
    assert error.code == "truncated-file"


@pytest.mark.parametrize(
    ("offset", "value"),
    [(2, 65535), (4, 65535), (8, 65535), (8, 40000)],
    ids=["points", "analog", "last frame", "many frames"],
)
def test_absurd_counts_are_refused(offset: int, value: int, tmp_path: Path) -> None:
    content = bytearray(good(tmp_path))
    struct.pack_into("<H", content, offset, value)
    assert refused_bytes(tmp_path, bytes(content)).code in {"absurd-c3d-header", "truncated-file"}


def test_frames_that_run_backwards_are_refused(tmp_path: Path) -> None:
    content = bytearray(good(tmp_path))
    struct.pack_into("<2H", content, 6, 50, 10)
    assert refused_bytes(tmp_path, bytes(content)).code == "absurd-c3d-header"


@pytest.mark.parametrize("name", ["DATA_START", "FRAMES", "USED", "RATE", "GEN_SCALE", "CORNERS", "ORIGIN"])
def test_a_text_in_place_of_a_number_is_refused(name: str, tmp_path: Path) -> None:
    """ezc3d takes the first of its numbers without a look, and ends the process."""
    content = bytearray(good(tmp_path))
    kind = content.index(name.encode(), 512) + len(name) + 2
    assert content[kind] in {2, 4}
    content[kind] = 0xFF
    error = refused_bytes(tmp_path, bytes(content))
    assert error.code == "c3d-parameters-broken"
    assert f"{name} is text" in error.faults[0].message


@pytest.mark.parametrize("name", ["UNITS", "LABELS", "DESCRIPTIONS"])
def test_a_text_without_a_length_is_refused(name: str, tmp_path: Path) -> None:
    """ezc3d ends the process on text that has no dimension."""
    content = bytearray(good(tmp_path))
    kind = content.index(name.encode(), 512) + len(name) + 2
    assert content[kind] == 0xFF
    content[kind + 1] = 0
    error = refused_bytes(tmp_path, bytes(content))
    assert error.code == "c3d-parameters-broken"
    assert error.faults[0].message == f"{name} is text without a length"


@pytest.mark.parametrize("rate_hz", [1e9, float("inf"), float("nan")])
def test_an_impossible_analog_rate_is_refused(rate_hz: float, tmp_path: Path) -> None:
    """ezc3d would read 10^7 samples per frame, most of them behind the end of the file."""
    content = bytearray(good(tmp_path))
    analog = content.index(b"ANALOG", 512)
    struct.pack_into("<f", content, content.index(b"RATE", analog) + len("RATE") + 4, rate_hz)
    error = refused_bytes(tmp_path, bytes(content))
    assert error.code == "c3d-parameters-broken"
    assert f"ANALOG:RATE is {np.float32(rate_hz):g} Hz" in error.faults[0].message


def test_the_rate_of_a_dec_machine_is_read_with_its_own_floats(tmp_path: Path) -> None:
    """As one of Intel's, the float of its 1000 Hz would be 2.5e-41 Hz."""
    content = good(tmp_path)
    (tmp_path / "dec.c3d").write_bytes(with_dec_floats(content))
    read, intel = read_recording(tmp_path / "dec.c3d"), read_recording(tmp_path / "good.c3d")
    assert read.plates[0].force_n.shape == intel.plates[0].force_n.shape
    for label, track in intel.markers_m.items():
        np.testing.assert_allclose(read.markers_m[label], track, atol=1e-6)

    absurd = bytearray(content)
    analog = absurd.index(b"ANALOG", 512)
    struct.pack_into("<f", absurd, absurd.index(b"RATE", analog) + len("RATE") + 4, 1e9)
    error = refused_bytes(tmp_path, with_dec_floats(bytes(absurd)))
    assert error.code == "c3d-parameters-broken"
    assert "ANALOG:RATE is 1e+09 Hz" in error.faults[0].message


def test_an_empty_parameter_section_is_refused(tmp_path: Path) -> None:
    content = bytearray(good(tmp_path))
    content[514] = content[516] = 0
    error = refused_bytes(tmp_path, bytes(content))
    assert error.code == "c3d-parameters-broken"
    assert "0 blocks" in error.faults[0].message


def test_a_parameter_chain_that_leaves_the_section_is_refused(tmp_path: Path) -> None:
    content = bytearray(good(tmp_path))
    name_length = abs(struct.unpack_from("b", content, 516)[0])
    struct.pack_into("<H", content, 518 + name_length, 60000)
    assert refused_bytes(tmp_path, bytes(content)).code == "truncated-file"


DAMAGE = """
import sys
from pathlib import Path
import numpy as np
from stridelab.errors import UnreadableFile
from stridelab.recordings.reader import read_recording

path = Path(sys.argv[1])
content, rng, outcomes = path.read_bytes(), np.random.default_rng(5), []
for _ in range(150):
    damaged = bytearray(content)
    for at in rng.integers(0, 1600, 3):
        damaged[at] = int(rng.integers(0, 256))
    path.write_bytes(bytes(damaged))
    try:
        outcomes.append(read_recording(path).n_frames)
    except UnreadableFile as error:
        outcomes.append(error.code)
print(len(outcomes), len({o for o in outcomes if isinstance(o, str)}))
"""


def test_random_damage_is_a_recording_or_a_named_refusal(tmp_path: Path) -> None:
    """150 files with three bytes of header or parameters changed: no crash, no hang, no other exception."""
    path = tmp_path / "damaged.c3d"
    path.write_bytes(good(tmp_path))
    run = subprocess.run(
        [sys.executable, "-c", DAMAGE, str(path)], capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr[-2000:]
    n, n_codes = map(int, run.stdout.split())
    assert n == 150
    assert n_codes >= 3


def test_nan_everywhere_is_no_marker_at_any_time(tmp_path: Path) -> None:
    path = write_file(tmp_path / "a.c3d", {f"M{i}": np.full((10, 3), np.nan) for i in range(4)})
    assert refusal(path).code == "all-missing"


def test_zeros_everywhere_are_no_marker_at_any_time(tmp_path: Path) -> None:
    path = write_file(tmp_path / "a.c3d", {f"M{i}": np.zeros((10, 3)) for i in range(4)})
    assert refusal(path).code == "all-missing"


def test_a_file_with_angles_and_no_markers_is_refused(tmp_path: Path) -> None:
    path = write_file(tmp_path / "a.c3d", {"LHipAngles": np.ones((10, 3)), "*12": np.ones((10, 3))})
    assert refusal(path).code == "no-markers"


def test_an_unknown_label_in_a_marker_map_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.c3d").write_bytes(good(tmp_path))
    with pytest.raises(InvalidInput) as refused:
        read_recording(tmp_path / "a.c3d", marker_map={"l_heel": "M0", "r_heel": "nobody"})
    assert refused.value.code == "unknown-marker"
    assert [fault.where for fault in refused.value.faults] == ["nobody"]


def test_a_zip_without_trc_is_refused(tmp_path: Path) -> None:
    assert refused_zip(tmp_path, {"notes.txt": "hello", "a.mot": MOT}).code == "zip-without-trc"
    assert refused_zip(tmp_path, {}).code in {"zip-without-trc", "zip-damaged"}


def test_a_zip_with_two_trials_is_refused_with_their_names(tmp_path: Path) -> None:
    error = refused_zip(tmp_path, {"a.trc": TRC, "b.trc": TRC, "a.mot": MOT})
    assert error.code == "zip-several-trials"
    assert {fault.where for fault in error.faults} == {"a.trc", "b.trc", "a.mot"}


def test_a_zip_with_too_many_files_is_refused(tmp_path: Path) -> None:
    assert refused_zip(tmp_path, {f"{i}.txt": "" for i in range(100)}).code == "zip-too-many-files"


def test_a_zip_bomb_is_refused(tmp_path: Path) -> None:
    """64 MB of blanks in 64 kB of zip."""
    bomb = "PathFileType" + " " * (opensim_zip.MAX_MEMBER_BYTES + 10)
    assert refused_zip(tmp_path, {"a.trc": bomb}).code == "zip-bomb"


def test_many_members_that_are_a_zip_bomb_together_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opensim_zip, "MAX_TOTAL_BYTES", 10_000)
    assert refused_zip(tmp_path, {f"{i}.txt": " " * 4000 for i in range(5)}).code == "zip-bomb"


def test_a_damaged_zip_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("a.trc", TRC * 50)
    content = bytearray((tmp_path / "a.zip").read_bytes())
    assert refused_bytes(tmp_path, bytes(content[: len(content) // 2]), "half.zip").code == "zip-damaged"
    content[60] ^= 0xFF
    assert refused_bytes(tmp_path, bytes(content), "flipped.zip").code in {"zip-damaged", "trc-broken"}


def test_system_files_in_a_zip_are_no_second_trial(tmp_path: Path) -> None:
    path = tmp_path / "trial.zip"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("x/a.trc", TRC)
        packed.writestr("x/a.mot", MOT)
        packed.writestr("__MACOSX/x/._a.trc", TRC)
        packed.writestr("x/.hidden.trc", TRC)
    assert read_recording(path).n_frames == 2


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (TRC.replace("\tA\t\t", "\t\t\t"), "trc-broken"),
        (TRC[: TRC.index("1\t0\t1")], "no-frames"),
        (TRC.replace("0.01\t1\t2", "0.01\tabc\t2"), "trc-broken"),
        (TRC.replace("2\t0.01", "2\t-1"), "trc-broken"),
        (TRC.replace("0.01\t1\t2", "0.01\t-1e200\t2"), "trc-broken"),
        ("PathFileType", "trc-broken"),
    ],
    ids=["marker count", "no rows", "not a number", "time", "beyond all measure", "header only"],
)
def test_a_broken_trc_is_refused(text: str, code: str, tmp_path: Path) -> None:
    assert refused_zip(tmp_path, {"a.trc": text, "a.mot": MOT}).code == code


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("PathFileType", "the file ends after line 1"),
        (TRC.replace("NumMarkers", "Markers"), "state no NumMarkers"),
        (TRC.replace("\t2\t1\tmm", "\t2\tmany\tmm"), "line 3 states 'many' as NumMarkers"),
        (TRC.replace("100\t100\t2", "fast\t100\t2"), "line 3 states 'fast' as DataRate"),
        (TRC.replace("\tA\t\t", "\t\t\t"), "line 3 states 1 markers and line 4 names 0"),
        (TRC.replace("0.01\t1\t2", "0.01\tabc\t2"), "line 8, column 3 holds 'abc'"),
        (TRC.replace("0.01\t1\t2", "0.01\t-1e200\t2"), "line 8, column 3 holds -1e+200"),
        (TRC.replace("2\t0.01\t1\t2\t3", "2"), "line 8 has 1 of 5 values"),
    ],
)
def test_a_broken_trc_is_refused_with_file_and_line(text: str, place: str, tmp_path: Path) -> None:
    refused = refused_zip(tmp_path, {"a.trc": text, "a.mot": MOT})
    assert refused.code == "trc-broken"
    assert "a.trc" in refused.message
    assert place in refused.message
    assert [(fault.where, place in fault.message) for fault in refused.faults] == [("a.trc", True)]


@pytest.mark.parametrize(
    ("text", "place"),
    [
        (MOT.replace("700\t0\t0", "x\t0\t0", 1), "line 7, column 3 holds 'x'"),
        (MOT.replace("0.01\t0\t700", "0.01\t0\t7e200"), "line 8, column 3 holds 7e+200"),
        (MOT[: MOT.index("time")], "the file ends with endheader in line 5"),
    ],
)
def test_a_broken_mot_is_refused_with_file_and_line(text: str, place: str) -> None:
    with pytest.raises(UnreadableFile) as refused:
        parse_mot(text, "a.mot")
    assert refused.value.code == "mot-broken"
    assert place in refused.value.message
    assert [(fault.where, place in fault.message) for fault in refused.value.faults] == [("a.mot", True)]


@pytest.mark.parametrize(
    ("method", "flags", "cause"),
    [
        (None, None, "it is not a complete zip file"),
        (None, 1, "it is encrypted"),
        (97, None, "it is compressed by a method that is not supported"),
    ],
    ids=["cut", "encrypted", "unknown method"],
)
def test_a_damaged_zip_is_described_in_words(method: int | None, flags: int | None, cause: str, tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("a.trc", TRC)
    content = bytearray(path.read_bytes())
    directory = content.index(b"PK\x01\x02")
    if flags is not None:
        content[6], content[directory + 8] = flags, flags
    if method is not None:
        content[8], content[directory + 10] = method, method
    path.write_bytes(bytes(content if flags or method else content[: len(content) // 2]))
    with pytest.raises(UnreadableFile) as refused:
        opensim_zip.unpack_texts(path)
    assert refused.value.code == "zip-damaged"
    assert refused.value.faults[0].where == "a.zip"
    assert refused.value.faults[0].message.startswith(cause)


def test_times_that_do_not_overlap_are_refused_with_both_ranges(tmp_path: Path) -> None:
    later = MOT.replace("\n0\t0\t7", "\n50\t0\t7").replace("\n0.01\t", "\n50.01\t")
    refused = refused_zip(tmp_path, {"a.trc": TRC, "a.mot": later})
    assert "0 to 0.01 s" in refused.message
    assert "50 to 50.01 s" in refused.message


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (MOT.replace("700\t0\t0", "x\t0\t0", 1), "mot-broken"),
        (MOT.replace("ground_force_px", "other_px").replace("_py", "y").replace("_pz", "z"), "mot-without-forces"),
        (MOT.replace("\n0.01\t", "\n-5\t"), "mot-broken"),
        (MOT.replace("700", "7e200", 1), "mot-broken"),
        (MOT.replace("\n0\t0\t7", "\n50\t0\t7").replace("\n0.01\t", "\n50.01\t"), "times-do-not-overlap"),
    ],
    ids=["not a number", "no centre of pressure", "time", "beyond all measure", "other times"],
)
def test_a_broken_mot_is_refused(text: str, code: str, tmp_path: Path) -> None:
    assert refused_zip(tmp_path, {"a.trc": TRC, "a.mot": text}).code == code


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"Format Version,1.23,Take Name,Take 01\n", "a CSV file of Motive"),
        (b"BTS ASCII format\n\nType:\tPoint 3D tracks\n", "a text file of BTS"),
        ("PathFileType\t4".encode("utf-16"), "a text in UTF-16"),
        (b"SPORT,time,x,y,z,force\n1,2,3,4,5,6\n", "of no known format (it begins with 'SPORT,time"),
        (b"\x89PNG\r\n\x1a\n" + bytes(600), "of no known format (its first bytes are 89 50 4e 47"),
    ],
)
def test_a_file_of_another_program_is_named_by_its_first_bytes(content: bytes, what: str, tmp_path: Path) -> None:
    refusal = refused_bytes(tmp_path, content)
    assert refusal.code == "unknown-format"
    assert what in refusal.message
