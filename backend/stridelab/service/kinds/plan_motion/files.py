"""Writes the files of ``plan-motion``: tables, arrays, and tracks for viewers."""

import contextlib
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Int
from pydantic import BaseModel

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.pipelines.progress import ProgressCallback
from stridelab.robots.robot import Robot
from stridelab.robots.visuals import glb, link_meshes, link_names, split_glb
from stridelab.schemas.plans import Film
from stridelab.service.filenames import LINKS_FILE
from stridelab.service.kinds.base import ArtifactFile
from stridelab.service.kinds.plan_motion.display_tracks import (
    HTML,
    JSON,
    RAW,
    DisplayTracks,
    describe_replay_tracks,
    display_forces,
    display_frames,
    display_poses,
    replay_tracks,
    write_display,
    write_replay_tracks,
)
from stridelab.service.kinds.plan_motion.joint_trajectory import joint_columns, write_trajectory
from stridelab.service.kinds.plan_motion.tables import (
    centroidal_columns,
    iteration_columns,
    motion_columns,
    replay_columns,
)
from stridelab.service.kinds.plan_motion.video import write_film
from stridelab.service.kinds.plan_motion.viser_recording import (
    PAGE_FILE,
    RECORDING_FILE,
    RECORDING_HZ,
    player_page,
    record_scene,
)
from stridelab.service.kinds.result_tables import write_atomically, write_table, write_text_atomically
from stridelab.wholebody.motion import WholeBodyMotion

if TYPE_CHECKING:
    from stridelab.wholebody.replay.replay import Replay

NPZ = "application/x-npz"
PYTHON = "text/x-python"
PLAYER = "replay_in_mujoco.py"
"""Script that plays ``joints.csv`` on a user's own model, copied as it is."""


def write_plan(folder: Path, plan: CentroidalPlan) -> tuple[ArtifactFile, ...]:
    """``centroidal.parquet`` and ``iterations.parquet`` with their CSV twins."""
    about = _provenance_of(plan.sequence.name, plan.sequence.robot) | {"solver": plan.solver, "mass_kg": plan.mass_kg}
    attempts = plan.solution.attempts if plan.solution is not None else ()
    nodes = write_table(folder, "centroidal", centroidal_columns(plan), about)
    return *nodes, *write_table(folder, "iterations", iteration_columns(attempts), about)


def write_motion(folder: Path, robot: Robot, motion: WholeBodyMotion) -> tuple[ArtifactFile, ...]:
    """Write the tracks for viewers, the motion as tables and arrays, the trajectory, the recording and the player."""
    sequence = motion.sequence
    frames = display_frames(len(motion.time_s), motion.rate_hz)
    shown = DisplayTracks(display_poses(robot, motion.q[frames]), display_forces(motion, frames))
    effectors = tuple(motion.forces_n)
    display = write_display(folder, robot.name, link_names(robot), effectors, motion.time_s[frames], shown)
    limits_nm = np.asarray(robot.model.effortLimit)[6:]
    about = _provenance_of(sequence.name, robot.name) | {"rate_hz": motion.rate_hz}
    tables = (
        *write_table(folder, "motion", motion_columns(motion, limits_nm), about),
        *write_table(folder, "joints", joint_columns(robot, motion), about),
    )
    arrays = write_arrays(folder / "motion.npz", motion_arrays(robot, motion))
    trajectory = write_trajectory(folder, robot, motion)
    filmed = shown.poses[:: _film_stride(motion, frames)]
    recording = record_scene(sequence.terrain, _link_files(folder, robot), filmed, RECORDING_HZ)
    write_atomically(folder / RECORDING_FILE, lambda path: path.write_bytes(recording))
    write_text_atomically(folder / PAGE_FILE, player_page(recording))
    shutil.copyfile(Path(__file__).with_name(PLAYER), folder / PLAYER)
    player = [ArtifactFile(RECORDING_FILE, RAW), ArtifactFile(PAGE_FILE, HTML), ArtifactFile(PLAYER, PYTHON)]
    return (*display, *tables, arrays, *trajectory, *player)


def _link_files(folder: Path, robot: Robot) -> dict[str, bytes]:
    """GLB file of every link by its name: from the staged file of the service, or else made anew in some seconds."""
    with contextlib.suppress(OSError, ValueError):
        links = split_glb((folder / LINKS_FILE).read_bytes())
        if tuple(links) == link_names(robot):
            return links
    return {mesh.name: glb([mesh]) for mesh in link_meshes(robot)}


def write_motion_film(
    folder: Path, robot: Robot, motion: WholeBodyMotion, film: Film, progress: ProgressCallback
) -> ArtifactFile:
    """``motion.gif`` or ``motion.mp4``. Raises ``NotEstimable`` (``film-failed``) with ffmpeg's last message."""
    frames = display_frames(len(motion.time_s), motion.rate_hz)
    filmed = display_poses(robot, motion.q[frames[:: _film_stride(motion, frames)]])
    return write_film(folder, film, motion.sequence.terrain, link_meshes(robot), filmed, RECORDING_HZ, progress)


def _film_stride(motion: WholeBodyMotion, frames: Int[np.ndarray, "f"]) -> int:
    """Every how many of ``frames`` there is one of the recording and of a film."""
    lasts_s = float(motion.time_s[-1] - motion.time_s[0])
    return max(1, round((len(frames) - 1) / lasts_s / RECORDING_HZ)) if lasts_s > 0.0 else 1


def write_replay(folder: Path, robot: Robot, motion: WholeBodyMotion, replay: "Replay") -> tuple[ArtifactFile, ...]:
    """``replay.npz``: ``time_s``, ``q``, ``v`` in pinocchio's order and the total contact force per effector.

    ``replay.parquet`` with its CSV twin: the CoM and the forces as columns. The tracks for viewers are described beside
    those that ``write_motion`` has written for ``motion``.
    """
    written = write_replay_data(folder, robot, motion, replay)
    describe_replay_tracks(folder)
    return written


def write_replay_data(
    folder: Path, robot: Robot, motion: WholeBodyMotion, replay: "Replay"
) -> tuple[ArtifactFile, ...]:
    """The files of ``write_replay``, which may precede those of the motion, as the tracks are not described."""
    frames = display_frames(len(motion.time_s), motion.rate_hz)
    replayed = replay_tracks(robot, replay, motion.time_s[frames], tuple(motion.forces_n))
    forces = {f"forces_{effector}": track for effector, track in replay.forces_n.items()}
    arrays = {"time_s": replay.time_s, "q": replay.q, "v": replay.v, **forces}
    tables = write_table(folder, "replay", replay_columns(replay), {})
    return *write_replay_tracks(folder, replayed), write_arrays(folder / "replay.npz", arrays), *tables


def write_mcap(folder: Path, robot: Robot, motion: WholeBodyMotion, replay: "Replay | None") -> ArtifactFile:
    """``motion.mcap``, a log for Foxglove and Rerun."""
    from stridelab.service.kinds.plan_motion.motion_log import write_motion_log  # 40 modules for an option

    return write_motion_log(folder, robot, motion, replay)


def write_json(folder: Path, name: str, value: BaseModel) -> ArtifactFile:
    """Write a model of the contract as JSON without null values."""
    text = value.model_dump_json(indent=2, exclude_none=True) + "\n"
    write_text_atomically(folder / name, text)
    return ArtifactFile(name, JSON)


def motion_arrays(robot: Robot, motion: WholeBodyMotion) -> dict[str, np.ndarray]:
    """Arrays of ``motion.npz``: ``time_s (n)``, ``q (n, nq)``, ``v``, ``a (n, nv)``, ``tau (n, nv - 6)``.

    ``joint_names`` name the columns of ``tau``; ``forces (n, e, 3)`` is the total force of each of the ``effectors``,
    ``forces_<effector> (n, k, 3)`` the force at each of its points, which lie at ``points_<effector> (k, 3)`` in its
    contact frame. Forces are in the world frame and zero without contact.
    """
    effectors = tuple(motion.forces_n)
    arrays = {
        "time_s": motion.time_s,
        "q": motion.q,
        "v": motion.v,
        "a": motion.a,
        "tau": motion.tau_nm,
        "joint_names": np.array(robot.joint_names),
        "effectors": np.array(effectors),
        "forces": np.stack([motion.forces_n[effector].sum(axis=1) for effector in effectors], axis=1),
    }
    arrays |= {f"forces_{effector}": motion.forces_n[effector] for effector in effectors}
    arrays |= {f"points_{effector}": motion.points_m[effector] for effector in effectors}
    return arrays


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> ArtifactFile:
    """Write a compressed ``.npz`` file without pickled objects. Raises ``ValueError`` for an array of objects."""
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise ValueError(f"{name} contains objects")

    write_atomically(path, lambda part: np.savez_compressed(part, allow_pickle=False, **arrays))
    return ArtifactFile(path.name, NPZ)


def _provenance_of(scenario: str, robot: str) -> dict[str, Any]:
    return {"scenario": scenario, "robot": robot, "frame": "world, z up"}
