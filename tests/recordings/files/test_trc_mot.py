"""OpenSim pairs: header and column dialects, times, units, wrench at the world origin."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import UnreadableFile
from stridelab.recordings.files.text_table import sampling_rate_hz
from stridelab.recordings.files.trc_mot import parse_mot
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording

RATE, FORCE_RATE, N = 100.0, 600.0, 150
LABELS = ["R.ASIS", "L.ASIS", "V.Sacral", "Top.Head", "R.Heel", "L.Heel"]
TIME = np.arange(N) / RATE
FORCE_TIME = np.arange(6 * N) / FORCE_RATE


def body() -> np.ndarray:
    """Six markers in metres, Y up, walking along +X."""
    rest = np.array([[0, 1.0, 0.1], [0, 1.0, -0.1], [-0.1, 1.0, 0], [0, 1.7, 0], [0, 0.05, 0.1], [0, 0.05, -0.1]])
    return rest + np.column_stack([1.2 * TIME, 0 * TIME, 0 * TIME])[:, None, :]


def wrench() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force, centre of pressure and free moment, Y up; the foot stands from 0.5 to 1.2 s."""
    on = ((FORCE_TIME > 0.5) & (FORCE_TIME < 1.2))[:, None]
    f = np.column_stack([40 * np.sin(5 * FORCE_TIME), 650 + 90 * np.sin(8 * FORCE_TIME), 15 + 0 * FORCE_TIME]) * on
    p = np.column_stack([0.3 + 0.2 * FORCE_TIME, 0 * FORCE_TIME, 0.1 + 0 * FORCE_TIME])
    T = np.column_stack([0 * FORCE_TIME, 4 * np.sin(7 * FORCE_TIME), 0 * FORCE_TIME]) * on
    return f, p, T


def trc(points: np.ndarray, unit: str = "mm", start_s: float = 0.0) -> str:
    head = f"PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n{RATE}\t{RATE}\t"
    head += f"{len(points)}\t{len(LABELS)}\t{unit}\nFrame#\tTime\t" + "\t\t\t".join(LABELS)
    head += "\t\t\t\n\t\tX1\tY1\tZ1\n\n"
    rows = []
    for i, frame in enumerate(points):
        cells = ["" if np.isnan(x) else f"{x:.6f}" for x in frame.ravel()]
        rows.append("\t".join([str(i + 1), f"{start_s + i / RATE:.6f}", *cells]))
    return head + "\n".join(rows) + "\n"


def names(prefix: str, suffix: str) -> list[str]:
    force = [f"{prefix}ground_force{suffix}_{kind}{axis}" for kind in "vp" for axis in "xyz"]
    return force + [f"{prefix}ground_torque{suffix}_{axis}" for axis in "xyz"]


def mot(columns: list[str], values: np.ndarray, header: str, *, digits: int = 6, start_s: float = 0.0) -> str:
    rows = [
        "\t".join([f"{start_s + t:.{digits}f}", *(f"{x:.9g}" for x in row)])
        for t, row in zip(FORCE_TIME, values, strict=True)
    ]
    return header + "endheader\n" + "\t".join(["time", *columns]) + "\n" + "\n".join(rows) + "\n"


def marker_storage(*, vectors: bool) -> str:
    """The markers of ``body`` in metres as an STO file, with three columns a marker or one of vectors."""
    mark = "," if vectors else "\t"
    names = [f"/model/{label}/location" for label in LABELS]
    if not vectors:
        names = [f"{label}_t{axis}" for label in LABELS for axis in "xyz"]
    rows = [
        "\t".join([f"{k / RATE:.4f}", *(mark.join(f"{x:.6f}" for x in point) for point in frame)])
        for k, frame in enumerate(body())
    ]
    head = "DataType=Vec3\nversion=2\n" if vectors else f"markers\nnRows={N}\n"
    return head + "endheader\n" + "\t".join(["time", *names]) + "\n" + "\n".join(rows) + "\n"


@pytest.mark.parametrize("vectors", [True, False])
def test_markers_in_an_sto_file_are_those_of_the_trc_file(vectors: bool, tmp_path: Path) -> None:
    f, p, T = wrench()
    forces = mot(names("", ""), np.column_stack([f, p, T]), "grf\n")
    read = []
    for name, text in (("markers.sto", marker_storage(vectors=vectors)), ("markers.trc", trc(1000.0 * body()))):
        with zipfile.ZipFile(tmp_path / "trial.zip", "w") as archive:
            archive.writestr(name, text)
            archive.writestr("grf.sto", forces)
        read.append(read_recording(tmp_path / "trial.zip"))
        (tmp_path / name).write_text(text, encoding="utf-8")
        assert not read_recording(tmp_path / name).plates
    assert set(read[0].markers_m) == set(LABELS)
    for label in LABELS:
        np.testing.assert_allclose(read[0].markers_m[label], read[1].markers_m[label], atol=1e-6)
    np.testing.assert_allclose(read[0].plates[0].force_n, read[1].plates[0].force_n, atol=1e-6)


def test_a_broken_marker_sto_is_refused_by_its_line(tmp_path: Path) -> None:
    text = marker_storage(vectors=True).replace("0.1000\t", "0.1000\tmuch,")
    (tmp_path / "markers.sto").write_text(text, encoding="utf-8")
    with pytest.raises(UnreadableFile, match=r"markers\.sto is broken: line 15") as refused:
        read_recording(tmp_path / "markers.sto")
    assert refused.value.code == "sto-broken"


HEADERS = {
    "nRows": f"grf.mot\t\t\t\nversion=1\t\nnRows={len(FORCE_TIME)}\nnColumns=10\ninDegrees=yes\n",
    "datarows": f"name grf.mot\ndatacolumns 10\ndatarows {len(FORCE_TIME)}\nrange 0 1.5\n",
}


def read(folder: Path, members: dict[str, str]) -> Recording:
    path = folder / "trial.zip"
    with zipfile.ZipFile(path, "w") as packed:
        for name, text in members.items():
            packed.writestr(name, text)
    return read_recording(path)


def values() -> np.ndarray:
    return np.hstack(wrench())


def z_up(x: np.ndarray) -> np.ndarray:
    return np.stack([x[..., 0], -x[..., 2], x[..., 1]], axis=-1)


def check(recording: Recording) -> None:
    f, p, T = wrench()
    (plate,) = recording.plates
    np.testing.assert_allclose(plate.force_n, z_up(f), atol=1e-5)
    np.testing.assert_allclose(plate.moment_nm, z_up(np.cross(p, f) + T), atol=1e-4)


@pytest.mark.parametrize("dialect", HEADERS)
@pytest.mark.parametrize(("prefix", "suffix"), [("", ""), ("1_", ""), ("", "_r"), ("", "1")])
def test_dialects_give_the_wrench_at_the_world_origin(dialect: str, prefix: str, suffix: str, tmp_path: Path) -> None:
    members = {"a.trc": trc(1000 * body()), "a.mot": mot(names(prefix, suffix), values(), HEADERS[dialect])}
    recording = read(tmp_path, members)
    assert recording.up_axis == "+y"
    assert (recording.marker_rate_hz, recording.force_rate_hz) == (100.0, 600.0)
    np.testing.assert_allclose(recording.markers_m["Top.Head"], z_up(body()[:, 3]), atol=1e-8)
    np.testing.assert_allclose(recording.walking_direction, [1, 0, 0], atol=1e-9)
    check(recording)


@pytest.mark.parametrize(("first", "second"), [("_r", "_l"), ("1", "2")])
def test_two_contacts_are_distinguished(first: str, second: str) -> None:
    two = np.hstack([values(), 2 * values()])
    _, contacts = parse_mot(mot(names("", first) + names("", second), two, HEADERS["nRows"]), "a.mot")
    first, second = first.strip("_"), second.strip("_")
    assert set(contacts) == {first, second}
    np.testing.assert_allclose(contacts[second]["v"], 2 * contacts[first]["v"], rtol=1e-6)


def test_rounded_times_do_not_change_the_rate(tmp_path: Path) -> None:
    """Four digits at 600 Hz: single steps look like 588 or 625 Hz."""
    text = mot(names("", ""), values(), HEADERS["nRows"], digits=4)
    recording = read(tmp_path, {"a.trc": trc(1000 * body()), "a.mot": text})
    assert recording.force_rate_hz == 600.0
    assert sampling_rate_hz(np.round(np.arange(901) / 600.0, 4)) == 600.0


def test_nonsense_centres_of_pressure_of_an_empty_plate_do_no_harm(tmp_path: Path) -> None:
    nonsense = values()
    empty = np.linalg.norm(nonsense[:, :3], axis=1) == 0.0
    nonsense[empty, 3:6] = [331.7, 0.0, -495.9]
    members = {"a.trc": trc(1000 * body()), "a.mot": mot(names("", ""), nonsense, HEADERS["nRows"])}
    recording = read(tmp_path, members)
    check(recording)
    assert np.abs(recording.plates[0].corners_m).max() < 2.0


def test_light_contact_uses_the_nearest_meaningful_centre_of_pressure(tmp_path: Path) -> None:
    """5 N at a COP of 300 m would be 1500 Nm."""
    light = values()
    late = FORCE_TIME >= 1.2
    light[late, 1] = 5.0
    light[late, 3:6] = [300.0, 0.0, 0.0]
    members = {"a.trc": trc(1000 * body()), "a.mot": mot(names("", ""), light, HEADERS["nRows"])}
    (plate,) = read(tmp_path, members).plates
    assert np.abs(plate.moment_nm[late]).max() < 5.0


@pytest.mark.parametrize(("rows", "bridged"), [(17, True), (24, False)])
def test_a_short_gap_of_the_forces_is_bridged_and_named(rows: int, bridged: bool, tmp_path: Path) -> None:
    """Zeros in its place would be half a weight for some milliseconds; at 600 Hz, 30 ms are 18 rows."""
    holed, at = values(), int(np.argmax(values()[:, 1] > 0.5 * values()[:, 1].max()))
    holed[at : at + rows] = np.nan
    members = {"a.trc": trc(1000 * body()), "a.mot": mot(names("", ""), holed, HEADERS["nRows"])}
    recording = read(tmp_path, members)
    force_n = z_up(wrench()[0])
    between = np.linspace(force_n[at - 1], force_n[at + rows], rows + 2)[1:-1] if bridged else np.zeros((rows, 3))
    np.testing.assert_allclose(recording.plates[0].force_n[at : at + rows], between, atol=1e-5)
    assert ("force-samples-missing" in {remark.code for remark in recording.remarks}) == bridged


def test_metres_are_recognised_under_a_wrong_unit(tmp_path: Path) -> None:
    force = mot(names("", ""), values(), HEADERS["nRows"])
    metres = read(tmp_path, {"a.trc": trc(body(), unit="m"), "a.mot": force})
    np.testing.assert_allclose(metres.markers_m["R.Heel"], z_up(body()[:, 4]), atol=1e-5)
    wrong = read(tmp_path, {"a.trc": trc(body(), unit="mm"), "a.mot": force})
    assert "unit-corrected" in {remark.code for remark in wrong.remarks}
    np.testing.assert_allclose(wrong.markers_m["R.Heel"], metres.markers_m["R.Heel"])


def test_blank_cells_are_gaps(tmp_path: Path) -> None:
    points = 1000 * body()
    points[20:60, 3] = np.nan
    recording = read(tmp_path, {"a.trc": trc(points), "a.mot": mot(names("", ""), values(), HEADERS["nRows"])})
    assert np.isnan(recording.markers_m["Top.Head"][20:60]).all()
    assert not np.isnan(recording.markers_m["Top.Head"][:20]).any()


def test_both_clocks_may_start_late(tmp_path: Path) -> None:
    """Markers from 2.0 s, forces from 1.9 s: the force is read at the markers' times."""
    text = mot(names("", ""), values(), HEADERS["nRows"], start_s=1.9)
    recording = read(tmp_path, {"a.trc": trc(1000 * body(), start_s=2.0), "a.mot": text})
    f, _, _ = wrench()
    at = round(0.1 * FORCE_RATE)
    n = len(recording.plates[0].force_n)
    np.testing.assert_allclose(recording.plates[0].force_n, z_up(f[at : at + n]), atol=1e-3)
    assert "cut-to-common-time" in {remark.code for remark in recording.remarks}
    assert recording.duration_s == pytest.approx(1.4, abs=0.02)


def test_markers_alone_are_a_recording_without_plates(tmp_path: Path) -> None:
    recording = read(tmp_path, {"static.trc": trc(1000 * body())})
    assert recording.plates == ()
    assert "no-force-file" in {remark.code for remark in recording.remarks}
    assert recording.up_axis == "+y"


def test_joint_angles_beside_the_forces_are_ignored(tmp_path: Path) -> None:
    angles = "Coordinates\nversion=1\nnRows=1\nnColumns=2\nendheader\ntime\tknee_angle\n0\t1\n"
    force = mot(names("", ""), values(), HEADERS["nRows"])
    check(read(tmp_path, {"a.trc": trc(1000 * body()), "a.sto": force, "ik.mot": angles}))


@pytest.mark.parametrize(
    "written", ["nan", "NaN", "-nan", "-nan(ind)", "nan(snan)", "-1.#IND", "1.#QNAN0", "-1.#IND00"]
)
def test_nan_is_read_as_the_libraries_of_c_print_it(written: str) -> None:
    f, p, T = wrench()
    values = np.hstack([f, p, T])
    text = mot(names("", ""), values, "forces\nnRows=900\n")
    lines = text.splitlines()
    cells = lines[10].split("\t")
    cells[4] = written
    lines[10] = "\t".join(cells)
    _, contacts = parse_mot("\n".join(lines), "grf.mot")
    (contact,) = contacts.values()
    assert np.argwhere(np.isnan(contact["p"])).tolist() == [[6, 0]]


@pytest.mark.parametrize("written", ["1.#INF", "nano", "1.#", "nan(ind", "--nan"])
def test_what_is_no_number_and_no_nan_stays_refused(written: str) -> None:
    f, p, T = wrench()
    text = mot(names("", ""), np.hstack([f, p, T]), "forces\nnRows=900\n")
    lines = text.splitlines()
    lines[10] = lines[10].replace(lines[10].split("\t")[4], written, 1)
    with pytest.raises(UnreadableFile, match="which is not a number"):
        parse_mot("\n".join(lines), "grf.mot")
