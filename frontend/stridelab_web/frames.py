"""A recording as frames of numbers: what moves in the viewer, in the order in which the browser reads it.

The viewer process builds the nodes from the same ``Frames`` from which the web app serves the numbers, so that names
and columns cannot disagree. Positions are in the world frame, metres; forces in newtons.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stridelab.schemas.recordings import Recording
from stridelab_web.tables import Columns, triple

ARROW_M_PER_N: Final = 1 / 1000
"""Length of a force arrow: a body weight of 700 N is 0.7 m long."""
HEAD_M: Final = 0.08
"""Length of an arrow's head; the shaft ends where it begins."""
ARROW_THRESHOLD_N: Final = 20.0

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


@dataclass(frozen=True)
class Point:
    """A node whose position is the three numbers from ``at`` on; ``label`` says what it is."""

    name: str
    at: int
    label: str


@dataclass(frozen=True)
class Stick:
    """A unit cylinder that joins the points at ``start`` and ``end``."""

    name: str
    start: int
    end: int


@dataclass(frozen=True)
class Arrow:
    """A shaft and a head: application point (three numbers from ``at`` on), then the force (three numbers)."""

    shaft: str
    head: str
    at: int
    label: str


@dataclass(frozen=True)
class Frames:
    """``values`` has shape ``(frames, width)``, float32, NaN where something is not there."""

    time_s: np.ndarray
    values: np.ndarray
    points: tuple[Point, ...]
    sticks: tuple[Stick, ...]
    arrows: tuple[Arrow, ...]
    com_sd_m: np.ndarray | None
    com_at: int | None
    geometry_at: int | None

    def layout(self) -> dict[str, Any]:
        """What the browser must know to read ``values``."""
        return {
            "n_frames": len(self.time_s),
            "width": int(self.values.shape[1]),
            "time_s": [round(float(t), 6) for t in self.time_s],
            "points": [[p.name, p.at, p.label] for p in self.points],
            "sticks": [[s.name, s.start, s.end] for s in self.sticks],
            "arrows": [[a.shaft, a.head, a.at, a.label] for a in self.arrows],
            "arrow_m_per_n": ARROW_M_PER_N,
            "head_m": HEAD_M,
        }


def build_frames(recording: Recording, tracks: Columns, com: Columns | None) -> Frames:
    """Frames of ``tracks.parquet`` and, where a job is shown, of its ``com.parquet``."""
    time_s = tracks["time_s"]
    blocks: list[np.ndarray] = []
    points: list[Point] = []

    def add(block: np.ndarray) -> int:
        blocks.append(block)
        return 3 * (len(blocks) - 1)

    at_of: dict[str, int] = {}
    for k, label in enumerate(recording.labels):
        track = triple(tracks, f"{label}_", "_m")
        if track is not None:
            at_of[label] = add(track)
            points.append(Point(f"/markers/{k}", at_of[label], label))
    sticks = _sticks(recording, at_of)

    arrows: list[Arrow] = []
    measured = [(plate.index, *_plate_force(tracks, plate.index)) for plate in recording.plates if plate.use]
    present = [(index, cop, force) for index, cop, force in measured if cop is not None and force is not None]
    if len(present) > 1:
        present.append((0, *_total([(cop, force) for _, cop, force in present])))
    for index, cop, force in present:
        at = add(np.where(_loaded(force), cop, np.nan))
        add(force)
        name, label = (f"plate{index}", f"force on plate {index}") if index else ("total", "total force")
        arrows.append(Arrow(f"/forces/{name}_shaft", f"/forces/{name}_head", at, label))

    com_at = geometry_at = None
    sd = None
    if com is not None:
        geometry, fused = triple(com, "geometry_", "_m"), triple(com, "", "_m")
        if geometry is not None:
            geometry_at = add(_resample(time_s, com["time_s"], geometry))
            points.append(Point("/com/markers_only", geometry_at, "centre of mass, markers only"))
        if fused is not None:
            com_at = add(_resample(time_s, com["time_s"], fused))
            points.append(Point("/com/fused", com_at, "centre of mass"))
        found = triple(com, "sd_", "_m")
        sd = None if found is None else _resample(time_s, com["time_s"], found)
    values = np.concatenate(blocks, axis=1) if blocks else np.empty((len(time_s), 0))
    return Frames(time_s, values.astype(np.float32), tuple(points), sticks, tuple(arrows), sd, com_at, geometry_at)


def _sticks(recording: Recording, at_of: dict[str, int]) -> tuple[Stick, ...]:
    place = {landmark: at_of[label] for landmark, label in recording.landmarks.items() if label in at_of}
    pairs = [*SPINE, *((f"{side}_{a}", f"{side}_{b}") for side in "lr" for a, b in BONES)]
    found = [(place[a], place[b]) for a, b in pairs if a in place and b in place]
    return tuple(Stick(f"/skeleton/{k}", a, b) for k, (a, b) in enumerate(found))


def _plate_force(tracks: Columns, index: int) -> tuple[np.ndarray | None, np.ndarray | None]:
    return triple(tracks, f"plate{index}_cop", "_m"), triple(tracks, f"plate{index}_f", "_n")


def _loaded(force_n: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(force_n, axis=1, keepdims=True) > ARROW_THRESHOLD_N)


def _total(plates: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Sum of the forces, drawn from the centre of pressure of all plates together."""
    force = np.sum([np.nan_to_num(f) for _, f in plates], axis=0)
    weight = [np.where(np.isfinite(cop[:, :1]), np.clip(np.nan_to_num(f[:, 2:]), 0, None), 0.0) for cop, f in plates]
    shared = np.sum([w * np.nan_to_num(cop) for w, (cop, _) in zip(weight, plates, strict=True)], axis=0)
    whole = np.sum(weight, axis=0)
    return shared / np.where(whole > 0, whole, np.nan), force


def _resample(time_s: np.ndarray, own_time_s: np.ndarray, track: np.ndarray) -> np.ndarray:
    """``track`` at ``time_s``, NaN outside; an instant that both have is taken over unchanged."""
    if len(own_time_s) == len(time_s) and np.allclose(own_time_s, time_s, atol=1e-6):
        return track
    columns = [np.interp(time_s, own_time_s, track[:, k], left=np.nan, right=np.nan) for k in range(3)]
    return np.column_stack(columns)
