"""A recording as laboratories hand it to OpenSim: markers in a TRC file, contacts in a MOT file, y up, in a zip.

Or the TRC file alone.
"""

import zipfile
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from stridelab.conventions import Points
from stridelab.recordings.plate_contacts import centre_of_pressure_m
from stridelab.recordings.recording import Recording

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
