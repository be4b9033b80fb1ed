"""A motion as an MCAP log with the protobuf messages of Foxglove, which Foxglove and Rerun open.

    /tf          foxglove.FrameTransforms   pose of every link in ``world``
    /joints      foxglove.JointStates       angle, velocity and torque of every joint
    /com         foxglove.PoseInFrame       centre of mass
    /forces      foxglove.SceneUpdate       an arrow per loaded effector, a metre for ``NEWTON_PER_M``
    /scene       foxglove.SceneUpdate       terrain and shapes of the links, once at the beginning
    /replay/tf   foxglove.FrameTransforms   pose of every link of the replay, as ``replay/LINK``

Times are those of the motion: the log begins at 0, in 1970.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.ModelPrimitive_pb2 import ModelPrimitive
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from jaxtyping import Float
from mcap_protobuf.writer import Writer
from scipy.spatial.transform import Rotation

from stridelab.contacts.terrain import Box, Terrain
from stridelab.robots.robot import Robot
from stridelab.robots.visuals import LinkMesh, glb, link_meshes, link_names
from stridelab.service.kinds.base import ArtifactFile
from stridelab.service.kinds.plan_motion.display_tracks import (
    DisplayTracks,
    display_forces,
    display_frames,
    display_poses,
    replay_tracks,
)
from stridelab.service.kinds.result_tables import write_atomically
from stridelab.wholebody.motion import WholeBodyMotion

LOG_FILE: Final = "motion.mcap"
MCAP: Final = "application/octet-stream"
WORLD: Final = "world"
NEWTON_PER_M: Final = 1000.0
_NS: Final = 1_000_000_000
_SHAFT_M, _HEAD_M, _MIN_FORCE_N = 0.02, 0.05, 1.0
_GROUND, _ARROW = Color(r=0.81, g=0.83, b=0.85, a=1.0), Color(r=0.9, g=0.4, b=0.1, a=1.0)


def write_motion_log(folder: Path, robot: Robot, motion: WholeBodyMotion, replay: Any | None) -> ArtifactFile:
    """``motion.mcap``: ``motion`` at display rate, with the ``Replay`` of it, if any."""
    frames = display_frames(len(motion.time_s), motion.rate_hz)
    time_s, shown = (
        motion.time_s[frames],
        DisplayTracks(display_poses(robot, motion.q[frames]), display_forces(motion, frames)),
    )
    replayed = None if replay is None else replay_tracks(robot, replay, time_s, tuple(motion.forces_n)).poses
    links = link_names(robot)

    def write(path: Path) -> None:
        with path.open("wb") as file:
            log = MotionLog(file, links, tuple(motion.forces_n))
            log.add_scene(motion.sequence.terrain, link_meshes(robot))
            for k, (frame, t) in enumerate(zip(frames.tolist(), time_s.tolist(), strict=True)):
                log.add_poses(t, shown.poses[k])
                log.add_joints(t, robot.joint_names, motion.q[frame, 7:], motion.v[frame, 6:], motion.tau_nm[frame])
                log.add_com(t, motion.com_m[frame])
                log.add_forces(t, shown.forces[k])
                if replayed is not None and np.isfinite(replayed[k]).all():
                    log.add_poses(t, replayed[k], "replay/")
            log.finish()

    write_atomically(folder / LOG_FILE, write)
    return ArtifactFile(LOG_FILE, MCAP)


class MotionLog:
    """Writes the messages of one log into ``file``, in the order of their times; ``finish`` ends it.

    ``links`` name the rows of poses, ``effectors`` those of forces.
    """

    def __init__(self, file: IO[bytes], links: Sequence[str], effectors: Sequence[str]) -> None:
        self._writer, self._links, self._effectors = Writer(file), tuple(links), tuple(effectors)

    def add_scene(self, terrain: Terrain, links: Sequence[LinkMesh]) -> None:
        """The terrain, and the shape of every link, which moves with its frame."""
        stamp = _stamp(0.0)
        ground = SceneEntity(timestamp=stamp, frame_id=WORLD, id="terrain")
        for surface in terrain.surfaces:
            if isinstance(surface, Box):
                place = _pose(surface.placement.position_m, surface.placement.wxyz)
                ground.cubes.append(CubePrimitive(pose=place, size=_vector(surface.size_m), color=_GROUND))
                continue
            along = surface.to_m - surface.from_m
            place = _pose(0.5 * (surface.from_m + surface.to_m), _turn_towards(along, (0.0, 0.0, 1.0)))
            size = Vector3(x=2.0 * surface.radius_m, y=2.0 * surface.radius_m, z=float(np.linalg.norm(along)))
            rail = CylinderPrimitive(pose=place, size=size, bottom_scale=1.0, top_scale=1.0, color=_GROUND)
            ground.cylinders.append(rail)
        shapes = [self._shape_of(link) for link in links if len(link.faces)]
        self._write("/scene", 0.0, SceneUpdate(entities=[ground, *shapes]))

    def add_poses(self, time_s: float, poses: Float[np.ndarray, "links 7"], prefix: str = "") -> None:
        """Poses ``px py pz qw qx qy qz`` of the links, as frames named ``prefix`` and the link's name."""
        stamp = _stamp(time_s)
        transforms = [
            FrameTransform(
                timestamp=stamp,
                parent_frame_id=WORLD,
                child_frame_id=prefix + name,
                translation=_vector(pose[:3]),
                rotation=_quaternion(pose[3:]),
            )
            for name, pose in zip(self._links, poses.tolist(), strict=True)
        ]
        self._write(f"/{prefix}tf", time_s, FrameTransforms(transforms=transforms))

    def add_joints(
        self,
        time_s: float,
        names: Sequence[str],
        angles_rad: Float[np.ndarray, "n"],
        rates_rad_s: Float[np.ndarray, "n"],
        torques_nm: Float[np.ndarray, "n"],
    ) -> None:
        """State of the joints ``names``."""
        rows = zip(names, angles_rad.tolist(), rates_rad_s.tolist(), torques_nm.tolist(), strict=True)
        joints = [JointState(name=name, position=q, velocity=v, effort=tau) for name, q, v, tau in rows]
        self._write("/joints", time_s, JointStates(timestamp=_stamp(time_s), joints=joints))

    def add_com(self, time_s: float, com_m: Float[np.ndarray, "3"]) -> None:
        """The centre of mass."""
        place = _pose(com_m, (1.0, 0.0, 0.0, 0.0))
        self._write("/com", time_s, PoseInFrame(timestamp=_stamp(time_s), frame_id=WORLD, pose=place))

    def add_forces(self, time_s: float, forces: Float[np.ndarray, "effectors 6"]) -> None:
        """Points of application and forces ``px py pz fx fy fz`` on the effectors; NaN without contact."""
        entities = []
        for name, row in zip(self._effectors, forces, strict=True):
            entity = SceneEntity(timestamp=_stamp(time_s), frame_id=WORLD, id=name)  # an empty one hides the last
            force_n = float(np.linalg.norm(row[3:]))
            if force_n > _MIN_FORCE_N:
                arrow = ArrowPrimitive(
                    pose=_pose(row[:3], _turn_towards(row[3:], (1.0, 0.0, 0.0))),
                    shaft_length=force_n / NEWTON_PER_M,
                    shaft_diameter=_SHAFT_M,
                    head_length=_HEAD_M,
                    head_diameter=_HEAD_M,
                    color=_ARROW,
                )
                entity.arrows.append(arrow)
            entities.append(entity)
        self._write("/forces", time_s, SceneUpdate(entities=entities))

    def finish(self) -> None:
        """Write the index; without it, a reader has to search the whole file."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _write(self, topic: str, time_s: float, message: Any) -> None:
        at_ns = round(time_s * _NS)
        self._writer.write_message(topic, message, log_time=at_ns, publish_time=at_ns)

    @staticmethod
    def _shape_of(link: LinkMesh) -> SceneEntity:
        model = ModelPrimitive(
            pose=_pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
            scale=Vector3(x=1.0, y=1.0, z=1.0),
            media_type="model/gltf-binary",
            data=glb([link]),
        )
        at = _stamp(0.0)
        return SceneEntity(timestamp=at, frame_id=link.name, id=link.name, frame_locked=True, models=[model])


def _stamp(time_s: float) -> Timestamp:
    seconds, nanos = divmod(round(time_s * _NS), _NS)
    return Timestamp(seconds=seconds, nanos=nanos)


def _vector(v: Any) -> Vector3:
    x, y, z = (float(part) for part in v)
    return Vector3(x=x, y=y, z=z)


def _quaternion(wxyz: Any) -> Quaternion:
    w, x, y, z = (float(part) for part in wxyz)
    return Quaternion(x=x, y=y, z=z, w=w)


def _pose(position_m: Any, wxyz: Any) -> Pose:
    return Pose(position=_vector(position_m), orientation=_quaternion(wxyz))


def _turn_towards(direction: Float[np.ndarray, "3"], axis: tuple[float, float, float]) -> Float[np.ndarray, "4"]:
    """Quaternion (w, x, y, z) that turns ``axis`` into ``direction``."""
    turn, _ = Rotation.align_vectors(direction[None], [axis])
    x, y, z, w = turn.as_quat()
    return np.array([w, x, y, z])
