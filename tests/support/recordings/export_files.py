"""A recording as Qualisys Track Manager and Vicon Nexus export it as text: z up, mm, N and N mm."""

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

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


def qualisys_markers(recording: Recording, *, numbered: bool = False) -> str:
    labels, n = list(recording.markers_m), recording.n_frames
    head = (
        f"NO_OF_FRAMES\t{n}\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t{len(labels)}\nFREQUENCY\t{recording.marker_rate_hz:g}\n"
    )
    head += "NO_OF_ANALOG\t0\nANALOG_FREQUENCY\t0\nDESCRIPTION\t--\nTIME_STAMP\t2026-01-01\t1.5\nDATA_INCLUDED\t3D\n"
    head += "MARKER_NAMES\t" + "\t".join(labels) + "\n"
    table = np.column_stack([1e3 * track for track in recording.markers_m.values()])
    if numbered:
        head += "Frame\tTime\t" + "\t".join(f"{label} {axis}" for label in labels for axis in "XYZ") + "\n"
        table = np.column_stack([np.arange(1, n + 1), recording.time_s, table])
    return head + "\n".join(text_rows(table, "\t")) + "\n"


def qualisys_forces(plate: Plate, rate_hz: float, *, numbered: bool = False) -> str:
    force_n, moment_nm, cop_m = plate_columns(plate)
    head = f"NO_OF_SAMPLES\t{len(force_n)}\nFREQUENCY\t{rate_hz:g}\n"
    head += f"TIME_STAMP\t2026-01-01\nFORCE_PLATE_NAME\tAMTI {plate.index}\n"
    for name, corner in zip(CORNER_NAMES, plate.corners_m, strict=True):
        for axis, x in zip("XYZ", corner, strict=True):
            head += f"FORCE_PLATE_CORNER_{name}_{axis}\t{1e3 * x:.6f}\n"
    table = np.column_stack([force_n, 1e3 * moment_nm, 1e3 * cop_m])
    if numbered:
        head += "SAMPLE\tTIME\tForce_X\tForce_Y\tForce_Z\tMoment_X\tMoment_Y\tMoment_Z\tCOP_X\tCOP_Y\tCOP_Z\n"
        table = np.column_stack([np.arange(1, len(table) + 1), np.arange(len(table)) / rate_hz, table])
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
