"""The frames of a scene as a recording for viser's own player, with the motions of static/js/viewer/scene.js."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import viser
from viser.infra import StateSerializer

from stridelab_web.scene.frames import ARROW_M_PER_N, HEAD_M, Frames

RATE_HZ: Final = 25.0
MAX_FRAMES: Final = 1000
"""Recordings longer than 40 s have fewer frames per second; each frame costs a message per node."""
HIDDEN_NODES: Final = ("/skeleton/", "/forces/total", "/inputs/axis/", "/momentum/")
"""Nodes that are hidden at first, as on the page; the player's list of nodes shows them."""
SHORTEST_M: Final = 1e-3


@dataclass(frozen=True)
class NodeTrack:
    """Motion of a node: positions ``(n, 3)`` and, optionally, quaternions wxyz ``(n, 4)`` and scales ``(n, 3)``."""

    name: str
    position_m: np.ndarray
    present: np.ndarray
    wxyz: np.ndarray | None = None
    scale: np.ndarray | None = None


def record_frames(server: viser.ViserServer, frames: Frames) -> StateSerializer:
    """Move the nodes of a scene through ``frames``, and record the messages to a page."""
    nodes = server.scene._handle_from_node_name  # noqa: SLF001  (viser is pinned; a test looks)
    picked, step_s = _recorded_frames(frames.time_s)
    tracks = [one for one in _node_tracks(frames, frames.values[picked].astype(float)) if one.name in nodes]
    for name, node in nodes.items():
        node.visible = not name.startswith(HIDDEN_NODES)
    serializer = server.get_scene_serializer()
    for k in range(len(picked)):
        for one in tracks:
            node = nodes[one.name]
            seen = bool(one.present[k]) and not one.name.startswith(HIDDEN_NODES)
            if node.visible != seen:
                node.visible = seen
            if not one.present[k]:
                continue
            node.position = one.position_m[k]
            if one.wxyz is not None:
                node.wxyz = one.wxyz[k]
            if one.scale is not None:
                node.scale = tuple(one.scale[k])  # type: ignore[attr-defined]  # every node that has a size here
        serializer.insert_sleep(step_s)
    return serializer


def _recorded_frames(time_s: np.ndarray) -> tuple[np.ndarray, float]:
    """Indices of the recorded frames, and the duration of each (s)."""
    lasts_s = float(time_s[-1] - time_s[0])
    count = int(np.clip(round(lasts_s * RATE_HZ), 1, min(MAX_FRAMES, len(time_s))))
    wanted_s = time_s[0] + lasts_s * np.arange(count) / count
    return np.searchsorted(time_s, wanted_s, side="left").clip(0, len(time_s) - 1), max(lasts_s / count, 1e-3)


def _node_tracks(frames: Frames, row: np.ndarray) -> Iterator[NodeTrack]:
    for point in frames.points:
        yield _node_track(point.name, row[:, point.at : point.at + 3])
    for body in frames.bodies:
        yield _node_track(body.name, row[:, body.at : body.at + 3], row[:, body.at + 3 : body.at + 7])
    for stick in frames.sticks:
        start, along = row[:, stick.start : stick.start + 3], row[:, stick.end : stick.end + 3]
        yield _pointing_track(stick.name, start, along - start)
    for arrow in frames.arrows:
        origin, force = row[:, arrow.at : arrow.at + 3], row[:, arrow.at + 3 : arrow.at + 6]
        length_m = ARROW_M_PER_N * np.linalg.norm(force, axis=1)
        yield _pointing_track(arrow.shaft, origin, force, np.maximum(length_m - HEAD_M, SHORTEST_M), length_m)
        head = np.minimum(1.0, length_m / HEAD_M)[:, None] * np.ones(3)
        tip = origin + ARROW_M_PER_N * force
        yield _node_track(arrow.head, tip, _rotations_from_z(force), head, length_m > SHORTEST_M)
    for ball in frames.ellipsoids:
        yield _node_track(ball.name, row[:, ball.at : ball.at + 3], scale=row[:, ball.axes : ball.axes + 3])
    for hoop in frames.hoops:
        size = row[:, hoop.size, None] * np.ones(3)
        yield _node_track(hoop.name, row[:, hoop.at : hoop.at + 3], row[:, hoop.at + 3 : hoop.at + 7], size)


def _node_track(
    name: str,
    position_m: np.ndarray,
    wxyz: np.ndarray | None = None,
    scale: np.ndarray | None = None,
    there: np.ndarray | bool = True,
) -> NodeTrack:
    """The track of a node, which is present where ``there`` holds and all values are finite."""
    values = np.column_stack([part for part in (position_m, wxyz, scale) if part is not None])
    return NodeTrack(name, position_m, there & np.isfinite(values).all(axis=1), wxyz, scale)


def _pointing_track(
    name: str,
    start: np.ndarray,
    along: np.ndarray,
    length_m: np.ndarray | None = None,
    there_m: np.ndarray | None = None,
) -> NodeTrack:
    """A node of unit length along z that begins at ``start`` and points ``along``; as long as that by default."""
    norm = np.linalg.norm(along, axis=1)
    long_m = norm if length_m is None else length_m
    scale = np.column_stack([np.ones_like(norm), np.ones_like(norm), long_m])
    return _node_track(
        name, start, _rotations_from_z(along), scale, (norm if there_m is None else there_m) > SHORTEST_M
    )


def _rotations_from_z(along: np.ndarray) -> np.ndarray:
    """Quaternions ``(n, 4)`` of the shortest rotations from the z axis to ``along`` ``(n, 3)``."""
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y, z = (along / np.linalg.norm(along, axis=1, keepdims=True)).T
        half = np.sqrt(2 * (1 + z))
        turns = np.column_stack([half / 2, -y / half, x / half, np.zeros_like(z)])
    down = z < -1 + 1e-6
    turns[down] = [0.0, 1.0, 0.0, 0.0]
    return np.asarray(turns)
