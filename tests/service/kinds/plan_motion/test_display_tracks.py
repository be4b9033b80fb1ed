"""What viewers and programs read: poses are forward kinematics, forces act where they push, arrays need no pickle."""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stridelab.dynamics.spatial import Placement
from stridelab.robots.visuals import link_meshes
from stridelab.service.kinds.plan_motion.display_tracks import (
    DisplayTracks,
    centre_of_pressure_m,
    display_forces,
    display_frames,
    display_poses,
    write_display,
)
from stridelab.service.kinds.plan_motion.files import motion_arrays, write_arrays
from support.robots.plans import FEET, corners_m, made_up_motion, talos


def test_fifty_frames_a_second_and_the_last_one() -> None:
    assert display_frames(501, 250.0).tolist() == list(range(0, 501, 5))
    assert display_frames(503, 250.0)[-2:].tolist() == [500, 502]
    assert display_frames(11, 25.0).tolist() == list(range(11))


def test_poses_are_forward_kinematics_and_survive_the_file(tmp_path: Path) -> None:
    robot, motion = talos(), made_up_motion()
    frames = display_frames(len(motion.time_s), motion.rate_hz)
    links = tuple(link.name for link in link_meshes(robot))
    poses = display_poses(robot, motion.q[frames])
    forces = display_forces(motion, frames)
    written = write_display(tmp_path, "talos", links, FEET, motion.time_s[frames], DisplayTracks(poses, forces))
    assert (
        {a.name for a in written} == {"poses.f32", "poses.json", "forces.f32"} == {p.name for p in tmp_path.iterdir()}
    )
    about = json.loads((tmp_path / "poses.json").read_text())
    assert (about["robot"], about["n_frames"], about["links"]) == ("talos", 101, list(links))
    np.testing.assert_allclose(about["time_s"], motion.time_s[frames], atol=1e-6)
    read = np.frombuffer((tmp_path / "poses.f32").read_bytes(), "<f4").reshape(101, len(links), len(about["columns"]))
    shape = (101, len(about["forces"]["effectors"]), len(about["forces"]["columns"]))
    read_forces = np.frombuffer((tmp_path / about["forces"]["file"]).read_bytes(), "<f4").reshape(shape)
    np.testing.assert_array_equal(read_forces, forces.astype("<f4"))

    data = robot.model.createData()
    for frame in (0, 37, 100):
        pin.framesForwardKinematics(robot.model, data, motion.q[frames[frame]])
        for k, name in enumerate(links):
            truth = data.oMi[_joint_of(name)]
            np.testing.assert_allclose(read[frame, k, :3], truth.translation, atol=1e-6)
            w, x, y, z = (float(value) for value in read[frame, k, 3:])
            np.testing.assert_allclose(pin.Quaternion(w, x, y, z).matrix(), truth.rotation, atol=1e-6)


def _joint_of(link: str) -> int:
    """The joint that moves a link: the parent joint of the body frame of that name."""
    model = talos().model
    return int(model.frames[model.getFrameId(link, pin.FrameType.BODY)].parentJoint)


def test_a_force_acts_where_the_corners_push_together_and_is_missing_in_the_air() -> None:
    motion = made_up_motion()
    forces = display_forces(motion, display_frames(len(motion.time_s), motion.rate_hz))
    # corners carry 1, 2, 3, 4 tenths: x = 0.08 (1 - 2 - 3 + 4) / 10 = 0, y = 0.045 (1 + 2 - 3 - 4) / 10
    assert forces[0, 0] == pytest.approx([0.0, 0.09 - 0.018, 0.0, 44.0, -22.0, 440.0])
    assert forces[-1, 1, :3] == pytest.approx([0.2, -0.09 - 0.018, 0.0]), "after the step the foot pushes 0.2 m ahead"
    there = np.isfinite(forces).all(axis=2)
    assert there[:, 0].all()
    assert not np.isfinite(forces[25:75, 1]).any(), "from 0.5 s on the right foot is in the air"
    assert there[:25, 1].all()
    assert there[75:, 1].all()


def test_a_touch_without_load_acts_in_the_middle() -> None:
    placement = Placement.from_wxyz((1.0, 2.0, 3.0))
    assert centre_of_pressure_m(placement, corners_m(), np.zeros((4, 3))) == pytest.approx([1.0, 2.0, 3.0])


def test_the_centre_of_pressure_balances_the_moments_on_a_tilted_surface() -> None:
    rng = np.random.default_rng(3)
    placement = Placement.from_wxyz((0.3, -0.2, 0.5), (0.9, 0.2, -0.3, 0.1))
    local = np.column_stack([rng.normal(size=(4, 2)), rng.uniform(10.0, 50.0, 4)])
    forces = local @ placement.rotation.T
    point = centre_of_pressure_m(placement, corners_m(), forces)
    moment = np.cross(placement.act(corners_m()) - point, forces).sum(axis=0) @ placement.rotation
    assert moment[:2] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_arrays_are_read_without_pickle(tmp_path: Path) -> None:
    robot, motion = talos(), made_up_motion()
    write_arrays(tmp_path / "motion.npz", motion_arrays(robot, motion))
    with np.load(tmp_path / "motion.npz", allow_pickle=False) as read:
        n, nq, nv = 501, robot.model.nq, robot.model.nv
        shapes = {"time_s": (n,), "q": (n, nq), "v": (n, nv), "a": (n, nv), "tau": (n, nv - 6), "forces": (n, 2, 3)}
        assert {name: read[name].shape for name in shapes} == shapes
        assert read["joint_names"].tolist() == list(robot.joint_names)
        assert read["effectors"].tolist() == list(FEET)
        for name, truth in (("q", motion.q), ("v", motion.v), ("tau", motion.tau_nm)):
            np.testing.assert_array_equal(read[name], truth)
        for e, foot in enumerate(FEET):
            np.testing.assert_array_equal(read[f"forces_{foot}"], motion.forces_n[foot])
            np.testing.assert_allclose(read["forces"][:, e], motion.forces_n[foot].sum(axis=1))
            np.testing.assert_array_equal(read[f"points_{foot}"], corners_m())


def test_an_array_that_would_need_pickle_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="objects"):
        write_arrays(tmp_path / "x.npz", {"bad": np.array([{}])})
    assert list(tmp_path.iterdir()) == []
