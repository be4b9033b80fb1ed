"""All job kinds, by name: the ``KIND`` of every folder here with a ``kind.py``.

Importing this module imports no numeric package; runs are referenced by import path.
"""

import importlib
import importlib.util
import pkgutil
from collections.abc import Mapping
from types import MappingProxyType, ModuleType
from typing import Final

from stridelab.service import kinds
from stridelab.service.kinds.base import JobKind


def discover_kinds(package: ModuleType) -> Mapping[str, JobKind]:
    """The ``KIND`` of every folder of ``package`` that has a ``kind.py``, in the order of the folders, by its name.

    Raises ``ValueError`` if a kind's name is not that of its folder with hyphens.
    """
    found: dict[str, JobKind] = {}
    for folder in sorted(module.name for module in pkgutil.iter_modules(package.__path__) if module.ispkg):
        path = f"{package.__name__}.{folder}.kind"
        if importlib.util.find_spec(path) is None:
            continue
        kind: JobKind = importlib.import_module(path).KIND
        if kind.name != folder.replace("_", "-"):
            raise ValueError(f"the folder {folder} defines the job kind {kind.name}; their names must agree")
        found[kind.name] = kind
    return MappingProxyType(found)


KINDS: Final = discover_kinds(kinds)

PARSE_UPLOAD = "stridelab.service.kinds.parse_upload:run"
"""Import path of the parser of uploads, which is run by ``POST /recordings``, not by the queue."""

PROPOSE_MARKERS = "stridelab.service.kinds.parse_upload:propose_markers"
"""Import path of the proposal of a marker map, run by ``POST /marker-sets/propose``."""

READ_POSE = "stridelab.service.kinds.parse_upload:read_pose"
"""Import path of the reader of a static pose, run for streams of markers."""

READ_TERRAIN = "stridelab.service.kinds.read_terrain:run"
"""Import path of the reader of terrains, run by ``POST /terrains``."""

PARSE_BATCH = "stridelab.service.kinds.read_batch.run:parse_batch"
"""Import path of the parser of bulk uploads, run by ``POST /recordings/batch`` and by the job ``read-batch``."""

_LIBRARIES: Final = ("numpy", "scipy.optimize", "scipy.spatial", "scipy.stats", "scipy.signal")
READING: Final = (
    *_LIBRARIES,
    "ezc3d",
    "pyarrow.parquet",
    PARSE_UPLOAD.partition(":")[0],
    "stridelab.service.api.stream.session",
    "stridelab.service.api.stream.marker_session",
)
"""Modules preloaded by the fork server for children that parse uploads and for those of streams."""
COMPUTING: Final = (
    *_LIBRARIES,
    *("ezc3d", "pyarrow.parquet", "pinocchio", "casadi"),
    *(kind.run.partition(":")[0] for kind in KINDS.values()),
    *("mujoco", "viser", "stridelab.wholebody.replay.replay"),
)
"""Modules preloaded by the fork server for children that run jobs; runs import the last three lazily.

The database, meshes of robots (trimesh) and learning (scikit-learn) are not: 60 MB that no other child needs.
"""
