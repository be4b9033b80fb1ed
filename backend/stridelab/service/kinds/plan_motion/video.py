"""Renders the motion as a video: faces are drawn with flat shading from far to near (painter's algorithm), by ffmpeg.

No graphics card is needed. Terrain is drawn first, low boxes before high ones, which is correct for a camera that looks
down from the side.
"""

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw
from scipy.spatial.transform import Rotation

from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.conventions import Points, Vector3
from stridelab.errors import Fault, NotEstimable
from stridelab.pipelines.progress import ProgressCallback
from stridelab.robots.visuals import LinkMesh
from stridelab.schemas.plans import Film
from stridelab.service.kinds.base import ArtifactFile

MEDIA_TYPES: Final = {"gif": "image/gif", "mp4": "video/mp4"}
SIZE_PX: Final = (640, 480)
BACKGROUND_COLOUR, BOX_COLOUR, RAIL_COLOUR = (255, 255, 255), (206, 212, 218), (120, 130, 140)
CAMERA_DIRECTION: Final = np.array([0.3, -1.2, 0.45])
"""Direction from the scene to the camera: the right side of a robot that walks along x."""
LIGHT_DIRECTION: Final = np.array([0.35, -0.6, 0.72])
_FOCAL: Final = 1.6
_MARGIN: Final = 1.1
_CODEC_OPTIONS: Final = {
    "mp4": ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart"],
    "gif": ["-filter_complex", "split[a][b];[a]palettegen[p];[b][p]paletteuse"],
}
_QUADS: Final = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Faces of a box whose corners count in binary, x first."""


def require_film(film: Film | None) -> None:
    """Raise ``NotEstimable`` (``film-unavailable``) if a film is requested and ffmpeg is not installed."""
    if film is not None and shutil.which("ffmpeg") is None:
        sentence = (
            "A film needs the program ffmpeg, which is not installed on this machine (Debian, Ubuntu: apt-get install "
            "ffmpeg). Without it, motion.html shows the motion in a browser."
        )
        raise NotEstimable("film-unavailable", sentence, [Fault("film", "ffmpeg is not installed")])


def write_film(
    folder: Path,
    film: Film,
    terrain: Terrain,
    links: Sequence[LinkMesh],
    poses: Float[np.ndarray, "f links 7"],
    rate_hz: float,
    progress: ProgressCallback,
) -> ArtifactFile:
    """Write ``motion.gif`` or ``motion.mp4``. Raises ``NotEstimable`` (``film-failed``) with ffmpeg's last message."""
    path = folder / f"motion.{film}"
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "{}x{}".format(*SIZE_PX), "-r", f"{rate_hz:g}", "-i", "-"]
    command = ["ffmpeg", "-loglevel", "error", "-y", *source, *_CODEC_OPTIONS[film], str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        pipe, errors = process.stdin, process.stderr
        if pipe is None or errors is None:
            raise NotEstimable("film-failed", "ffmpeg did not start; install it or choose another format.")
        try:
            for k, image in enumerate(render_frames(terrain, links, poses)):
                progress(0.8 + 0.2 * k / len(poses), f"drawing frame {k + 1} of {len(poses)}")
                pipe.write(image.tobytes())
            pipe.close()
        except BrokenPipeError:
            pass  # ffmpeg reports the reason on its error output
        error_text = errors.read().decode(errors="replace").strip()
    if process.returncode != 0 or not path.is_file():
        why = error_text.splitlines()[-1][:300] if error_text else f"exit code {process.returncode}"
        path.unlink(missing_ok=True)
        raise NotEstimable("film-failed", f"ffmpeg could not write the film: {why}.", [Fault("film", why)])
    return ArtifactFile(path.name, MEDIA_TYPES[film])


def render_frames(
    terrain: Terrain, links: Sequence[LinkMesh], poses: Float[np.ndarray, "f links 7"]
) -> Iterator[Image.Image]:
    """Render one image per frame of poses ``px py pz qw qx qy qz``."""
    camera = Camera.looking_at(poses[:, :, :3].reshape(-1, 3))
    ground = Image.new("RGB", SIZE_PX, BACKGROUND_COLOUR)
    _draw_terrain(ImageDraw.Draw(ground), terrain, camera)
    for frame in poses.astype(float):
        picture = ground.copy()
        _draw_links(ImageDraw.Draw(picture), links, frame, camera)
        yield picture


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera at ``position_m``; the rows of ``R`` are right, up and towards the camera."""

    position_m: Vector3
    R: Float[np.ndarray, "3 3"]

    @staticmethod
    def looking_at(points_m: Points) -> "Camera":
        """Camera that has all of ``points_m``, with a margin for the links around them, in view."""
        low, high = points_m.min(axis=0) - 0.35, points_m.max(axis=0) + 0.35
        back = CAMERA_DIRECTION / np.linalg.norm(CAMERA_DIRECTION)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        R = np.array([right, np.cross(back, right), back])
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        middle = (low + high) / 2.0
        seen = (corners - middle) @ R.T
        across = np.maximum(np.abs(seen[:, 0]) * SIZE_PX[1] / SIZE_PX[0], np.abs(seen[:, 1]))
        away_m = float((_MARGIN * _FOCAL * across + seen[:, 2]).max())
        return Camera(middle + away_m * back, R)

    def project_points(self, points_m: Points) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        """Project points: pixels ``(n, 2)``, and depths in front of the camera in metres."""
        at = (points_m - self.position_m) @ self.R.T
        depth = np.maximum(-at[:, 2], 1e-3)
        scale = _FOCAL * SIZE_PX[1] / 2.0 / depth
        pixels = np.column_stack([SIZE_PX[0] / 2.0 + scale * at[:, 0], SIZE_PX[1] / 2.0 - scale * at[:, 1]])
        return pixels, depth


def _draw_links(
    draw: ImageDraw.ImageDraw, links: Sequence[LinkMesh], frame: Float[np.ndarray, "links 7"], camera: Camera
) -> None:
    corners, depths, colours = [], [], []
    for link, pose in zip(links, frame, strict=True):
        if not len(link.faces) or not np.isfinite(pose).all():
            continue
        R = Rotation.from_quat(pose[[4, 5, 6, 3]]).as_matrix()
        world = np.asarray(link.vertices_m, dtype=float) @ R.T + pose[:3]
        triangles = world[link.faces]
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        towards = ((camera.position_m - triangles[:, 0]) * normal).sum(axis=1) > 0.0
        pixels, depth = camera.project_points(world)
        corners.append(pixels[link.faces][towards].reshape(-1, 6))
        depths.append(depth[link.faces][towards].mean(axis=1))
        own = np.asarray(link.colours, dtype=float)[link.faces[towards, 0], :3]
        colours.append(_shade_colours(own, normal[towards]))
    if not corners:
        return
    order = np.argsort(-np.concatenate(depths))
    polygons, fills = np.concatenate(corners)[order].tolist(), np.concatenate(colours)[order].tolist()
    for polygon, fill in zip(polygons, fills, strict=True):
        draw.polygon(polygon, fill=tuple(fill))


def _draw_terrain(draw: ImageDraw.ImageDraw, terrain: Terrain, camera: Camera) -> None:
    boxes = sorted(terrain.boxes, key=lambda box: float(box.placement.position_m[2] + box.size_m[2] / 2.0))
    for box in boxes:
        _draw_box(draw, box, camera)
    for rail in terrain.rails:
        _draw_rail(draw, rail, camera)


def _draw_box(draw: ImageDraw.ImageDraw, box: Box, camera: Camera) -> None:
    signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    world = box.placement.act(signs * box.size_m)
    pixels, _ = camera.project_points(world)
    for quad in _QUADS:
        a, b, c = (world[k] for k in quad[:3])
        normal = np.cross(b - a, c - a)
        if (camera.position_m - a) @ normal > 0.0:
            fill = _shade_colours(np.array([BOX_COLOUR], dtype=float), normal[None])[0]
            draw.polygon(pixels[list(quad)].ravel().tolist(), fill=tuple(fill.tolist()), outline=RAIL_COLOUR)


def _draw_rail(draw: ImageDraw.ImageDraw, rail: Rail, camera: Camera) -> None:
    pixels, depth = camera.project_points(np.array([rail.from_m, rail.to_m]))
    width = max(1, round(_FOCAL * SIZE_PX[1] * rail.radius_m / float(depth.mean())))
    draw.line(pixels.ravel().tolist(), fill=RAIL_COLOUR, width=width)


def _shade_colours(colours: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> np.ndarray:
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    shade = 0.55 + 0.45 * np.clip(normals @ LIGHT_DIRECTION / length / np.linalg.norm(LIGHT_DIRECTION), 0.0, 1.0)
    return np.asarray(np.round(colours * shade[:, None]).astype(int))
