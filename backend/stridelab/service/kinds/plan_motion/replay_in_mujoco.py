"""Plays the motion of this folder in MuJoCo, on your own model of the robot. Needs the package mujoco alone.

python replay_in_mujoco.py ROBOT.xml            opens MuJoCo's window and repeats the motion (macOS: mjpython)
python replay_in_mujoco.py ROBOT.xml --check    without a window: which joints fit, and where the model would stand

``joints.csv`` holds the pose of the base and the angle of every joint. A joint of the model fits by its name, also with
a prefix (``robot/leg_left_1_joint``) or without the ending ``_joint``; others stay where they are. The body with the
free joint must be the base link of the plan. The motion is shown, not simulated: every sample sets ``qpos``.
"""

import csv
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import mujoco
import mujoco.viewer
import numpy as np

BASE = ("base_x_m", "base_y_m", "base_z_m", "base_qw", "base_qx", "base_qy", "base_qz")
AXIS_JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def read_motion(path: Path) -> dict[str, np.ndarray]:
    """Columns of ``joints.csv``."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def plain_name(joint: str) -> str:
    """A joint's name without prefixes of namespaces and the ending ``_joint``."""
    return joint.rpartition("/")[2].removesuffix("_joint")


def matching_columns(model: mujoco.MjModel, columns: Sequence[str]) -> dict[int, str]:
    """Column of every hinge or slide joint of the model that the motion has, by the joint's index."""
    angles = {plain_name(name.removesuffix("_rad")): name for name in columns if name.endswith("_rad")}
    matching = {}
    for joint in range(model.njnt):
        column = angles.get(plain_name(model.joint(joint).name))
        if column is not None and int(model.jnt_type[joint]) in AXIS_JOINTS:
            matching[joint] = column
    return matching


def positions(model: mujoco.MjModel, motion: dict[str, np.ndarray]) -> np.ndarray:
    """``qpos`` of every sample (n, nq); joints that the motion lacks stay at the model's ``qpos0``."""
    qpos = np.tile(model.qpos0, (len(motion["time_s"]), 1))
    for joint in range(model.njnt):
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            start = model.jnt_qposadr[joint]
            qpos[:, start : start + 7] = np.column_stack([motion[name] for name in BASE])
            break
    for joint, column in matching_columns(model, list(motion)).items():
        qpos[:, model.jnt_qposadr[joint]] = motion[column]
    return qpos


def report(model: mujoco.MjModel, motion: dict[str, np.ndarray], qpos: np.ndarray) -> str:
    """Which joints fit, and the height of the centre of mass at the start and at the end."""
    data, heights = mujoco.MjData(model), []
    for sample in (0, -1):
        data.qpos[:] = qpos[sample]
        mujoco.mj_forward(model, data)
        heights.append(float(data.subtree_com[0, 2]))
    columns = set(matching_columns(model, list(motion)).values())
    missing = [name for name in motion if name.endswith("_rad") and name not in columns]
    text = (
        f"{len(columns)} joints fit; centre of mass {heights[0]:.3f} m high at the start, {heights[1]:.3f} m at the end"
    )
    return text if not missing else f"{text}; not in the model: {', '.join(missing)}"


def play(model: mujoco.MjModel, motion: dict[str, np.ndarray], qpos: np.ndarray) -> None:
    """Repeat the motion in MuJoCo's window until it is closed."""
    data = mujoco.MjData(model)
    with mujoco.viewer.launch_passive(model, data) as viewer:
        while viewer.is_running():
            begun = time.perf_counter()
            while viewer.is_running() and (at := time.perf_counter() - begun) < motion["time_s"][-1]:
                data.qpos[:] = qpos[np.searchsorted(motion["time_s"], at).clip(max=len(qpos) - 1)]
                mujoco.mj_forward(model, data)
                viewer.sync()
                time.sleep(0.01)


def main() -> None:
    """Read the model and the motion beside this file."""
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    model, motion = mujoco.MjModel.from_xml_path(sys.argv[1]), read_motion(Path(__file__).with_name("joints.csv"))
    qpos = positions(model, motion)
    sys.stdout.write(report(model, motion, qpos) + "\n")
    if "--check" not in sys.argv:
        play(model, motion, qpos)


if __name__ == "__main__":
    main()
