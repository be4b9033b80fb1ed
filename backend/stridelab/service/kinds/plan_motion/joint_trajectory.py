"""The joints' motion as a ROS 2 message ``trajectory_msgs/JointTrajectory``, in JSON and YAML.

With positions, velocities and accelerations, controllers interpolate between the points by quintics. The floating base
is not a joint; its pose is in ``joints.csv``, with all samples.
"""

import json
from pathlib import Path
from typing import Any, Final

from stridelab.robots.robot import Robot
from stridelab.service.kinds.base import ArtifactFile
from stridelab.service.kinds.plan_motion.display_tracks import JSON, display_frames
from stridelab.service.kinds.plan_motion.tables import Columns
from stridelab.service.kinds.result_tables import write_text_atomically
from stridelab.wholebody.motion import WholeBodyMotion

STEM: Final = "joint_trajectory"
YAML: Final = "application/yaml"
_DIGITS: Final = 6
_NS: Final = 1_000_000_000
_BASE: Final = ("base_x_m", "base_y_m", "base_z_m", "base_qx", "base_qy", "base_qz", "base_qw")


def joint_trajectory(robot: Robot, motion: WholeBodyMotion) -> dict[str, Any]:
    """The message as a dict, at display rate; efforts are the torques of the motion."""
    points = [
        {
            "positions": _round_values(motion.q[i, 7:]),
            "velocities": _round_values(motion.v[i, 6:]),
            "accelerations": _round_values(motion.a[i, 6:]),
            "effort": _round_values(motion.tau_nm[i]),
            "time_from_start": _ros_duration(float(motion.time_s[i])),
        }
        for i in display_frames(len(motion.time_s), motion.rate_hz)
    ]
    header = {"stamp": _ros_duration(0.0), "frame_id": ""}
    return {"header": header, "joint_names": list(robot.joint_names), "points": points}


def write_trajectory(folder: Path, robot: Robot, motion: WholeBodyMotion) -> tuple[ArtifactFile, ArtifactFile]:
    """Write the message as ``joint_trajectory.json`` and ``joint_trajectory.yaml``."""
    message = joint_trajectory(robot, motion)
    text, block = json.dumps(message, allow_nan=False) + "\n", as_yaml(message)
    write_text_atomically(folder / f"{STEM}.json", text)
    write_text_atomically(folder / f"{STEM}.yaml", block)
    return ArtifactFile(f"{STEM}.json", JSON), ArtifactFile(f"{STEM}.yaml", YAML)


def as_yaml(message: dict[str, Any]) -> str:
    """The message in YAML block style, rows of numbers in flow style without exponents (text in YAML 1.1)."""
    head = message["header"]
    lines = ["header:", f"  stamp: {json.dumps(head['stamp'])}", f"  frame_id: {json.dumps(head['frame_id'])}"]
    lines += ["joint_names:", *(f"- {name}" for name in message["joint_names"]), "points:"]
    for point in message["points"]:
        first, *others = (f"{key}: {_flow_sequence(value)}" for key, value in point.items())
        lines += [f"- {first}", *(f"  {line}" for line in others)]
    return "\n".join(lines) + "\n"


def joint_columns(robot: Robot, motion: WholeBodyMotion) -> Columns:
    """Columns of ``joints``, one row per sample: the base's pose in the world, then all joints in order."""
    columns: Columns = {"time_s": motion.time_s}
    columns |= {name: motion.q[:, i] for i, name in enumerate(_BASE)}
    for i, joint in enumerate(robot.joint_names):
        columns[f"{joint}_rad"] = motion.q[:, 7 + i]
        columns[f"{joint}_rad_s"] = motion.v[:, 6 + i]
        columns[f"{joint}_nm"] = motion.tau_nm[:, i]
    return columns


def _flow_sequence(value: list[float] | dict[str, int]) -> str:
    if isinstance(value, dict):
        return json.dumps(value)
    return "[" + ", ".join(f"{number:.{_DIGITS}f}" for number in value) + "]"


def _round_values(values: Any) -> list[float]:
    return [round(float(value), _DIGITS) for value in values]


def _ros_duration(seconds: float) -> dict[str, int]:
    """``builtin_interfaces/Duration``."""
    sec, nanosec = divmod(round(seconds * _NS), _NS)
    return {"sec": sec, "nanosec": nanosec}
