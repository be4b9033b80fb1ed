"""A step ahead of the toes is in the way of a shank that leans over it, and of nothing else."""

import coal
import numpy as np
import pinocchio as pin

from stridelab.reachability.learning.standing_sampler import StepClearance
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot


def leaning(robot: Robot, pitch_rad: float) -> tuple[pin.Model, pin.Data, StepClearance]:
    """The reference posture with both ankles bent, seen from the left sole, and a step 45 mm before its toes."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    q = robot.q_reference.copy()
    q[model.joints[model.getJointId("leg_left_5_joint")].idx_q] -= pitch_rad
    pin.framesForwardKinematics(model, data, q)
    joints = list(model.supports[model.frames[frames["left_foot"]].parentJoint])[2:]
    return model, data, StepClearance.for_effector(robot, "left_foot", frames["left_foot"], joints, 0.045, 0.6)


def shank_ahead_m(robot: Robot, data: pin.Data, step: StepClearance, height_m: float) -> float:
    """Foremost vertex of thigh and shank below ``height_m``, in the frame of the sole."""
    ahead = -np.inf
    for part in step.links:
        T = data.oMf[step.frame].inverse() * data.oMi[part.parentJoint] * part.placement
        assert isinstance(part.geometry, coal.ConvexBase)
        points = np.array([T.act(v) for v in part.geometry.points()])
        below = points[points[:, 2] < height_m]
        ahead = max(ahead, below[:, 0].max(initial=-np.inf))
    return ahead


def test_it_is_clear_exactly_where_no_vertex_is_over_the_step(talos: Robot) -> None:
    verdicts = []
    for pitch_rad in (0.0, 0.2, 0.4, 0.6, 0.8):
        _, data, step = leaning(talos, pitch_rad)
        for height_m in (0.05, 0.15, 0.2, 0.3):
            clear = step.is_clear(data, height_m)
            verdicts.append(clear)
            if shank_ahead_m(talos, data, step, height_m) > step.begins_m + 1e-6:
                assert not clear
            if shank_ahead_m(talos, data, step, height_m + 0.3) < step.begins_m - 1e-6:
                assert clear
    assert any(verdicts)
    assert not all(verdicts)


def test_a_step_begins_before_the_toes(talos: Robot) -> None:
    _, _, step = leaning(talos, 0.0)
    assert step.begins_m == 0.10 + 0.045
    assert {talos.model.names[part.parentJoint] for part in step.links} <= {f"leg_left_{k}_joint" for k in range(1, 5)}
