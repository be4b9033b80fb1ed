"""Meshes of a robot for the viewer: one named mesh per moving link, as binary glTF.

Runs in a killable child of the web server, at the first start of a service or at the first request of the meshes.
"""

from pathlib import Path
from typing import Final

from stridelab.pipelines.progress import ProgressCallback
from stridelab.robots.loader import load_robot
from stridelab.robots.visuals import glb, link_meshes
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import write_atomically
from stridelab.service.kinds.robots.description import RobotTask
from stridelab.service.source_hash import CACHED_LINKS_FILE

GLTF: Final = "model/gltf-binary"


def run(task: RobotTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Write ``links.glb`` into ``folder``; the summary names the nodes.

    Raises ``NotFound`` (``robot-not-found``) or ``Unavailable`` (``robot-data-missing``, ``robot-data-unreadable``).
    """
    progress(0.05, "loading the robot")
    robot = load_robot(task.robot)
    progress(0.4, "simplifying its meshes")
    meshes = link_meshes(robot)
    progress(0.9, "writing them")
    data = glb(meshes)
    write_atomically(folder / CACHED_LINKS_FILE, lambda path: path.write_bytes(data))
    progress(1.0, "done")
    summary = {"robot": robot.name, "sha256": robot.sha256, "links": [mesh.name for mesh in meshes]}
    return Outcome(summary, (), (ArtifactFile(CACHED_LINKS_FILE, GLTF),))
