"""The robot's links as sent by the service: a GLB with one named node per link."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import trimesh
import viser

from stridelab_web.viewer.scene_parts import Colour

PLAIN: Colour = (186, 196, 206)
"""Colour of links without one."""
GRID_PER_M = 2.0**13
"""Vertices lie on a grid of an eighth of a millimetre, too fine to be seen; compressed, TALOS is a third smaller."""
DARKEST, LIGHTEST = 84, 216
"""Levels of black and white: darker bodies lose their shape, lighter ones merge with the background."""


def read_links(glb: bytes) -> dict[str, trimesh.Trimesh]:
    """Mesh per link, in the link's frame, with its colours. Raises ``ValueError`` for a file without such meshes."""
    loaded = trimesh.load(io.BytesIO(glb), file_type="glb", process=False)
    if not isinstance(loaded, trimesh.Scene):
        raise ValueError("the file of the robot's links holds no scene")
    links: dict[str, trimesh.Trimesh] = {}
    for name in loaded.graph.nodes_geometry:
        T_world_node, geometry = loaded.graph[name]
        source = loaded.geometry[geometry]
        # Made anew: a copy of a mesh with a material loses the colours of its vertices.
        mesh = trimesh.Trimesh(source.vertices, source.faces, vertex_colors=_vertex_colours(source), process=False)
        mesh.apply_transform(T_world_node)
        links[name] = mesh
    return links


def add_robot(
    scene: viser.SceneApi, links: Sequence[str], meshes: Mapping[str, trimesh.Trimesh]
) -> dict[str, viser.SceneNodeHandle]:
    """A node ``/robot/<link>`` per link; a link without a mesh is an empty node, so that the page finds them all.

    A mesh has one colour: parts of further colours are nodes below the link.
    """
    made: dict[str, viser.SceneNodeHandle] = {}
    for link in links:
        mesh = meshes.get(link)
        if mesh is None or not len(mesh.faces):
            made[link] = scene.add_frame(f"/robot/{link}", show_axes=False)
            continue
        for k, (vertices, faces, colour) in enumerate(colour_parts(mesh)):
            piece = scene.add_mesh_simple(
                f"/robot/{link}/{k}" if k else f"/robot/{link}",
                vertices,
                faces,
                color=colour,
                flat_shading=True,
                cast_shadow=False,
                receive_shadow=False,
            )
            made.setdefault(link, piece)
    return made


def colour_parts(mesh: trimesh.Trimesh) -> list[tuple[np.ndarray, np.ndarray, Colour]]:
    """Vertices, faces and colour of the single-coloured parts of a mesh, the largest first."""
    visual: Any = mesh.visual
    own = np.asarray(visual.vertex_colors)[mesh.faces[:, 0], :3]
    colours, of_face, count = np.unique(own, axis=0, return_inverse=True, return_counts=True)
    parts = []
    for k in np.argsort(-count):
        faces = np.asarray(mesh.faces)[of_face.reshape(-1) == k]
        used, renumbered = np.unique(faces, return_inverse=True)
        vertices = (np.round(mesh.vertices[used] * GRID_PER_M) / GRID_PER_M).astype(np.float32)
        parts.append((vertices, renumbered.reshape(-1, 3).astype(np.uint32), limit_levels(colours[k])))
    return parts


def limit_levels(colour: np.ndarray) -> Colour:
    """The colour ``(3,)``, scaled to the range of drawn levels."""
    red, green, blue = np.round(DARKEST + (LIGHTEST - DARKEST) * (colour / 255)).astype(int)
    return int(red), int(green), int(blue)


def _vertex_colours(mesh: trimesh.Trimesh) -> np.ndarray:
    """Colours of the vertices ``(n, 3)`` in sRGB; a GLB has linear ones."""
    visual: Any = mesh.visual
    written = getattr(visual, "vertex_attributes", {}).get("color")
    colours = visual.vertex_colors if visual.kind == "vertex" else written
    if colours is None:
        return np.tile(np.array(PLAIN, dtype=np.uint8), (len(mesh.vertices), 1))
    light = np.asarray(colours)[:, :3] / 255
    share = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255 * share).astype(np.uint8)
