"""Recordings as other programs export them: QTM, Nexus, MVN and OpenSim.

A recording as Qualisys Track Manager and Vicon Nexus export it as text: z up, mm, N and N mm.

Small MVNX files of a body that walks in closed form, with the points and the centre of mass of Xsens MVN.

A recording as laboratories hand it to OpenSim: markers in a TRC file, contacts in a MOT file, y up, in a zip.

Or the TRC file alone.
"""

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfiltfilt

from stridelab.conventions import Points
from stridelab.recordings.plate_contacts import centre_of_pressure_m
from stridelab.recordings.recording import Plate, Recording

CORNER_NAMES = ("POSX_POSY", "NEGX_POSY", "NEGX_NEGY", "POSX_NEGY")


def plate_columns(plate: Plate) -> tuple[Points, Points, Points]:
    """Force on the body, moment about the plate's centre and centre of pressure, zero while unloaded, in SI units."""
    cop_m = np.nan_to_num(centre_of_pressure_m(plate))
    cop_m[~plate.loaded] = 0.0
    return plate.force_n, plate.moment_nm - np.cross(plate.corners_m.mean(axis=0), plate.force_n), cop_m


def text_rows(table: np.ndarray, mark: str) -> list[str]:
    return [mark.join("" if np.isnan(x) else f"{x:.6g}" if abs(x) < 1 else f"{x:.6f}" for x in row) for row in table]


def qualisys_markers(recording: Recording, *, numbered: bool = False, start_s: float = 0.0) -> str:
    labels, n = list(recording.markers_m), recording.n_frames
    head = (
        f"NO_OF_FRAMES\t{n}\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t{len(labels)}\nFREQUENCY\t{recording.marker_rate_hz:g}\n"
    )
    head += "NO_OF_ANALOG\t0\nANALOG_FREQUENCY\t0\nDESCRIPTION\t--\nTIME_STAMP\t2026-01-01\t1.5\nDATA_INCLUDED\t3D\n"
    head += "MARKER_NAMES\t" + "\t".join(labels) + "\n"
    table = np.column_stack([1e3 * track for track in recording.markers_m.values()])
    if numbered:
        head += "Frame\tTime\t" + "\t".join(f"{label} {axis}" for label in labels for axis in "XYZ") + "\n"
        table = np.column_stack([np.arange(1, n + 1), start_s + recording.time_s, table])
    return head + "\n".join(text_rows(table, "\t")) + "\n"


def qualisys_forces(
    plate: Plate,
    rate_hz: float,
    *,
    numbered: bool = False,
    start_s: float = 0.0,
    local: bool = False,
    moment_mm: bool = True,
) -> str:
    """Forces in the laboratory's axes; ``local``: in those of the plate, which its four corners give.

    Moments are in N mm, or N m.
    """
    force_n, moment_nm, cop_m = plate_columns(plate)
    head = f"NO_OF_SAMPLES\t{len(force_n)}\nFREQUENCY\t{rate_hz:g}\n"
    if local:
        pp, np_, _, pn = plate.corners_m
        x, y = (one / np.linalg.norm(one) for one in (pp - np_, pp - pn))
        axes = np.array([x, y, np.cross(x, y)])
        cop_m = np.where(plate.loaded[:, None], (cop_m - plate.corners_m.mean(axis=0)) @ axes.T, 0.0)
        force_n, moment_nm = force_n @ axes.T, moment_nm @ axes.T
        head += "DESCRIPTION\tForce data in local (force plate) coordinates\n"
    head += f"TIME_STAMP\t2026-01-01\nFORCE_PLATE_NAME\tAMTI {plate.index}\n"
    for name, corner in zip(CORNER_NAMES, plate.corners_m, strict=True):
        for axis, x in zip("XYZ", corner, strict=True):
            head += f"FORCE_PLATE_CORNER_{name}_{axis}\t{1e3 * x:.6f}\n"
    table = np.column_stack([force_n, (1e3 if moment_mm else 1.0) * moment_nm, 1e3 * cop_m])
    if numbered:
        head += "SAMPLE\tTIME\tForce_X\tForce_Y\tForce_Z\tMoment_X\tMoment_Y\tMoment_Z\tCOP_X\tCOP_Y\tCOP_Z\n"
        table = np.column_stack([np.arange(1, len(table) + 1), start_s + np.arange(len(table)) / rate_hz, table])
    return head + "\n".join(text_rows(table, "\t")) + "\n"


def write_qualisys(path: Path, recording: Recording, *, numbered: bool = False) -> Path:
    """Write a zip of the markers and of one file of forces per plate."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("walk.tsv", qualisys_markers(recording, numbered=numbered))
        for plate in recording.plates:
            text = qualisys_forces(plate, recording.force_rate_hz, numbered=numbered)
            archive.writestr(f"walk_f_{plate.index}.tsv", text)
    return path


def nexus_csv(recording: Recording, *, mark: str = ",", first_frame: int = 1, sections: Sequence[str] = ()) -> str:
    """Sections Devices and Trajectories; the force is that on the plate, and ``sections`` come first."""
    ratio = round(recording.force_rate_hz / recording.marker_rate_hz)
    devices = []
    for plate in recording.plates:
        force_n, moment_nm, cop_m = plate_columns(plate)
        devices += [-force_n, -1e3 * moment_nm, 1e3 * cop_m]
    parts = list(sections)
    if devices:
        k = np.arange(len(devices[0]))
        names = "".join(f"AMTI {p.index} - {kind},,," for p in recording.plates for kind in ("Force", "Moment", "CoP"))
        columns = ",".join(f"{kind}{axis}" for _ in recording.plates for kind in "FMC" for axis in "xyz")
        units = ",".join(["N,N,N,N.mm,N.mm,N.mm,mm,mm,mm"] * len(recording.plates))
        rows = text_rows(np.column_stack([first_frame + k // ratio, k % ratio, *devices]), ",")
        head = ["Devices", f"{recording.force_rate_hz:g}", f",,{names}", f"Frame,Sub Frame,{columns}", f",,{units}"]
        parts.append("\n".join([*head, *rows]))
    labels, n = list(recording.markers_m), recording.n_frames
    head = [
        "Trajectories",
        f"{recording.marker_rate_hz:g}",
        ",," + ",,,".join(f"Ann:{label}" for label in labels) + ",,",
    ]
    head += ["Frame,Sub Frame," + ",".join("XYZ" * len(labels)), ",," + ",".join(["mm"] * 3 * len(labels))]
    table = np.column_stack([np.arange(n) + first_frame, np.zeros(n), *(1e3 * t for t in recording.markers_m.values())])
    parts.append("\n".join([*head, *text_rows(table, ",")]))
    return ("\n\n".join(parts) + "\n").replace(",", mark)


RATE_HZ = 60.0
SPEED_M_S = 1.1
_PAIRED = {
    "UpperLeg": (0.0, 0.1, 0.9),
    "LowerLeg": (0.0, 0.1, 0.5),
    "Foot": (0.0, 0.1, 0.1),
    "Toe": (0.15, 0.1, 0.02),
    "UpperArm": (0.0, 0.2, 1.4),
    "ForeArm": (0.0, 0.2, 1.1),
    "Hand": (0.0, 0.2, 0.85),
}
SEGMENTS = {"Pelvis": (0.0, 0.0, 0.95), "T8": (0.0, 0.0, 1.3), "Neck": (0.0, 0.0, 1.5)}
SEGMENTS |= {f"Left{name}": place for name, place in _PAIRED.items()}
SEGMENTS |= {f"Right{name}": (x, -y, z) for name, (x, y, z) in _PAIRED.items()}
COM_M = np.array([0.01, 0.0, 0.98])
POINT_M = np.array([0.08, 0.02, -0.03])
"""Place of the one point of each segment in its frame."""


def yaw_rad(frame: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return np.asarray(0.3 * np.sin(0.1 * frame))


def mvnx_text(*, n_frames: int = 60, points: bool = True, com: bool = True, listed: bool = True, head: str = "") -> str:
    """A file with two calibration poses before the motion; every segment turns by ``yaw_rad`` about the vertical."""
    segments = ""
    if listed:
        point = f"<points><point label='p{{}}'><pos_b>{_text(POINT_M)}</pos_b></point></points>" if points else ""
        segments = "".join(f"<segment label='{s}' id='{k}'>{point.format(s)}</segment>" for k, s in enumerate(SEGMENTS))
        segments = f"<segments>{segments}</segments>"
    frames = "".join(f"<frame type='{pose}'><position>0 0 0</position></frame>" for pose in ("identity", "tpose"))
    for k in range(n_frames):
        shift = np.array([SPEED_M_S * k / RATE_HZ, 0.0, 0.0])
        half = 0.5 * float(yaw_rad(np.array([k]))[0])
        turn = f"{np.cos(half):.9f} 0 0 {np.sin(half):.9f} " * len(SEGMENTS)
        place = " ".join(_text(np.array(one) + shift) for one in SEGMENTS.values())
        centre = f"<centerOfMass>{_text(COM_M + shift)} 1.1 0 0 0 0 0</centerOfMass>" if com else ""
        frames += (
            f"<frame time='{k}' type='normal'><orientation>{turn}</orientation><position>{place}</position>"
            f"<velocity>not read</velocity>{centre}</frame>"
        )
    return (
        f"<?xml version='1.0' encoding='UTF-8'?>\n{head}<mvnx version='4'><mvn version='2021'/>"
        f"<subject label='Anna' frameRate='{RATE_HZ:g}' segmentCount='{len(SEGMENTS)}' "
        f"recDate='Thu Nov 27 12:13:17.238 2025'>{segments}<frames>{frames}</frames></subject></mvnx>\n"
    )


def _text(numbers: np.ndarray) -> str:
    return " ".join(f"{number:.9f}" for number in numbers)


FILTER_HZ = 6.0


def y_up(points: Points) -> Points:
    return np.column_stack([points[:, 0], points[:, 2], -points[:, 1]])


def write_trc(path: Path, recording: Recording) -> Path:
    """Write the markers alone, in metres, y up."""
    path.write_text(_trc(recording), encoding="utf-8")
    return path


def write_trc_mot(path: Path, recording: Recording) -> Path:
    """Write both texts; the centre of pressure is low-passed together with the zeros of the unloaded plate.

    This filter is a habit of laboratories: at small loads it draws the centre of pressure towards the origin.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("walk.trc", _trc(recording))
        archive.writestr("walk_grf.mot", _mot(recording))
    return path


def _trc(recording: Recording) -> str:
    labels, rate_hz = list(recording.markers_m), recording.marker_rate_hz
    head = (
        f"PathFileType\t4\t(X/Y/Z)\twalk.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n{rate_hz}\t{rate_hz}"
    )
    head += (
        f"\t{recording.n_frames}\t{len(labels)}\tm\nFrame#\tTime\t"
        + "\t\t\t".join(labels)
        + "\t\t\t\n\t\tX1\tY1\tZ1\n\n"
    )
    tracks = np.column_stack([recording.time_s, *(y_up(track) for track in recording.markers_m.values())])
    rows = ("\t".join([str(i + 1), *(f"{x:.7f}" for x in row)]) for i, row in enumerate(tracks))
    return head + "\n".join(rows) + "\n"


def _mot(recording: Recording) -> str:
    sos = butter(2, FILTER_HZ, fs=recording.force_rate_hz, output="sos")
    n = len(recording.plates[0].force_n)
    columns, tracks = ["time"], [np.arange(n)[:, None] / recording.force_rate_hz]
    for plate in recording.plates:
        prefix = f"{plate.index}_ground_"
        columns += [f"{prefix}force_{kind}{axis}" for kind in "vp" for axis in "xyz"]
        columns += [f"{prefix}torque_{axis}" for axis in "xyz"]
        cop = sosfiltfilt(sos, np.nan_to_num(centre_of_pressure_m(plate)), axis=0)
        free = plate.moment_nm - np.cross(cop, plate.force_n)
        free[~plate.loaded] = 0.0
        tracks += [y_up(plate.force_n), y_up(cop), y_up(free)]
    head = f"walk_grf.mot\nversion=1\nnRows={n}\nnColumns={len(columns)}\ninDegrees=yes\nendheader\n"
    rows = ("\t".join(f"{x:.7g}" for x in row) for row in np.column_stack(tracks))
    return head + "\t".join(columns) + "\n" + "\n".join(rows) + "\n"
