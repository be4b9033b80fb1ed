"""Moving nodes of the viewer, as frames of numbers in the order in which the browser reads them.

The viewer process builds the nodes from the same ``Frames`` from which the web app serves the numbers, so that names
and columns cannot disagree. Positions are in the world frame, metres; forces in newtons.
"""

import json
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from stridelab_web.scene.frame_codec import (
    FORCE_BITS,
    POINT_BITS,
    POSE_BITS,
    SIZE_BITS,
    continuous_signs,
    fit_bits,
    pack_columns,
)

ARROW_M_PER_N: Final = 1 / 1000
"""Length of a force arrow: a body weight of 700 N is 0.7 m long."""
FORCE_SCALE: Final = f"1 m = {1 / ARROW_M_PER_N:.0f} N"
HEAD_M: Final = 0.08
"""Length of an arrow's head; the shaft ends where it begins."""
LABELS: Final = (
    "total force",
    "centre of mass",
    "centre of mass, markers only",
    "nearest point of the central axis",
    "extrapolated centre of mass",
    "angular momentum",
    "hub of the wheel",
    "point on the wheel",
)
"""Labels in scenes of recordings, which the page translates when the mouse points at them."""
NODE_KINDS: Final = ("points", "bodies", "sticks", "arrows", "ellipsoids", "hoops", "spans")
"""Fields of ``Frames`` whose moving nodes the browser reads as they are, each as a list of its fields."""


class Point(NamedTuple):
    """A node whose position is the three numbers from ``at`` on; ``label`` describes it."""

    name: str
    at: int
    label: str


class Body(NamedTuple):
    """A node with a pose: position, then quaternion wxyz, seven numbers from ``at`` on."""

    name: str
    at: int


class Stick(NamedTuple):
    """A unit cylinder that joins the points at ``start`` and ``end``."""

    name: str
    start: int
    end: int


class Arrow(NamedTuple):
    """A shaft and a head: application point (three numbers from ``at`` on), then the force (three numbers)."""

    shaft: str
    head: str
    at: int
    label: str


class Ellipsoid(NamedTuple):
    """A unit ball at the three numbers from ``at`` on, with the three semi-axes from ``axes`` on along x, y and z."""

    name: str
    at: int
    axes: int


class Hoop(NamedTuple):
    """A node of unit size with a pose (seven numbers from ``at`` on), as large as the number at ``size``."""

    name: str
    at: int
    size: int


class Span(NamedTuple):
    """A node that is present only from ``start_s`` until ``end_s``."""

    name: str
    start_s: float
    end_s: float


class Track(NamedTuple):
    """The path of the point whose position is the three numbers from ``at`` on, drawn as the node ``name``."""

    name: str
    at: int


class Copy(NamedTuple):
    """A node with the meshes of the node ``of``, which are sent once; ``paint`` is its own colour and opacity.

    Both nodes are in the scene; the page gives the copy its meshes.
    """

    name: str
    of: str
    paint: tuple[tuple[int, int, int], float] | None = None


@dataclass(frozen=True)
class Frames:
    """``values`` has shape ``(frames, width)``, float32, NaN where a node is absent.

    ``still`` names nodes that are only shown or hidden; ``phase_starts_s`` are the instants at which the set of
    contacts changes, and ``gone`` the files of the result that are no longer stored and therefore not shown.
    """

    time_s: np.ndarray
    values: np.ndarray
    points: tuple[Point, ...] = ()
    bodies: tuple[Body, ...] = ()
    sticks: tuple[Stick, ...] = ()
    arrows: tuple[Arrow, ...] = ()
    ellipsoids: tuple[Ellipsoid, ...] = ()
    hoops: tuple[Hoop, ...] = ()
    spans: tuple[Span, ...] = ()
    tracks: tuple[Track, ...] = ()
    still: tuple[str, ...] = ()
    copies: tuple[Copy, ...] = ()
    phase_starts_s: tuple[float, ...] = ()
    gone: tuple[str, ...] = ()

    def track_m(self, name: str) -> np.ndarray | None:
        """Positions ``(frames, 3)`` of the track ``name``, if there is one."""
        at = next((track.at for track in self.tracks if track.name == name), None)
        return None if at is None else self.values[:, at : at + 3]

    def to_layout(self) -> dict[str, Any]:
        """JSON description with which the browser reads ``values``."""
        return {
            "n_frames": len(self.time_s),
            "width": int(self.values.shape[1]),
            "bits": self._column_bits().tolist(),
            "time_s": [round(float(t), 6) for t in self.time_s],
            **{kind: getattr(self, kind) for kind in NODE_KINDS},
            "still": [*(track.name for track in self.tracks), *self.still],
            "copies": self.copies,
            "phase_starts_s": list(self.phase_starts_s),
            "arrow_m_per_n": ARROW_M_PER_N,
            "head_m": HEAD_M,
            "gone": list(self.gone),
        }

    def to_bytes(self) -> bytes:
        """Length of the layout (four bytes, little-endian), the layout as JSON, then the packed numbers."""
        layout = json.dumps(self.to_layout(), separators=(",", ":")).encode()
        return len(layout).to_bytes(4, "little") + layout + self.packed_values()

    def packed_values(self) -> bytes:
        """``values`` as ``static/js/viewer/frame_decoder.js`` reads them; quaternions have no jumps of sign."""
        values = self.values.copy()
        for at in self._pose_columns():
            values[:, at + 3 : at + 7] = continuous_signs(values[:, at + 3 : at + 7])
        return pack_columns(values, self._column_bits())

    def _pose_columns(self) -> list[int]:
        """First columns of the poses."""
        return [*(body.at for body in self.bodies), *(hoop.at for hoop in self.hoops)]

    def _column_bits(self) -> np.ndarray:
        """Resolution of each column (``frame_codec``)."""
        bits = np.full(self.values.shape[1], POINT_BITS)
        for at in self._pose_columns():
            bits[at : at + 7] = POSE_BITS
        for arrow in self.arrows:
            bits[arrow.at + 3 : arrow.at + 6] = FORCE_BITS
        for ball in self.ellipsoids:
            bits[ball.axes : ball.axes + 3] = SIZE_BITS
        return fit_bits(self.values, bits)


class Sheet:
    """Collects columns of numbers."""

    def __init__(self) -> None:
        self._blocks: list[np.ndarray] = []
        self._width = 0

    def add_block(self, block: np.ndarray) -> int:
        """Append ``block`` ``(frames, k)``; returns the index of its first column."""
        at = self._width
        self._blocks.append(block)
        self._width += block.shape[1]
        return at

    def to_array(self, n_frames: int) -> np.ndarray:
        """All columns, float32."""
        whole = np.concatenate(self._blocks, axis=1) if self._blocks else np.empty((n_frames, 0))
        return whole.astype(np.float32)


def resample_track(time_s: np.ndarray, own_time_s: np.ndarray, track: np.ndarray) -> np.ndarray:
    """``track`` ``(n, k)`` at ``time_s``, NaN outside; unchanged if its times are the same."""
    if len(own_time_s) == len(time_s) and np.allclose(own_time_s, time_s, atol=1e-6):
        return track
    return np.column_stack(
        [np.interp(time_s, own_time_s, column, left=np.nan, right=np.nan) for column in np.transpose(track)]
    )
