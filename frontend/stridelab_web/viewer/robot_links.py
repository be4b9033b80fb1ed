"""The robot's links as the service gives them: a GLB with one named node per link."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import trimesh
import viser

from stridelab_web.viewer.parts import Colour

LIGHTEST: Colour = (186, 196, 206)


def read_links(glb: bytes) -> dict[str, trimesh.Trimesh]:
    """Mesh per link, in the link's frame. Raises ``ValueError`` for a file that holds no such meshes."""
    loaded = trimesh.load(io.BytesIO(glb), file_type="glb", process=False)
    if not isinstance(loaded, trimesh.Scene):
        raise ValueError("the file of the robot's links holds no scene")
    found: dict[str, trimesh.Trimesh] = {}
    for name in loaded.graph.nodes_geometry:
        T_world_node, geometry = loaded.graph[name]
        mesh = loaded.geometry[geometry].copy()
        mesh.apply_transform(T_world_node)
        found[name] = mesh
    return found


def add_robot(scene: viser.SceneApi, links: Sequence[str], meshes: Mapping[str, trimesh.Trimesh]) -> None:
    """A node ``/robot/<link>`` per link; a link without a mesh is an empty node, so that the page finds them all."""
    for link in links:
        mesh = meshes.get(link)
        if mesh is None or not len(mesh.faces):
            scene.add_frame(f"/robot/{link}", show_axes=False)
        else:
            scene.add_mesh_simple(
                f"/robot/{link}",
                np.asarray(mesh.vertices, dtype=np.float32),
                np.asarray(mesh.faces, dtype=np.uint32),
                color=_shade(mesh),
                flat_shading=True,
                cast_shadow=False,
                receive_shadow=False,
            )


def _shade(mesh: trimesh.Trimesh) -> Colour:
    """The link's own mean colour, no lighter than what stands out from a white background."""
    red, green, blue = np.minimum(_own_colours(mesh).mean(axis=0), LIGHTEST).astype(int)
    return int(red), int(green), int(blue)


def _own_colours(mesh: trimesh.Trimesh) -> np.ndarray:
    """Red, green and blue ``(n, 3)`` of the vertices."""
    visual: Any = mesh.visual
    if visual.kind == "vertex":
        return np.asarray(visual.vertex_colors, dtype=float)[:, :3]
    colours = getattr(visual, "vertex_attributes", {}).get("color")
    return np.array([LIGHTEST], dtype=float) if colours is None else np.asarray(colours, dtype=float)[:, :3]
