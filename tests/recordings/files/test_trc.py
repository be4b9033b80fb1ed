"""A TRC file alone: read as the zip of it is, and its faults are sentences that name the file and the line."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import UnreadableFile
from stridelab.recordings.files import trc_mot
from stridelab.recordings.reader import is_c3d, read_recording
from support.recordings.c3d_files import write_file

BODY_MM = np.array([[0, 1000, 100], [0, 1000, -100], [-100, 1000, 0], [0, 1700, 0], [0, 50, 100]])
LABELS = ("R.ASIS", "L.ASIS", "V.Sacral", "Top.Head", "R.Heel")
N = 40


def trc(unit: str = "mm", *, scale: float = 1.0, labels: tuple[str, ...] = LABELS) -> str:
    points = scale * (BODY_MM[: len(labels)] + np.outer(np.arange(N), [12.0, 0.0, 0.0])[:, None, :])
    head = (
        "PathFileType\t4\t(X/Y/Z)\twalk.trc\n"
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\n"
        f"100.0\t100.0\t{N}\t{len(labels)}\t{unit}\t100.0\n"
        "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t\t\n"
        "\t\tX1\tY1\tZ1\n\n"
    )
    rows = ["\t".join([str(i + 1), f"{i / 100:.2f}", *(f"{x:.3f}" for x in points[i].ravel())]) for i in range(N)]
    return head + "\n".join(rows) + "\n"


def without(text: str, number: int) -> str:
    """The text without one of its lines, counted from one."""
    lines = text.splitlines(keepends=True)
    return "".join(lines[: number - 1] + lines[number:])


def changed(text: str, number: int, old: str, new: str) -> str:
    """The text with ``old`` replaced by ``new`` in one line, which must hold it."""
    lines = text.splitlines(keepends=True)
    assert old in lines[number - 1]
    lines[number - 1] = lines[number - 1].replace(old, new, 1)
    return "".join(lines)


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "walk.trc"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def codes(path: Path) -> dict[str, str]:
    return {remark.code: remark.message for remark in read_recording(path).remarks}


@pytest.mark.parametrize("before", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_a_trc_alone_gives_the_same_recording_as_its_zip(before: bytes, ends: str, tmp_path: Path) -> None:
    path = written(tmp_path, before + trc().replace("\n", ends).encode())
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as packed:
        packed.writestr("walk.trc", trc())
    alone, in_zip = read_recording(path), read_recording(tmp_path / "walk.zip")
    assert alone.plates == ()
    assert (alone.n_frames, alone.marker_rate_hz, alone.up_axis) == (N, 100.0, "+y")
    assert list(alone.markers_m) == list(LABELS)
    for label in LABELS:
        np.testing.assert_array_equal(alone.markers_m[label], in_zip.markers_m[label])
    np.testing.assert_allclose(alone.markers_m["Top.Head"][3], [0.036, 0.0, 1.7], atol=1e-12)
    assert "The TRC file holds markers only" in codes(path)["no-force-file"]
    assert "The zip holds markers only" in codes(tmp_path / "walk.zip")["no-force-file"]


def test_the_content_decides_the_format_and_not_the_name(tmp_path: Path) -> None:
    other = tmp_path / "walk.c3d"
    other.write_text(trc())
    assert read_recording(other).n_frames == N
    points = {f"M{i}": np.full((5, 3), 100.0 * i) for i in range(5)}
    binary = write_file(tmp_path / "other.c3d", points).rename(tmp_path / "walk.trc")
    assert read_recording(binary).n_frames == 5
    assert (is_c3d(other), is_c3d(binary)) == (False, True)


def test_times_give_the_rate_that_a_spreadsheet_moved_out_of_the_header(tmp_path: Path) -> None:
    """A program that moved the field DataRate to line 1 left its value, and CameraRate, in lines 2 and 3."""
    moved = changed(changed(trc(), 2, "DataRate\t", ""), 1, "walk.trc", "walk.trc\tDataRate")
    path = written(tmp_path, changed(moved, 3, "100.0\t", ""))
    assert read_recording(path).marker_rate_hz == pytest.approx(100.0)
    assert "state no DataRate; the times in column 2 give 100 Hz" in codes(path)["trc-header-differs"]


BROKEN = {
    "blank": ("\n \n", "line 1 does not begin with PathFileType"),
    "no first line": (without(trc(), 1), "line 1 does not begin with PathFileType"),
    "other text": ("hello world\n" * 50, "line 1 does not begin with PathFileType"),
    "first line only": (trc().splitlines()[0], "ends after line 1"),
    "cut in the header": ("\n".join(trc().splitlines()[:3]), "ends after line 3"),
    "line 2 lost": (without(trc(), 2), "state no NumMarkers"),
    "no DataRate and one frame": (
        "\n".join(changed(trc(), 2, "DataRate", "Rate").splitlines()[:7]),
        "state no DataRate, and one frame shows none",
    ),
    "a name lost": (
        changed(trc(), 4, "\t\t\tTop.Head", ""),
        "line 3 states 5 markers, line 4 names 4 and the frames have columns for 5",
    ),
    "a name lost, another count": (
        changed(changed(trc(), 4, "\t\t\tTop.Head", ""), 3, "\t5\t", "\t7\t"),
        "line 3 states 7 markers, line 4 names 4 and the frames have columns for 5",
    ),
    "no name at all": (changed(trc(), 4, "\t" + "\t\t\t".join(LABELS), ""), "states 5 markers and line 4 names 0"),
    "two lines in one": (changed(trc(), 9, "\n", "\t"), "line 9 has 34 values, 17 belong to the 5 markers"),
    "no markers stated": (changed(trc(), 3, "\t5\t", "\t\t"), "lines 2 and 3 of the header state no NumMarkers"),
    "count no number": (changed(trc(), 3, "\t5\t", "\tfive\t"), "line 3 states 'five' as NumMarkers"),
    "rate no number": (changed(trc(), 3, "100.0\t", "fast\t"), "line 3 states 'fast' as DataRate"),
    "names without tabs": (changed(trc(), 4, trc().splitlines()[3], " ".join(LABELS)), "line 4 holds no tabs"),
    "short row": (changed(trc(), 9, "\t1700.000\t0.000\t24.000\t50.000\t100.000", ""), "line 9 has 12 of 17 values"),
    "a tab lost": (changed(trc(), 9, "3\t0.02", "30.02"), "line 9 has 16 of 17 values"),
    "a value too many": (changed(trc(), 9, "24.000\t", "24.000\t7.5\t"), "line 9 has 18 values"),
    "comma as decimal sign": (changed(trc(), 9, "1000.000", "1000,000"), "line 9, column 4 holds '1000,000'"),
    "not a number": (changed(trc(), 9, "1000.000", "occluded"), "line 9, column 4 holds 'occluded'"),
    "beyond all measure": (changed(trc(), 9, "1000.000", "1e200"), "line 9, column 4 holds 1e+200"),
    "no time": (changed(trc(), 9, "\t0.02\t", "\t\t"), "line 9, column 2 holds no time"),
    "time stands": (changed(trc(), 9, "\t0.02\t", "\t0.01\t"), "line 9, column 2 holds the time 0.01 s after 0.01 s"),
    "unknown unit": (trc("furlong", scale=17.0), "line 3 states 'furlong' as Units"),
    "no unit": (trc("", scale=17.0), "line 3 states no Units"),
    "no unit, few markers": (trc("", labels=LABELS[:3]), "line 3 states no Units"),
    "zeros for binary": (trc().encode()[:300] + bytes(400), "line"),
}


@pytest.mark.parametrize("what", BROKEN)
@pytest.mark.parametrize("packed", [False, True], ids=["alone", "in a zip"])
def test_a_broken_trc_is_refused_by_file_and_line(what: str, packed: bool, tmp_path: Path) -> None:
    text, place = BROKEN[what]
    path = written(tmp_path, text)
    begins = path.read_bytes().lstrip().startswith(b"PathFileType")
    if packed:
        with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
            archive.write(path, "walk.trc")
        path = tmp_path / "walk.zip"
    with pytest.raises(UnreadableFile) as refusal:
        read_recording(path)
    if packed and not begins:
        assert refusal.value.code == "zip-without-trc"
        return
    assert refusal.value.code == "trc-broken"
    assert refusal.value.message.startswith("The TRC file walk.trc is broken: ")
    assert refusal.value.message.endswith(".")
    assert place in refusal.value.message
    assert [(fault.where, place in fault.message) for fault in refusal.value.faults] == [("walk.trc", True)]


@pytest.mark.parametrize("stated", ["7", "4", "0"])
def test_the_columns_decide_against_the_count_of_the_header(stated: str, tmp_path: Path) -> None:
    path = written(tmp_path, changed(trc(), 3, "\t5\t", f"\t{stated}\t"))
    recording = read_recording(path)
    for label, track in read_recording(written(tmp_path, trc())).markers_m.items():
        np.testing.assert_array_equal(recording.markers_m[label], track)
    (message,) = [remark.message for remark in recording.remarks if remark.code == "trc-header-differs"]
    assert f"states {stated} markers, line 4 names 5" in message
    assert "trc-header-differs" not in codes(path)


def test_columns_that_are_blank_throughout_are_columns(tmp_path: Path) -> None:
    """Line 4 names two more markers than the header counts, and every line holds their empty cells."""
    text = changed(trc(), 4, "R.Heel\t\t\t", "R.Heel\t\t\tV.Knee\t\t\tV.Hip\t\t\t")
    lines = text.splitlines()
    recording = read_recording(written(tmp_path, "\n".join(lines[:6] + [line + 7 * "\t" for line in lines[6:]])))
    assert list(recording.markers_m) == list(LABELS)
    assert "trc-header-differs" in codes(tmp_path / "walk.trc")
    with pytest.raises(UnreadableFile, match="line 3 states 5 markers, line 4 names 7 and the frames have columns for"):
        read_recording(written(tmp_path, text))


def test_virtual_markers_without_columns_are_left_out(tmp_path: Path) -> None:
    """Cortex names virtual markers (V_...) after the real ones, counts the real ones and exports only those."""
    lines = changed(trc(), 4, "R.Heel\t\t\t", "R.Heel\t\t\tV_R.Knee\t\t\tV_Mid_Hip\t\t\t").splitlines()
    lines[4] = "\t\t" + "\t".join(f"{axis}{i + 1}" for i in range(5) for axis in "XYZ")
    recording = read_recording(written(tmp_path, "\n".join(lines)))
    assert list(recording.markers_m) == list(LABELS)
    (message,) = [remark.message for remark in recording.remarks if remark.code == "trc-header-differs"]
    assert "2 virtual markers (V_R.Knee ...)" in message
    named = [line.replace("V_Mid", "Mid") for line in lines]
    with pytest.raises(UnreadableFile, match="line 3 states 5 markers, line 4 names 7"):
        read_recording(written(tmp_path, "\n".join(named)))


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("stated", ["5", "9"])
def test_points_without_a_name_at_the_ends_of_lines_are_left_out(every: int, stated: str, tmp_path: Path) -> None:
    """Some writers append unnamed points; the line X1 Y1 Z1 ... numbers the named ones."""
    lines = changed(trc(), 3, "\t5\t", f"\t{stated}\t").splitlines()
    lines[4] = "\t\t" + "\t".join(f"{axis}{i + 1}" for i in range(5) for axis in "XYZ")
    lines[6:] = [line + ("\t\t\t\t1.5\t2.5\t3.5\t" if i % every == 0 else "\t") for i, line in enumerate(lines[6:])]
    recording = read_recording(written(tmp_path, "\n".join(lines)))
    messages = {remark.code: remark.message for remark in recording.remarks}
    assert "up to 2 points" in messages["unlabelled-points"]
    assert ("trc-header-differs" in messages) == (stated == "9")
    for label, track in read_recording(written(tmp_path, trc())).markers_m.items():
        np.testing.assert_array_equal(recording.markers_m[label], track)


@pytest.mark.parametrize("mark", [",", ";"])
def test_a_table_program_separates_by_commas(mark: str, tmp_path: Path) -> None:
    lines = [line.replace("\t", mark) for line in trc().splitlines()]
    lines[:2] = [line + 9 * mark for line in lines[:2]]
    path = written(tmp_path, "\n".join(lines))
    recording = read_recording(path)
    assert {"trc-header-differs", "trc-frame-count"} & codes(path).keys() == set()
    for label, track in read_recording(written(tmp_path, trc())).markers_m.items():
        np.testing.assert_array_equal(recording.markers_m[label], track)
    lines[8] = lines[8].replace("1000.000", "occluded", 1)
    with pytest.raises(UnreadableFile) as refusal:
        read_recording(written(tmp_path, "\n".join(lines)))
    assert "line 9, column 4 holds 'occluded'" in refusal.value.message


def test_the_last_marker_may_be_missing_with_its_tabs(tmp_path: Path) -> None:
    """Writers cut blanks at the end of a line: three cells or two are gone, and the marker is not seen."""
    text = changed(trc(), 9, "\t24.000\t50.000\t100.000", "")
    text = changed(text, 10, "\t36.000\t50.000\t100.000", "\t\t")
    visible = np.isfinite(read_recording(written(tmp_path, text)).markers_m["R.Heel"][:, 0])
    assert "gaps-filled" in codes(tmp_path / "walk.trc")
    assert visible.all()
    longer = "".join(line[: line.rindex("\t50.000")] if "\t50.000" in line else line for line in text.splitlines(True))
    with pytest.raises(UnreadableFile):
        read_recording(written(tmp_path, longer))


def test_an_empty_file_and_one_without_frames_are_refused(tmp_path: Path) -> None:
    for text, code in (("", "empty-file"), ("\n".join(trc().splitlines()[:5]) + "\n", "no-frames")):
        with pytest.raises(UnreadableFile) as refusal:
            read_recording(written(tmp_path, text))
        assert refusal.value.code == code
        assert refusal.value.faults[0].where == "walk.trc"


def test_errors_call_the_file_what_its_user_calls_it(tmp_path: Path) -> None:
    path = tmp_path / "trial"
    path.write_text("hello")
    with pytest.raises(UnreadableFile) as refusal:
        read_recording(path, name="walk 03.trc")
    assert "walk 03.trc" in refusal.value.message
    with pytest.raises(UnreadableFile) as refusal:
        read_recording(path, name="walk 03.txt")
    assert refusal.value.code == "unknown-format"
    assert "TRC" in refusal.value.message


@pytest.mark.parametrize("stated", [60, 30])
def test_a_wrong_number_of_frames_is_remarked(stated: int, tmp_path: Path) -> None:
    path = written(tmp_path, changed(trc(), 3, f"\t{N}\t", f"\t{stated}\t"))
    assert read_recording(path).n_frames == N
    assert f"states {stated} frames and {N} follow" in codes(path)["trc-frame-count"]
    assert ("cut off" in codes(path)["trc-frame-count"]) == (stated > N)
    assert "trc-frame-count" not in codes(written(tmp_path, trc()))


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "mm"), (0.1, "cm"), (0.001, "m")])
@pytest.mark.parametrize("stated", ["", "furlong"])
def test_an_unknown_unit_follows_from_the_size_of_the_body(
    scale: float, unit: str, stated: str, tmp_path: Path
) -> None:
    path = written(tmp_path, trc(stated, scale=scale))
    assert f"read in {unit}," in codes(path)["unit-assumed"]
    np.testing.assert_allclose(read_recording(path).markers_m["Top.Head"][0], [0.0, 0.0, 1.7], atol=2e-3)


@pytest.mark.parametrize(("stated", "scale"), [("meters", 0.001), ("Millimeters", 1.0)])
def test_units_may_be_written_out(stated: str, scale: float, tmp_path: Path) -> None:
    path = written(tmp_path, trc(stated, scale=scale))
    assert {"unit-assumed", "unit-corrected"} & codes(path).keys() == set()
    np.testing.assert_allclose(read_recording(path).markers_m["Top.Head"][0], [0.0, 0.0, 1.7], atol=2e-3)


LEGS_MM = {"ASI": 1000, "PSI": 1020, "KNE": 500, "ANK": 80, "HEE": 40}


def walk_of(body_mm: dict[str, tuple[int, int]], place: tuple[int, ...], sides: tuple[str, str] = ("L", "R")) -> str:
    """Markers at (ahead, height) on both sides that travel ahead; ``place`` orders ahead, height and right."""
    labels = tuple(f"{s}{name}" for name in body_mm for s in sides)
    standing = np.array([[*at, y] for at in body_mm.values() for y in (-100, 100)])
    rows = (standing + np.outer(np.arange(N), [60.0, 0.0, 0.0])[:, None, :])[:, :, list(place)]
    head = "\n".join(trc(labels=labels[:5]).splitlines()[:3]).replace("\t5\t", f"\t{len(labels)}\t")
    text = head + "\nFrame#\tTime\t" + "\t\t\t".join(labels) + "\t\t\t\n\t\tX1\tY1\tZ1\n\n"
    return text + "".join(
        "\t".join([str(i + 1), f"{i / 100:.2f}", *(f"{x:.3f}" for x in row.ravel())]) + "\n"
        for i, row in enumerate(rows)
    )


@pytest.mark.parametrize(("place", "up"), [((0, 2, 1), "+z"), ((0, 1, 2), "+y"), ((1, 0, 2), "+x")])
def test_the_vertical_axis_follows_from_a_known_body(place: tuple[int, ...], up: str, tmp_path: Path) -> None:
    """Cortex writes z upwards, OpenSim y; the body is narrower than its walk is long, so no extent decides."""
    text = walk_of({name: (0, height) for name, height in LEGS_MM.items()}, place)
    recording = read_recording(written(tmp_path, text))
    assert recording.up_axis == up
    np.testing.assert_allclose(recording.markers_m["LASI"][:, 2], 1.0)
    assert ("up-axis-from-body" in {remark.code for remark in recording.remarks}) == (up != "+y")


SEGMENTS_MM = {"UpperLeg": (0, 950), "LowerLeg": (0, 500), "Foot": (0, 80), "UpperArm": (0, 1450)}


@pytest.mark.parametrize(("place", "up"), [((0, 2, 1), "+z"), ((0, 1, 2), "+y")])
def test_joint_centres_give_the_vertical_axis_of_a_body(tmp_path: Path, place: tuple[int, ...], up: str) -> None:
    """Video gives joint centres and no spines of the pelvis; some programs write it with z upwards."""
    recording = read_recording(written(tmp_path, walk_of(SEGMENTS_MM, place, ("Left", "Right"))))
    assert recording.up_axis == up
    np.testing.assert_allclose(recording.markers_m["LeftUpperLeg"][:, 2], 0.95)


def test_a_rower_is_not_turned_upright(tmp_path: Path) -> None:
    """The legs lie along the boat and the trunk stands: the axis of the format stays."""
    rower = {"UpperLeg": (-900, 300), "LowerLeg": (-450, 450), "Foot": (0, 300), "UpperArm": (-950, 800)}
    recording = read_recording(written(tmp_path, walk_of(rower, (0, 1, 2), ("Left", "Right"))))
    assert recording.up_axis == "+y"
    lying = {name: (height, 100) for name, (_, height) in SEGMENTS_MM.items()}
    recording = read_recording(written(tmp_path, walk_of(lying, (0, 1, 2), ("Left", "Right"))))
    assert recording.up_axis == "+x"


def test_a_file_too_large_to_read_is_refused_before(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(trc_mot, "MAX_MEMBER_BYTES", 2**10)
    with pytest.raises(UnreadableFile) as refusal:
        read_recording(written(tmp_path, trc()))
    assert refusal.value.code == "trc-too-large"
    assert "walk.trc" in refusal.value.message


def blank_separated(names: tuple[str, ...], gap: str, row_gap: str, before: str = "") -> str:
    """A TRC file whose header has blanks in place of tabs, and whose rows are separated by ``row_gap``."""
    lines = trc().splitlines()
    head = [" ".join(line.split()) + "  " for line in lines[:3]]
    rows = [before + row_gap.join(line.split("\t")) + " " for line in lines[6:]]
    return "\n".join([*head, gap.join(["Frame#", "Time", *names]), "   X1   Y1   Z1", "", *rows])


@pytest.mark.parametrize(
    ("row_gap", "before"), [("\t", ""), ("\t", "\t"), ("   ", "  ")], ids=["tabs", "indented", "blanks"]
)
@pytest.mark.parametrize("names", [LABELS, tuple(label.replace(".", " ") for label in LABELS)], ids=["words", "spaced"])
def test_blanks_separate_a_header_without_tabs(
    names: tuple[str, ...], row_gap: str, before: str, tmp_path: Path
) -> None:
    recording = read_recording(written(tmp_path, blank_separated(names, "     ", row_gap, before)))
    assert list(recording.markers_m) == list(names)
    for label, track in read_recording(written(tmp_path, trc())).markers_m.items():
        np.testing.assert_array_equal(recording.markers_m[names[LABELS.index(label)]], track)


def test_single_blanks_separate_names_without_any(tmp_path: Path) -> None:
    assert list(read_recording(written(tmp_path, blank_separated(LABELS, " ", " "))).markers_m) == list(LABELS)


def test_ambiguous_blanks_are_refused(tmp_path: Path) -> None:
    """Names with blanks between single blanks, and a row in which a value is absent: no place can be told."""
    spaced = tuple(label.replace(".", " ") for label in LABELS)
    with pytest.raises(UnreadableFile, match=r"line 4 holds no tabs, .* nor 5 names between blanks"):
        read_recording(written(tmp_path, blank_separated(spaced, " ", "\t")))
    lines = blank_separated(LABELS, "  ", " ").splitlines()
    for absent in (1, 3):
        lines[8] = " ".join(lines[8].split()[:-absent])
        with pytest.raises(UnreadableFile, match=r"line 9 has 1\d of 17 values"):
            read_recording(written(tmp_path, "\n".join(lines)))
