"""The script that plays a motion on a user's own MJCF: joints by name, the base by its free joint."""

import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from stridelab.service.kinds.plan_motion import replay_in_mujoco
from stridelab.service.kinds.plan_motion.replay_in_mujoco import positions, read_motion

GEOM = '<geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03"/>'
MODEL = f"""<mujoco><worldbody><body name="pelvis"><freejoint/><geom size="0.1"/>
  <body name="thigh" pos="0 0 -0.1"><joint name="mine/hip_joint" axis="0 1 0"/>{GEOM}
    <body name="shank" pos="0 0 -0.4"><joint name="knee" axis="0 1 0"/>{GEOM}
      <body name="toe" pos="0 0 -0.4"><joint name="toe_joint" axis="0 1 0"/><geom size="0.02"/></body>
    </body></body></body></worldbody></mujoco>"""
COLUMNS = "time_s,base_x_m,base_y_m,base_z_m,base_qx,base_qy,base_qz,base_qw"
MOTION = f"""{COLUMNS},hip_joint_rad,hip_joint_rad_s,knee_joint_rad,arm_rad
0.0,0.1,0.2,0.9,0.0,0.0,0.0,1.0,0.3,0.0,-0.5,1.0
0.1,0.2,0.2,0.8,0.0,0.0,0.6,0.8,0.4,0.0,-0.6,1.0
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "robot.xml").write_text(MODEL)
    (tmp_path / "joints.csv").write_text(MOTION)
    shutil.copyfile(replay_in_mujoco.__file__, tmp_path / "replay_in_mujoco.py")
    return tmp_path


def test_base_and_joints_of_other_names_are_set(folder: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(folder / "robot.xml"))
    qpos = positions(model, read_motion(folder / "joints.csv"))
    assert qpos[0] == pytest.approx([0.1, 0.2, 0.9, 1.0, 0.0, 0.0, 0.0, 0.3, -0.5, 0.0])
    assert qpos[1] == pytest.approx([0.2, 0.2, 0.8, 0.8, 0.0, 0.0, 0.6, 0.4, -0.6, 0.0])


def test_the_script_runs_alone_and_reports_the_fit(folder: Path) -> None:
    command = [sys.executable, "replay_in_mujoco.py", "robot.xml", "--check"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    model = mujoco.MjModel.from_xml_path(str(folder / "robot.xml"))
    data = mujoco.MjData(model)
    data.qpos[:] = positions(model, read_motion(folder / "joints.csv"))[0]
    mujoco.mj_forward(model, data)
    assert run.stdout.startswith(f"2 joints fit; centre of mass {data.subtree_com[0, 2]:.3f} m high at the start")
    assert run.stdout.rstrip().endswith("not in the model: arm_rad")
    assert np.isfinite(data.qpos).all()
