"""Meshes as binary glTF 2.0 (GLB), the form in which a browser takes them."""

import json
import struct
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from jaxtyping import UInt8

from stridelab.robots.meshes import LinkMesh

_MATT: Final = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.7}}
"""Without a material of its own a mesh is metal, which is black where there is nothing for it to mirror."""
_FLOAT, _UBYTE, _UINT = 5126, 5121, 5125
_VERTICES, _INDICES = 34962, 34963


def glb(meshes: Sequence[LinkMesh]) -> bytes:
    """One node per mesh, named after the link and placed at the origin; a mesh without triangles is an empty node.

    A URDF's colours are those of a screen, as every viewer of URDFs shows them; glTF keeps linear ones.
    """
    buffer = _Buffer()
    nodes: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    for mesh in meshes:
        nodes.append({"name": mesh.name})
        if not len(mesh.faces):
            continue
        nodes[-1]["mesh"] = len(shapes)
        vertices = mesh.vertices_m.astype(np.float32)
        extent = {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
        colours = {"normalized": True}
        attributes = {
            "POSITION": buffer.add(vertices, _FLOAT, "VEC3", _VERTICES, extent),
            "COLOR_0": buffer.add(linear(mesh.colours), _UBYTE, "VEC4", _VERTICES, colours),
        }
        indices = buffer.add(mesh.faces.astype(np.uint32).ravel(), _UINT, "SCALAR", _INDICES, {})
        shapes.append(
            {"name": mesh.name, "primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}
        )
    document = {
        "asset": {"version": "2.0", "generator": "stridelab"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": shapes,
        "materials": [_MATT],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    chunks = _chunk(b"JSON", text + b" " * (-len(text) % 4)) + _chunk(b"BIN\0", bytes(buffer.data))
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def linear(colours: UInt8[np.ndarray, "n 4"]) -> UInt8[np.ndarray, "n 4"]:
    """Colours of a screen as linear light (IEC 61966-2-1), the opacity unchanged; 8 bits keep them within 7 of 255."""
    share = colours[:, :3] / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.column_stack([np.round(255.0 * light).astype(np.uint8), colours[:, 3]])


class _Buffer:
    """The binary part, with the two tables that say what lies where; every array of ours fills whole words."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, array: np.ndarray, component: int, shape: str, target: int, more: dict[str, Any]) -> int:
        """Append an array; its index in the accessors."""
        raw = np.ascontiguousarray(array).tobytes()
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw), "target": target}
        accessor = {"bufferView": len(self.views), "componentType": component, "type": shape, "count": len(array)}
        self.views.append(view)
        self.accessors.append(accessor | more)
        self.data += raw
        return len(self.accessors) - 1


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack("<I4s", len(data), kind) + data
