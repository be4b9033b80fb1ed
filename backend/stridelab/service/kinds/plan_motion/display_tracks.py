"""Tracks for viewers: poses of the links and forces of the effectors at display rate, as raw binary arrays."""

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.conventions import Points, Series
from stridelab.dynamics.spatial import Placement
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.robots.visuals import link_pose_frames
from stridelab.service.kinds.base import ArtifactFile
from stridelab.service.kinds.plan_motion.tables import phase_indices
from stridelab.service.kinds.result_tables import write_atomically, write_text_atomically
from stridelab.wholebody.motion import WholeBodyMotion

if TYPE_CHECKING:
    from stridelab.wholebody.replay.replay import Replay

DISPLAY_HZ = 50.0
RAW, JSON, HTML = "application/octet-stream", "application/json", "text/html"
DESCRIPTION_FILE: Final = "poses.json"
POSE_COLUMNS = ("px", "py", "pz", "qw", "qx", "qy", "qz")
FORCE_COLUMNS = ("px", "py", "pz", "fx", "fy", "fz")

_MIN_FORCE_N = 1e-9
_REPLAY: Final = "replay_"


class DisplayTracks(NamedTuple):
    """Tracks per display frame: poses ``(f, links, 7)`` and forces ``(f, effectors, 6)``."""

    poses: Float[np.ndarray, "f links 7"]
    forces: Float[np.ndarray, "f effectors 6"]


def display_frames(n_samples: int, rate_hz: float) -> Int[np.ndarray, "f"]:
    """Indices of the displayed samples: at a constant stride closest to 50 per second, and the last sample."""
    step = max(1, round(rate_hz / DISPLAY_HZ))
    return np.unique(np.append(np.arange(0, n_samples, step), n_samples - 1))


def display_poses(robot: Robot, q: Float[np.ndarray, "f nq"]) -> Float[np.ndarray, "f links 7"]:
    """Poses ``px py pz qw qx qy qz`` of every link in the world, per frame."""
    return link_pose_frames(robot, q)


def display_forces(motion: WholeBodyMotion, frames: Int[np.ndarray, "f"]) -> Float[np.ndarray, "f effectors 6"]:
    """Point of application and total force of every effector of ``motion.forces_n``, NaN where it has no contact.

    The point of application is the centre of pressure, the mean of the contact points weighted with their normal
    forces; for a contact without load it is the mean of the points.
    """
    sequence = motion.sequence
    phase = phase_indices(sequence, motion.time_s[frames])
    shown = np.full((len(frames), len(motion.forces_n), 6), np.nan)
    for e, (effector, forces) in enumerate(motion.forces_n.items()):
        for i, (frame, p) in enumerate(zip(frames, phase, strict=True)):
            contact = sequence.phases[p].contacts.get(effector)
            if contact is not None:
                shown[i, e, :3] = centre_of_pressure_m(contact.placement, motion.points_m[effector], forces[frame])
                shown[i, e, 3:] = forces[frame].sum(axis=0)
    return shown


def centre_of_pressure_m(placement: Placement, points_m: Points, forces_n: Points) -> Float[np.ndarray, "3"]:
    """Centre of pressure in the world of ``forces_n`` (world frame) on the points ``(k, 3)`` of a contact frame."""
    normal_n = forces_n @ placement.rotation[:, 2]
    total_n = normal_n.sum()
    weights = normal_n / total_n if total_n > _MIN_FORCE_N else np.full(len(points_m), 1.0 / len(points_m))
    return np.asarray(placement.act((weights @ points_m)[None])[0])


def replay_tracks(robot: Robot, replay: "Replay", time_s: Series, effectors: tuple[str, ...]) -> DisplayTracks:
    """The replay at the instants ``time_s`` of the motion, NaN before its first sample and after a fall.

    Forces act at the origin of the effector's contact frame and are NaN without contact.
    """
    model, frame_of = with_contact_frames(robot)
    data = model.createData()
    nearest = np.clip(np.searchsorted(replay.time_s, time_s), 0, len(replay.time_s) - 1)
    there = np.abs(replay.time_s[nearest] - time_s) < 0.5 / DISPLAY_HZ
    poses = np.full((len(time_s), robot.model.njoints - 1, len(POSE_COLUMNS)), np.nan)
    forces = np.full((len(time_s), len(effectors), len(FORCE_COLUMNS)), np.nan)
    poses[there] = link_pose_frames(robot, replay.q[nearest[there]])
    for i in np.flatnonzero(there):
        pin.framesForwardKinematics(model, data, replay.q[nearest[i]])
        for e, effector in enumerate(effectors):
            force_n = replay.forces_n[effector][nearest[i]]
            if np.linalg.norm(force_n) > _MIN_FORCE_N:
                forces[i, e] = [*data.oMf[frame_of[effector]].translation, *force_n]
    return DisplayTracks(poses, forces)


def write_display(
    folder: Path,
    robot_name: str,
    links: tuple[str, ...],
    effectors: tuple[str, ...],
    time_s: Series,
    tracks: DisplayTracks,
) -> tuple[ArtifactFile, ...]:
    """Write ``poses.f32`` and ``forces.f32`` (little endian, C order) and ``poses.json``, which describes both."""
    about = {
        "robot": robot_name,
        "n_frames": len(time_s),
        "time_s": [round(float(t), 6) for t in time_s],
        "links": list(links),
        "columns": list(POSE_COLUMNS),
        "forces": {"file": "forces.f32", "effectors": list(effectors), "columns": list(FORCE_COLUMNS)},
    }
    written = _write_tracks(folder, tracks, "")
    _write_description(folder, about)
    return *written, ArtifactFile(DESCRIPTION_FILE, JSON)


def write_replay_tracks(folder: Path, replayed: DisplayTracks) -> tuple[ArtifactFile, ...]:
    """Write ``replay_poses.f32`` and ``replay_forces.f32``, of the same shape as those of the motion."""
    return _write_tracks(folder, replayed, _REPLAY)


def describe_replay_tracks(folder: Path) -> None:
    """Add the tracks of the replay to ``poses.json``."""
    about = json.loads((folder / DESCRIPTION_FILE).read_text(encoding="utf-8"))
    files = {"poses": f"{_REPLAY}poses.f32", "forces": f"{_REPLAY}forces.f32"}
    _write_description(folder, about | {"replay": files})


def _write_tracks(folder: Path, tracks: DisplayTracks, prefix: str) -> tuple[ArtifactFile, ...]:
    arrays = {f"{prefix}poses.f32": tracks.poses, f"{prefix}forces.f32": tracks.forces}
    for name, values in arrays.items():
        write_atomically(folder / name, partial(_write_floats, values=values))
    return tuple(ArtifactFile(name, RAW) for name in arrays)


def _write_description(folder: Path, about: dict[str, Any]) -> None:
    text = json.dumps(about, allow_nan=False)
    write_text_atomically(folder / DESCRIPTION_FILE, text)


def _write_floats(path: Path, values: np.ndarray) -> None:
    path.write_bytes(values.astype("<f4").tobytes())
