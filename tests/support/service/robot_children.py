"""Stand-ins for the children that describe and draw robots and their reach.

Each run leaves a line in the file ``$ROBOT_DIARY``, outside of its folder: they are run without a sandbox.
"""

import gzip
import json
import os
import time
from pathlib import Path
from typing import Any

from stridelab.errors import InvalidInput, Unavailable

GLB = b"glTF\x02\x00\x00\x00" + bytes(range(256))
FACTS: dict[str, Any] = {
    "name": "talos",
    "own": False,
    "title": "TALOS",
    "mass_kg": 90.27,
    "licence": "CC BY-NC-ND 3.0",
    "sha256": "ab" * 32,
    "effectors": [
        {
            "name": "left_foot",
            "frame": "left_sole_link",
            "kind": "surface",
            "position_m": [0.0, 0.0, 0.0],
            "orientation_wxyz": [1.0, 0.0, 0.0, 0.0],
            "contact_half_size_m": [0.1, 0.06],
        }
    ],
    "q_reference": [0.0, 0.0, 1.02, 0.0, 0.0, 0.0, 1.0],
    "com_height_m": 0.88,
    "limits": [],
    "links": ["base_link"],
    "link_poses": [[0.0, 0.0, 1.02, 1.0, 0.0, 0.0, 0.0]],
    "proxies": [],
    "measures": ["uniform"],
    "stale_measures": [],
    "default_measure": "uniform",
    "walker": None,
}
REACH = {"robot": "talos", "robot_sha256": "ab" * 32, "measure": "uniform", "effectors": []}


def _note(word: str) -> None:
    with Path(os.environ["ROBOT_DIARY"]).open("a", encoding="utf-8") as diary:
        diary.write(f"{word}\n")


def describe(task: dict[str, Any], _folder: Path, progress: Any) -> dict[str, Any]:
    _note(f"describe {task['robot']}")
    progress(0.5, "half way")
    time.sleep(0.3)
    return {"summary": FACTS, "references": [], "artifacts": []}


def describe_nicely(_task: dict[str, Any], _folder: Path, _progress: Any) -> dict[str, Any]:
    """A robot of which nothing was learned; notes the child's niceness."""
    _note(str(os.nice(0)))
    return {"summary": {**FACTS, "measures": []}, "references": [], "artifacts": []}


def draw_nicely(_task: dict[str, Any], folder: Path, _progress: Any) -> dict[str, Any]:
    _note(str(os.nice(0)))
    (folder / "links.glb").write_bytes(GLB)
    return {"summary": {}, "references": [], "artifacts": []}


def describe_changed(_task: dict[str, Any], _folder: Path, _progress: Any) -> dict[str, Any]:
    """A robot whose densities were learned on another description."""
    return {"summary": {**FACTS, "measures": [], "stale_measures": ["uniform"]}, "references": [], "artifacts": []}


def draw(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    _note(f"draw {task['robot']}")
    progress(0.5, "half way")
    time.sleep(0.3)
    (folder / "links.glb").write_bytes(GLB)
    return {"summary": {}, "references": [], "artifacts": [{"name": "links.glb", "media_type": "model/gltf-binary"}]}


def enclose(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    _note(f"enclose {task['robot']} {task['measure']}")
    progress(0.5, "half way")
    time.sleep(0.3)
    (folder / "reachability.json.gz").write_bytes(gzip.compress(json.dumps(REACH).encode()))
    return {"summary": {}, "references": [], "artifacts": []}


def no_data(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    _note("no data")
    raise Unavailable("robot-data-missing", "The description of TALOS is missing.")


def bad_card(task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    _note(f"bad card {task['robot']}")
    raise InvalidInput("robot-card-invalid", "The card is invalid. base_frame: there is no frame 'chassis'")


def crash(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    _note("crash")
    os.abort()
