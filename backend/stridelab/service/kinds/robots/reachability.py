"""Reachability densities as plottable surfaces and projections, for the robot page, the viewer and learning jobs.

Runs in a killable child of ``GET /robots/{name}/reachability``, so that the service imports no numeric package.
"""

import gzip
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Points
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.card import EffectorCard, Measure, ReachabilityCard
from stridelab.reachability.learning.kde import KernelDensity
from stridelab.reachability.proxy.level_sets import LevelSet, level_sets
from stridelab.reachability.proxy.projections import PLOT_AXES, grid_around, project_kernels, project_mixture
from stridelab.reachability.store import load_card, load_cloud, require_same_robot
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.base import Contract
from stridelab.schemas.reachability import Axis, EffectorReach, LevelSurface, Projection, RobotReachability
from stridelab.schemas.robots import LinkPose, Triple
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import write_atomically
from stridelab.service.kinds.robots.description import proxy_card

REACHABILITY_FILE: Final = "reachability.json.gz"
GZIP: Final = "application/gzip"
MAX_CLOUD_SAMPLES: Final = 2000
"""Number of samples for plots."""
SAMPLE_DIGITS, SURFACE_DIGITS, DENSITY_DIGITS = 3, 4, 4
"""Decimals of samples and surfaces in metres; significant digits of a density."""
AXES: Final[tuple[Axis, Axis, Axis]] = ("x", "y", "z")


class ReachabilityTask(Contract):
    """Task of ``robots.reachability``."""

    robot: str
    measure: Measure


def run(task: ReachabilityTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Write ``reachability.json.gz`` into ``folder``: a ``RobotReachability`` as compressed JSON.

    Raises ``NotFound`` (``robot-not-found``, ``reachability-not-learned``), ``Unavailable`` (``robot-data-missing``,
    ``robot-data-unreadable``, ``reachability-of-another-robot``), ``UnreadableFile`` (``reachability-damaged``).
    """
    card = load_card(task.robot, task.measure)
    progress(0.1, "loading the robot")
    robot = load_robot(task.robot)
    require_same_robot(card, robot)
    progress(0.5, "enclosing level sets")
    shapes = plottable_reachability(robot, card, load_cloud(task.robot, task.measure))
    content = gzip.compress(shapes.model_dump_json().encode(), mtime=0)
    write_atomically(folder / REACHABILITY_FILE, lambda path: path.write_bytes(content))
    progress(1.0, "done")
    return Outcome({"robot": robot.name, "measure": card.measure}, (), (ArtifactFile(REACHABILITY_FILE, GZIP),))


def plottable_reachability(robot: Robot, card: ReachabilityCard, com_m: Mapping[str, Points]) -> RobotReachability:
    """Plottable data of ``card`` and of the sampled CoM positions ``com_m`` of each of its effectors."""
    return RobotReachability(
        robot=robot.name,
        robot_sha256=robot.sha256,
        measure=card.measure,
        effectors=[
            EffectorReach(
                card=proxy_card(card, name),
                reference_pose=reference_pose(robot, name, learned),
                com_m=[_round_point(point, SAMPLE_DIGITS) for point in com_m[name][:MAX_CLOUD_SAMPLES]],
                level_sets=[_level_surface(level_set) for level_set in level_sets(learned.to_mixture())],
                projections=_effector_projections(learned, com_m[name]),
            )
            for name, learned in card.effectors.items()
        ],
    )


def reference_pose(robot: Robot, effector: str, learned: EffectorCard) -> LinkPose:
    """Pose of the density's frame in the reference posture, in which the robot faces x."""
    model, index = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    px, py, pz, qx, qy, qz, qw = (float(v) for v in pin.SE3ToXYZQUAT(data.oMf[index[effector]]))
    return (px, py, pz, 1.0, 0.0, 0.0, 0.0) if learned.frame == "heading" else (px, py, pz, qw, qx, qy, qz)


def _level_surface(level_set: LevelSet) -> LevelSurface:
    return LevelSurface(
        mass=level_set.mass,
        density_per_m3=float(np.exp(level_set.log_density)),
        volume_m3=level_set.volume_m3,
        vertices_m=[_round_point(vertex, SURFACE_DIGITS) for vertex in level_set.vertices_m],
        triangles=[(int(a), int(b), int(c)) for a, b, c in level_set.triangles],
    )


def _effector_projections(learned: EffectorCard, com_m: Points) -> list[Projection]:
    """Projections along x, y and z; kernels of the given samples, with the bandwidth of all samples."""
    kernels, mixture = KernelDensity(com_m, learned.bandwidth_m), learned.to_mixture()
    grid = grid_around(kernels)
    return [
        Projection(
            along=AXES[along],
            right=AXES[right],
            up=AXES[up],
            right_m=[round(float(v), SURFACE_DIGITS) for v in grid.axis_m(right)],
            up_m=[round(float(v), SURFACE_DIGITS) for v in grid.axis_m(up)],
            kernel_per_m2=_round_densities(project_kernels(kernels, grid, along)),
            mixture_per_m2=_round_densities(project_mixture(mixture, grid, along)),
        )
        for along, (right, up) in enumerate(PLOT_AXES)
    ]


def _round_densities(values: Float[np.ndarray, "up right"]) -> list[list[float]]:
    """Round to ``DENSITY_DIGITS`` significant digits of the maximum."""
    top = float(values.max())
    digits = max(0, DENSITY_DIGITS - int(np.floor(np.log10(top))) - 1) if top > 0.0 else 0
    return [[float(v) for v in row] for row in np.round(values, digits)]


def _round_point(point: Float[np.ndarray, "3"], digits: int) -> Triple:
    x, y, z = (round(float(v), digits) for v in point)
    return x, y, z
