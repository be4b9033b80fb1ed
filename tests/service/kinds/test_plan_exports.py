"""What viewers, robots and people are given of a motion: display files, the replay beside, joint trajectories."""

import json

import numpy as np
import pinocchio as pin
import pyarrow.parquet as pq
import pytest
import yaml

from stridelab.robots.loader import load_robot
from support.robots.plans import Planned, short_walk


def test_the_display_files_are_the_motion(walked: Planned) -> None:
    robot, arrays = load_robot("talos"), walked.arrays()
    about = json.loads((walked.folder / "poses.json").read_text())
    poses = np.frombuffer((walked.folder / "poses.f32").read_bytes(), "<f4").reshape(about["n_frames"], -1, 7)
    shown_s = np.array(about["time_s"])
    assert np.diff(shown_s) == pytest.approx(np.full(len(shown_s) - 1, 0.02))
    assert shown_s[-1] == pytest.approx(walked.summary.duration_s)
    data = robot.model.createData()
    foot = about["links"].index("leg_right_6_link")
    joint = robot.model.getJointId("leg_right_6_joint")
    samples = np.round(shown_s * 250.0).astype(int)
    for frame in range(0, len(shown_s), 17):
        pin.forwardKinematics(robot.model, data, arrays["q"][samples[frame]])
        np.testing.assert_allclose(poses[frame, foot, :3], data.oMi[joint].translation, atol=1e-6)
    effectors = about["forces"]["effectors"]
    forces = np.frombuffer((walked.folder / "forces.f32").read_bytes(), "<f4").reshape(len(shown_s), len(effectors), 6)
    np.testing.assert_allclose(np.nan_to_num(forces[..., 3:]), arrays["forces"][samples], rtol=1e-6, atol=1e-4)
    ends_s = np.cumsum([phase.duration_s for phase in short_walk().phases])
    phase = np.minimum(np.searchsorted(ends_s, shown_s + 1e-9, side="right"), len(ends_s) - 1)
    standing = np.array(
        [[e in {c.effector for c in short_walk().phases[p].contacts} for e in effectors] for p in phase]
    )
    np.testing.assert_array_equal(np.isfinite(forces).all(axis=2), standing)
    np.testing.assert_array_equal(np.isnan(forces).all(axis=2), ~standing)


def test_the_replay_is_an_artifact(walked: Planned) -> None:
    with np.load(walked.folder / "replay.npz", allow_pickle=False) as read:
        n = len(read["time_s"])
        assert read["q"].shape == (n, load_robot("talos").model.nq)
        assert read["v"].shape == (n, load_robot("talos").model.nv)
        total = read["forces_left_foot"] + read["forces_right_foot"]
    weight_n = load_robot("talos").mass_kg * 9.81
    assert np.median(total[:, 2]) == pytest.approx(weight_n, rel=0.05)


def test_the_replay_is_shown_at_the_instants_of_the_motion(walked: Planned) -> None:
    about = json.loads((walked.folder / "poses.json").read_text())
    assert about["replay"] == {"poses": "replay_poses.f32", "forces": "replay_forces.f32"}
    shape = (about["n_frames"], len(about["links"]), 7)
    planned, replayed = (
        np.frombuffer((walked.folder / name).read_bytes(), "<f4").reshape(shape)
        for name in ("poses.f32", "replay_poses.f32")
    )
    assert np.isfinite(replayed[1:]).all(), "the robot stays on its feet"
    away_m = np.linalg.norm(planned[1:, 0, :3] - replayed[1:, 0, :3], axis=1)
    assert 0.0 < away_m.max() < 0.03
    effectors = about["forces"]["effectors"]
    forces = np.frombuffer((walked.folder / "replay_forces.f32").read_bytes(), "<f4").reshape(shape[0], -1, 6)
    weight_n = load_robot("talos").mass_kg * 9.81
    assert np.median(np.nansum(forces[..., 5], axis=1)) == pytest.approx(weight_n, rel=0.05)
    left = forces[len(forces) // 2 :, effectors.index("left_foot")]
    standing = left[np.isfinite(left).all(axis=1)]
    assert np.abs(standing[-1, :3] - short_walk().phases[-1].contacts[0].position_m).max() < 0.02
    table = pq.read_table(walked.folder / "replay.parquet")
    with np.load(walked.folder / "replay.npz", allow_pickle=False) as read:
        np.testing.assert_array_equal(table["f_left_foot_z_n"].to_numpy(), read["forces_left_foot"][:, 2])


def test_the_trajectory_for_ros_is_the_motion_in_json_and_yaml(walked: Planned) -> None:
    message = json.loads((walked.folder / "joint_trajectory.json").read_text())
    assert yaml.safe_load((walked.folder / "joint_trajectory.yaml").read_text()) == message
    assert list(message) == ["header", "joint_names", "points"]
    robot, arrays = load_robot("talos"), walked.arrays()
    assert message["joint_names"] == list(robot.joint_names)
    last_ns = -1
    for point in message["points"]:
        since = point["time_from_start"]
        time_ns = since["sec"] * 10**9 + since["nanosec"]
        assert time_ns > last_ns
        last_ns = time_ns
        i = round(time_ns * 250e-9)
        for key, values in {
            "positions": arrays["q"][:, 7:],
            "velocities": arrays["v"][:, 6:],
            "accelerations": arrays["a"][:, 6:],
            "effort": arrays["tau"],
        }.items():
            np.testing.assert_allclose(point[key], values[i], atol=1e-6)
    assert last_ns == round(1e9 * walked.summary.duration_s)


def test_the_joints_table_holds_every_sample(walked: Planned) -> None:
    table, arrays = pq.read_table(walked.folder / "joints.parquet"), walked.arrays()
    knee = list(load_robot("talos").joint_names).index("leg_left_4_joint")
    np.testing.assert_array_equal(table["leg_left_4_joint_rad"].to_numpy(), arrays["q"][:, 7 + knee])
    np.testing.assert_array_equal(table["leg_left_4_joint_nm"].to_numpy(), arrays["tau"][:, knee])
    np.testing.assert_array_equal(table["base_z_m"].to_numpy(), arrays["q"][:, 2])
