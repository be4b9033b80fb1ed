"""``motion.viser``: the motion as a recording for viser's player; ``motion.html``: the player with the recording.

The scene is built on a viser server without clients, whose messages are recorded. The poses are written into that
recording as messages, whole: through the handles of its nodes, the recording of a stair took four times as long.
"""

import base64
import contextlib
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import viser
import zstandard
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from stridelab.contacts.terrain import Rail, Terrain
from stridelab.conventions import Points

RECORDING_FILE: Final = "motion.viser"
PAGE_FILE: Final = "motion.html"
RECORDING_HZ = 25.0
MIN_CAMERA_DISTANCE_M = 2.0
_POSITION, _TURN = slice(0, 3), slice(3, 7)
_IDENTITY: Final = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
_LENGTH_BYTES: Final = 8
_COMPRESSION: Final = 6
BOX_COLOUR, RAIL_COLOUR = (206, 212, 218), (120, 130, 140)


def record_scene(
    terrain: Terrain, links: Mapping[str, bytes], poses: Float[np.ndarray, "f links 7"], rate_hz: float
) -> bytes:
    """Content of a ``.viser`` file that shows frames ``poses`` (``px py pz qw qx qy qz`` per link) at ``rate_hz``.

    ``links`` are the GLB files of the links by their names.
    """
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner even with verbose=False
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        _add_lights_and_terrain(server, terrain)
        _set_camera(server, poses[:, :, :3].reshape(-1, 3))
        nodes = [server.scene.add_glb(f"/robot/{name}", mesh, cast_shadow=False) for name, mesh in links.items()]
        scene = bytes(server.get_scene_serializer().serialize())
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()
    return _add_messages(scene, _pose_messages([node.name for node in nodes], poses, rate_hz), len(poses) / rate_hz)


def _pose_messages(
    nodes: list[str], poses: Float[np.ndarray, "f links 7"], rate_hz: float
) -> Iterator[tuple[float, dict[str, Any]]]:
    """Times (s) and messages of all poses that differ from the one before; nodes begin at the identity."""
    shown = np.tile(_IDENTITY, (len(nodes), 1))
    for k, frame in enumerate(poses.astype(float)):
        time_s = k / rate_hz
        moves, turns = (~np.isclose(frame[:, at], shown[:, at]).all(axis=1) for at in (_POSITION, _TURN))
        shown[moves, _POSITION], shown[turns, _TURN] = frame[moves, _POSITION], frame[turns, _TURN]
        for name, pose, has_moved, has_turned in zip(nodes, frame.tolist(), moves, turns, strict=True):
            if has_moved:
                yield time_s, {"name": name, "position": pose[_POSITION], "owner": "", "type": "SetPositionMessage"}
            if has_turned:
                yield time_s, {"name": name, "wxyz": pose[_TURN], "owner": "", "type": "SetOrientationMessage"}


def _add_messages(recording: bytes, messages: Iterator[tuple[float, dict[str, Any]]], lasts_s: float) -> bytes:
    """Append messages to a ``.viser`` file without binary buffers, which lasts until ``lasts_s`` then.

    The file is the length of its content, and the content compressed by zstd: the length of a msgpack document, the
    document, and buffers.
    """
    content = zstandard.ZstdDecompressor().decompressobj().decompress(recording[_LENGTH_BYTES:])
    document = msgspec.msgpack.decode(content[_LENGTH_BYTES:])
    document |= {"durationSeconds": lasts_s, "messages": [*document["messages"], *messages]}
    payload = msgspec.msgpack.encode(document)
    content = len(payload).to_bytes(_LENGTH_BYTES, "little") + payload
    compressed = zstandard.ZstdCompressor(level=_COMPRESSION).compress(content)
    return len(content).to_bytes(_LENGTH_BYTES, "little") + compressed


def player_page(recording: bytes) -> str:
    """A page that a browser can open from the disk; like viser's ``StateSerializer.as_html``, from a finished file."""
    client = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text(encoding="utf-8")
    data = base64.b64encode(recording).decode("ascii")
    script = f'<script>window.__VISER_EMBED_DATA__="{data}";window.__VISER_EMBED_CONFIG__={{darkMode:false}};</script>'
    head, end, rest = client.partition("</head>")
    return head + script + end + rest


def _set_camera(server: viser.ViserServer, places_m: Points) -> None:
    """Set the camera so that the whole path is visible, from the right side of a robot that walks along x."""
    low, high = places_m.min(axis=0), places_m.max(axis=0)
    centre, extent_m = (low + high) / 2.0, float(np.linalg.norm(high - low))
    server.initial_camera.look_at = tuple(centre)
    server.initial_camera.position = tuple(centre + max(extent_m, MIN_CAMERA_DISTANCE_M) * np.array([0.3, -1.2, 0.25]))


def _add_lights_and_terrain(server: viser.ViserServer, terrain: Terrain) -> None:
    scene = server.scene
    scene.set_up_direction("+z")
    # with an environment map or shadows, a machine without graphics card shows one frame per second
    scene.configure_environment_map(hdri=None)
    scene.configure_default_lights(enabled=True, cast_shadow=False)
    scene.add_light_ambient("/light", intensity=2.0)
    for box in terrain.boxes:
        scene.add_box(
            f"/terrain/{box.name}",
            color=BOX_COLOUR,
            dimensions=box.size_m,
            position=box.placement.position_m,
            wxyz=box.placement.wxyz,
            cast_shadow=False,
        )
    for rail in terrain.rails:
        _add_rail(scene, rail)


def _add_rail(scene: viser.SceneApi, rail: Rail) -> None:
    along = rail.to_m - rail.from_m
    turn, _ = Rotation.align_vectors(along[None], [[0.0, 0.0, 1.0]])
    x, y, z, w = turn.as_quat()
    scene.add_cylinder(
        f"/terrain/{rail.name}",
        radius=rail.radius_m,
        height=float(np.linalg.norm(along)),
        color=RAIL_COLOUR,
        position=(rail.from_m + rail.to_m) / 2.0,
        wxyz=(w, x, y, z),
        cast_shadow=False,
    )
