"""The robot's links as the service gives them: a GLB with one named node per link."""

import io
from collections.abc import Mapping, Sequence

import trimesh
import viser


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
            scene.add_mesh_trimesh(f"/robot/{link}", mesh, cast_shadow=False, receive_shadow=False)
