"""Assembles a trial from markers and plate forces that a motion capture program exported as text.

Such exports give per plate the force F, the moment M about a fixed point and the centre of pressure p, all in the
laboratory's axes. They do not state whether F acts on the plate or on the body, nor about which point M is taken. The
columns decide both. The force on the body points from p to the markers. With the point c,

    M - (p - c) x F = (0, 0, T)  in the plate's axes,   so that on a level plate with the normal z

    c_x = p_x + M_y / F_z,   c_y = p_y - M_x / F_z    (at the height of the surface)

are constant; if they are not, the free moment T is unknown and is set to zero, with a remark.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.conventions import Corners, Points, Vector3
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files import metadata as names
from stridelab.recordings.files.metadata import length_scale
from stridelab.recordings.files.raw import CONTACT_TYPE, NO_FORCE_FILE, Cloud, FilePlate, RawTrial
from stridelab.recordings.files.trc_mot import COP_THRESHOLD_N, bounding_rectangle
from stridelab.recordings.force_plates import corners_fault, plate_axes
from stridelab.recordings.gap_filling import bridge_force_gaps, mark_missing
from stridelab.recordings.orientation import axis_vector, nearest_axis
from stridelab.recordings.recording import Remark, Subject

PRESSURE_TYPE: Final = 1
"""``Plate.type`` of a plate with corners whose centre of pressure and free moment are given."""
_MAX_SPREAD_M: Final = 0.01
_MIN_ON_PLATE: Final = 0.5


@dataclass(frozen=True)
class ExportedMarkers:
    """Labels and positions (in the file's unit of length ``unit``) of a file of the name ``name``."""

    name: str
    labels: Sequence[str]
    points: Cloud
    rate_hz: float
    unit: str


@dataclass(frozen=True)
class ExportedPlate:
    """Force in N, moment in Nm and centre of pressure in m of one plate, n x 3 each, in the laboratory's axes."""

    name: str
    force_n: Points
    moment_nm: Points
    cop_m: Points
    corners_m: Corners | None = None


def assemble_export(
    markers: ExportedMarkers, plates: Sequence[ExportedPlate], force_rate_hz: float, remarks: Sequence[Remark] = ()
) -> RawTrial:
    """Trial of exported markers and plates that begin at the same time; the longer of both is cut.

    Raises ``UnreadableFile`` (``forces-elsewhere``) if the centres of pressure do not lie between the plate's corners.
    """
    cloud = mark_missing(markers.points)
    scale, unit_remarks = length_scale(markers.unit, cloud)
    visible = [int(n) for n in (~np.isnan(cloud[:, :, 0])).sum(axis=0)]
    choice = names.select_labels(markers.labels, visible, (), ())
    points_m = cloud[:, list(choice.column.values()), :] * scale
    remarks = [*choice.remarks, *unit_remarks, *remarks]
    if plates:
        ratio = force_rate_hz / markers.rate_hz
        n_frames = min(len(points_m), *(int(len(plate.force_n) / ratio) for plate in plates))
        if n_frames < len(points_m):
            message = f"{len(points_m) - n_frames} frames have no force and were cut off."
            remarks.append(Remark("cut-to-common-time", message))
        points_m = points_m[:n_frames]
        plates = [_cut(plate, int(np.ceil(n_frames * ratio))) for plate in plates]
    else:
        message = f"{markers.name} holds markers only, no ground forces."
        remarks.append(Remark(NO_FORCE_FILE, message))
    contacts = []
    for index, plate in enumerate(plates, start=1):
        whole, gaps = _without_gaps(plate, force_rate_hz)
        contact, more = _contact(index, whole, points_m)
        remarks += [*gaps, *more]
        contacts += [] if contact is None else [contact]
    return RawTrial(
        labels=tuple(choice.column),
        outputs=choice.outputs,
        points_m=points_m,
        marker_rate_hz=markers.rate_hz,
        force_rate_hz=force_rate_hz if contacts else markers.rate_hz,
        plates=(),
        contacts=tuple(contacts),
        subject=Subject(),
        events=(),
        up_hint="+z",
        remarks=tuple(remarks),
        metres_per_unit=scale,
    )


def _cut(plate: ExportedPlate, n: int) -> ExportedPlate:
    return ExportedPlate(plate.name, plate.force_n[:n], plate.moment_nm[:n], plate.cop_m[:n], plate.corners_m)


def _without_gaps(plate: ExportedPlate, rate_hz: float) -> tuple[ExportedPlate, tuple[Remark, ...]]:
    force_n, remarks = bridge_force_gaps(plate.force_n, rate_hz, plate.name)
    moment_nm, cop_m = (bridge_force_gaps(track, rate_hz, "")[0] for track in (plate.moment_nm, plate.cop_m))
    return ExportedPlate(plate.name, force_n, moment_nm, cop_m, plate.corners_m), remarks


def _contact(index: int, plate: ExportedPlate, points_m: Cloud) -> tuple[FilePlate | None, list[Remark]]:
    """Wrench on the body about the file's origin, and remarks; None for a plate that is never loaded."""
    force_n, moment_nm, cop_m = plate.force_n, plate.moment_nm, plate.cop_m
    loaded = np.linalg.norm(force_n, axis=1) > COP_THRESHOLD_N
    if not loaded.any() or not np.isfinite(points_m).any():
        return None, [Remark("plate-unloaded", f"The plate {plate.name} is never loaded and was left out.")]
    centre_m: Vector3 = np.nanmean(points_m, axis=(0, 1))
    total_n: Vector3 = force_n[loaded].sum(axis=0)
    if float(total_n @ (centre_m - cop_m[loaded].mean(axis=0))) < 0.0:
        force_n, moment_nm, total_n = -force_n, -moment_nm, -total_n
    up = axis_vector(nearest_axis(total_n) or "+z")
    if plate.corners_m is not None and _share_between(plate.corners_m, cop_m[loaded]) < _MIN_ON_PLATE:
        message = (
            f"The centres of pressure of {plate.name} do not lie between the corners of its plate. Export forces and "
            "centres of pressure in the coordinates of the laboratory."
        )
        raise UnreadableFile("forces-elsewhere", message, [Fault(plate.name, "not in the laboratory's axes")])
    free_nm, remarks = _free_moment_nm(plate.name, force_n, moment_nm, cop_m, loaded, up)
    sample = np.arange(len(cop_m))
    cop_m = np.column_stack([np.interp(sample, sample[loaded], cop_m[loaded, j]) for j in range(3)])
    corners_m = bounding_rectangle(cop_m[loaded], up) if plate.corners_m is None else plate.corners_m
    kind = CONTACT_TYPE if plate.corners_m is None else PRESSURE_TYPE
    about_origin_nm = np.cross(cop_m, force_n) + free_nm
    return FilePlate(index, kind, corners_m, force_n, about_origin_nm, np.zeros(3)), remarks


def _share_between(corners_m: Corners, cop_m: Points) -> float:
    """Share of centres of pressure between the corners; 1 for corners that bound no plate."""
    if corners_fault(corners_m) is not None:
        return 1.0
    local = (cop_m - corners_m.mean(axis=0)) @ plate_axes(corners_m)
    half = 0.5 * np.array(
        [np.linalg.norm(corners_m[0] - corners_m[1]), np.linalg.norm(corners_m[0] - corners_m[3])], dtype=np.float64
    )
    return float((np.abs(local[:, :2]) <= half + 0.02).all(axis=1).mean())


def _free_moment_nm(
    name: str, force_n: Points, moment_nm: Points, cop_m: Points, loaded: np.ndarray, up: Vector3
) -> tuple[Points, list[Remark]]:
    """The moment about ``up`` at the centre of pressure, and a remark if it does not follow from the columns."""
    f, M, p = force_n[loaded], moment_nm[loaded], cop_m[loaded]
    normal_n = f @ up
    heavy = np.abs(normal_n) > 0.5 * np.abs(normal_n).max()
    arm_m = np.cross(up, M[heavy]) / normal_n[heavy, None]
    points_m = p[heavy] - arm_m
    level = np.ones(3) - np.abs(up)
    point_m = np.median(points_m, axis=0)
    spread_m = np.median(np.linalg.norm((points_m - point_m) * level, axis=1))
    free_nm = np.zeros_like(force_n)
    if spread_m > _MAX_SPREAD_M:
        message = f"The moments of {name} do not agree with its centres of pressure; its free moment is taken as zero."
        return free_nm, [Remark("free-moment-unknown", message)]
    about_up_nm = (M - np.cross((p - point_m) * level, f)) @ up
    free_nm[loaded] = about_up_nm[:, None] * up
    return free_nm, []
