"""A recording as frames: markers, lines between them, plate forces and, where a job is shown, the centre of mass."""

from typing import Final

import numpy as np

from stridelab.schemas.recordings import Recording
from stridelab_web.parquet import Columns, xyz_columns
from stridelab_web.scene.body_frames import BODY, body_sticks, foot_places_m
from stridelab_web.scene.com_frames import ComFrames, add_com
from stridelab_web.scene.cycloid_frames import WheelFrames, add_wheel, com_of
from stridelab_web.scene.frames import Arrow, Frames, Point, Sheet, Stick
from stridelab_web.scene.shadows import shadow_points
from stridelab_web.scene.stability_frames import StabilityFrames, add_stability

ARROW_THRESHOLD_N: Final = 20.0
SKELETON: Final = "/skeleton/"
"""Lines between markers."""
LINES: Final = f"{BODY}line"
"""The same where no joint centres are stored: they are the body then."""

BONES: Final = (
    ("asis", "knee_lateral"), ("asis", "psis"), ("trochanter", "knee_lateral"), ("knee_lateral", "ankle_lateral"),
    ("knee_medial", "ankle_medial"), ("knee_lateral", "knee_medial"), ("ankle_lateral", "ankle_medial"),
    ("ankle_lateral", "heel"), ("heel", "mt1"), ("heel", "mt5"), ("mt1", "mt5"), ("ankle_lateral", "mt5"),
    ("ankle_lateral", "mt2"), ("acromion", "elbow_lateral"), ("elbow_lateral", "wrist_radial"),
    ("elbow_lateral", "wrist_ulnar"), ("wrist_ulnar", "mc5"), ("wrist_radial", "mc2"), ("head_front", "head_back"),
)  # fmt: skip
"""Pairs of landmarks of one side that a line joins."""
SPINE: Final = (
    ("l_asis", "r_asis"), ("l_psis", "r_psis"), ("l_psis", "sacrum"), ("r_psis", "sacrum"), ("l_asis", "sacrum"),
    ("r_asis", "sacrum"), ("sacrum", "c7"), ("c7", "l_acromion"), ("c7", "r_acromion"), ("c7", "jugular_notch"),
    ("jugular_notch", "xiphoid"), ("l_head_front", "r_head_front"), ("l_head_back", "r_head_back"), ("c7", "head_top"),
)  # fmt: skip
"""Pairs of landmarks across the body that a line joins."""


def build_frames(
    recording: Recording,
    tracks: Columns,
    com: Columns | None,
    wheel: Columns | None = None,
    stability: Columns | None = None,
) -> Frames:
    """Frames of ``tracks.parquet`` and, where a job is shown, of its tables.

    These are ``com.parquet``, ``wheel.parquet`` and the rows of ``stability.parquet`` that are of the recording.
    """
    time_s = tracks["time_s"]
    sheet = Sheet()
    points: list[Point] = []
    at_of: dict[str, int] = {}
    for k, label in enumerate(recording.labels):
        track = xyz_columns(tracks, f"{label}_", "_m")
        if track is not None:
            at_of[label] = sheet.add_block(track)
            points.append(Point(f"/markers/{k}", at_of[label], label))
    body = body_sticks(tracks, sheet)
    sticks = (*body, *_skeleton_sticks(recording, at_of, SKELETON if body else LINES))

    floor_m = np.full(len(time_s), _floor_m(recording))
    feet_m = foot_places_m(tracks)
    shadows = shadow_points(sheet, BODY, feet_m, dict.fromkeys(feet_m, floor_m))
    arrows: list[Arrow] = []
    measured = [(plate.index, *_plate_force(tracks, plate.index)) for plate in recording.plates if plate.use]
    present = [(index, cop, force) for index, cop, force in measured if cop is not None and force is not None]
    if len(present) > 1:
        present.append((0, *_total_force([(cop, force) for _, cop, force in present])))
    for index, cop, force in present:
        at = sheet.add_block(np.where(_is_loaded(force), cop, np.nan))
        sheet.add_block(force)
        name, label = (f"plate{index}", f"force on plate {index}") if index else ("total", "total force")
        arrows.append(Arrow(f"/forces/{name}_shaft", f"/forces/{name}_head", at, label))

    if com is None and wheel is not None:
        com = com_of(wheel)
    if com is None:
        com = stability
    shown = ComFrames() if com is None else add_com(sheet, time_s, com, _floor_m(recording))
    rolling = WheelFrames() if wheel is None else add_wheel(sheet, time_s, wheel)
    balance = StabilityFrames() if stability is None else add_stability(sheet, time_s, stability)
    return Frames(
        time_s,
        sheet.to_array(len(time_s)),
        points=(*points, *shown.points, *rolling.points, *balance.points, *shadows),
        sticks=(*sticks, *shown.sticks, *rolling.sticks, *balance.sticks),
        arrows=(*arrows, *balance.arrows),
        ellipsoids=shown.ellipsoids,
        hoops=rolling.hoops,
        tracks=(*shown.tracks, *rolling.tracks, *balance.tracks),
    )


def _floor_m(recording: Recording) -> float:
    """Height of the lowest plate in use; 0 where there is none."""
    return min((corner[2] for plate in recording.plates if plate.use for corner in plate.corners_m), default=0.0)


def _skeleton_sticks(recording: Recording, at_of: dict[str, int], before: str) -> tuple[Stick, ...]:
    place = {landmark: at_of[label] for landmark, label in recording.landmarks.items() if label in at_of}
    pairs = [*SPINE, *((f"{side}_{a}", f"{side}_{b}") for side in "lr" for a, b in BONES)]
    ends = [(place[a], place[b]) for a, b in pairs if a in place and b in place]
    return tuple(Stick(f"{before}{k}", a, b) for k, (a, b) in enumerate(ends))


def _plate_force(tracks: Columns, index: int) -> tuple[np.ndarray | None, np.ndarray | None]:
    return xyz_columns(tracks, f"plate{index}_cop", "_m"), xyz_columns(tracks, f"plate{index}_f", "_n")


def _is_loaded(force_n: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(force_n, axis=1, keepdims=True) > ARROW_THRESHOLD_N)


def _total_force(plates: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Sum of the forces, drawn from the centre of pressure of all plates together."""
    force = np.sum([np.nan_to_num(f) for _, f in plates], axis=0)
    weight = [np.where(np.isfinite(cop[:, :1]), np.clip(np.nan_to_num(f[:, 2:]), 0, None), 0.0) for cop, f in plates]
    shared = np.sum([w * np.nan_to_num(cop) for w, (cop, _) in zip(weight, plates, strict=True)], axis=0)
    whole = np.sum(weight, axis=0)
    return shared / np.where(whole > 0, whole, np.nan), force
