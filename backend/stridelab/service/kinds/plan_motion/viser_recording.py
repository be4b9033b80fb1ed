"""``motion.viser``: the motion as a recording for viser's player; ``motion.html``: the player with the recording.

The scene is built on a viser server without clients, whose messages are recorded.
"""

import base64
import contextlib
import io
from pathlib import Path
from typing import Final

import numpy as np
import viser
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from stridelab.contacts.terrain import Rail, Terrain
from stridelab.conventions import Points
from stridelab.robots.visuals import LinkMesh, glb

RECORDING_FILE: Final = "motion.viser"
PAGE_FILE: Final = "motion.html"
RECORDING_HZ = 25.0
MIN_CAMERA_DISTANCE_M = 2.0
BOX_COLOUR, RAIL_COLOUR = (206, 212, 218), (120, 130, 140)


def record_scene(
    terrain: Terrain, links: tuple[LinkMesh, ...], poses: Float[np.ndarray, "f links 7"], rate_hz: float
) -> bytes:
    """Content of a ``.viser`` file that shows frames ``poses`` (``px py pz qw qx qy qz`` per link) at ``rate_hz``."""
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner even with verbose=False
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        _add_lights_and_terrain(server, terrain)
        _set_camera(server, poses[:, :, :3].reshape(-1, 3))
        nodes = [server.scene.add_glb(f"/robot/{link.name}", glb([link]), cast_shadow=False) for link in links]
        serializer = server.get_scene_serializer()
        for frame in poses.astype(float):
            for node, pose in zip(nodes, frame, strict=True):
                node.position, node.wxyz = pose[:3], pose[3:]
            serializer.insert_sleep(1.0 / rate_hz)
        return bytes(serializer.serialize())
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


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
