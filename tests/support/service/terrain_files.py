"""Files of terrains for the tests of uploads: stairs that are made here, and files that no one should read."""

import io
import struct
import zipfile
from collections.abc import Callable

import numpy as np
import trimesh

RISE_M, DEPTH_M = 0.12, 0.3
STAIRS = (
    ((2.0, 1.2, 0.1), (-0.5, 0.0, -0.05)),
    ((DEPTH_M, 1.2, RISE_M), (0.65, 0.0, 0.5 * RISE_M)),
    ((DEPTH_M, 1.2, 2 * RISE_M), (0.95, 0.0, RISE_M)),
    ((1.5, 1.2, 3 * RISE_M), (1.85, 0.0, 1.5 * RISE_M)),
)
"""Edges and middles of the boxes: a floor, two treads and a landing."""
PACKED = "stairs.stl"
"""Name of the file in an archive."""
_STL_HEAD = b"\0" * 80
_RECORD = np.dtype([("numbers", "<f4", 12), ("spare", "<u2")])


def stairs(scale: float = 1.0, ending: str = "stl") -> bytes:
    """The file of a floor, two treads and a landing."""
    parts = [
        trimesh.creation.box(extents=size, transform=trimesh.transformations.translation_matrix(middle))
        for size, middle in STAIRS
    ]
    mesh = trimesh.util.concatenate(parts)
    mesh.apply_scale(scale)
    target = io.BytesIO()
    mesh.export(target, file_type=ending)
    return target.getvalue()


def _triangles(number: int, corner: float = 1.0) -> bytes:
    """A binary STL of as many triangles of a level floor."""
    records = np.zeros(number, _RECORD)
    side = np.arange(number) % 1000 * 1e-2
    records["numbers"][:, 2] = 1.0
    for k, (x, y) in enumerate(((0.0, 0.0), (1e-2, 0.0), (0.0, 1e-2))):
        records["numbers"][:, 3 + 3 * k] = side + x
        records["numbers"][:, 4 + 3 * k] = np.arange(number) // 1000 * 1e-2 + y * corner
    return _STL_HEAD + struct.pack("<I", number) + records.tobytes()


def _archive(name: str) -> bytes:
    """A zip whose member unpacks to a hundred times the memory of a reader, were it unpacked."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file, file.open(name, "w", force_zip64=True) as member:
        for _ in range(200):
            member.write(b"\0" * 1_000_000)
    return packed.getvalue()


def _promising_glb() -> bytes:
    """A GLB whose accessor promises four billion corners."""
    text = (
        b'{"asset":{"version":"2.0"},"buffers":[{"byteLength":4}],"bufferViews":[{"buffer":0,"byteLength":4}],'
        b'"accessors":[{"bufferView":0,"componentType":5126,"count":4000000000,"type":"VEC3"}],'
        b'"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],'
        b'"scenes":[{"nodes":[0]}],"scene":0}'
    )
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", 4, 0x004E4942) + b"\0" * 4
    return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body


HOSTILE: dict[str, tuple[str, Callable[[], bytes]]] = {
    "a million triangles": ("wide.stl", lambda: _triangles(1_000_000)),
    "no number": ("nan.stl", lambda: _triangles(100, float("nan"))),
    "infinite": ("infinite.stl", lambda: _triangles(100, float("inf"))),
    "cut off": ("cut.stl", lambda: stairs()[:-100]),
    "more triangles announced": ("more.stl", lambda: _STL_HEAD + struct.pack("<I", 0xFFFFFFFF) + b"\0" * 500),
    "another kind": ("walk.stl", lambda: b"\x50\x02" + b"\0" * 510),
    "a picture": ("stairs.png", lambda: b"\x89PNG\r\n\x1a\n" + b"\0" * 100),
    "a program": ("stairs.py", lambda: b"print('stairs')"),
    "a zip bomb": ("stairs.zip", lambda: _archive(PACKED)),
    "a zip bomb as a mesh": ("stairs.ply", lambda: _archive("stairs.ply")),
    "four billion corners": ("stairs.glb", _promising_glb),
    "four billion vertices": (
        "stairs.ply",
        lambda: (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n"
            b"property float z\nelement face 4000000000\nproperty list uchar int vertex_indices\nend_header\n"
        ),
    ),
    "another file's material": ("stairs.obj", lambda: b"mtllib /etc/passwd\nv 0 0 0\n"),
    "corners that are not there": ("stairs.obj", lambda: b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9\n"),
    "points alone": (
        "cloud.ply",
        lambda: (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            b"end_header\n0 0 0\n"
        ),
    ),
    "a point in place of a name": (".", stairs),
    "a wall": ("wall.obj", lambda: b"v 0 0 0\nv 1 0 0\nv 1 0 1\nf 1 2 3\n"),
}
"""Name and content of files that are refused, by what is wrong with them."""
CODES = ("terrain-", "zip-")
"""Beginnings of the codes with which a reader refuses such a file itself, in contrast to a reader that crashed."""
