"""Inverse kinematics of the leg against pinocchio's forward kinematics."""

import numpy as np
import pinocchio as pin
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stridelab.simulation.human.body_model import build_body
from stridelab.simulation.human.body_proportions import SIDES
from stridelab.simulation.human.foot_trajectories import FootPath
from stridelab.simulation.human.upper_body_motion import Posture
from stridelab.simulation.human.walker import Leg, leg_angles, upper_body_kgm

BODY = build_body(1.71, 60.0, "female")
ANGLE = st.floats(-0.5, 0.5)


@given(hip=st.tuples(ANGLE, ANGLE, ANGLE), knee=st.floats(0.05, 2.0), flexion=ANGLE, inversion=st.floats(-0.4, 0.4))
def test_angles_come_back_from_the_pose_of_the_foot(
    hip: tuple[float, float, float], knee: float, flexion: float, inversion: float
) -> None:
    q, data = BODY.neutral_pose(), BODY.model.createData()
    i = BODY.index
    q[i["pelvis"] : i["pelvis"] + 3] = (0.3, 0.1, -0.1)
    q[i["l_hip"] : i["l_hip"] + 3] = hip
    q[i["l_knee"]], q[i["l_ankle_flexion"]], q[i["l_ankle_inversion"]] = knee, flexion, inversion
    pin.forwardKinematics(BODY.model, data, q)
    hip_pose, foot, pelvis = (data.oMi[BODY.joint[name]] for name in ("l_thigh", "l_foot", "pelvis"))
    angles = leg_angles(
        BODY.proportions,
        hip_pose.translation[None],
        Rotation.from_matrix(pelvis.rotation[None]),
        foot.translation[None],
        Rotation.from_matrix(foot.rotation[None]),
    )
    np.testing.assert_allclose(angles.hip_rad[0], hip, atol=1e-9)
    np.testing.assert_allclose(
        [angles.knee_rad[0], angles.flexion_rad[0], angles.inversion_rad[0]], [knee, flexion, inversion], atol=1e-7
    )


def test_the_centre_of_mass_above_a_moved_pelvis_is_that_of_pinocchio() -> None:
    """Legs with their feet where they are, also one that is too short, and an upper body that only moves along."""
    rng, n = np.random.default_rng(0), 5
    q = 0.1 * rng.standard_normal((n, 34))
    posture = Posture(q, Rotation.from_euler("ZYX", q[:, 3:6]))
    paths = [FootPath(side, 0.1 * rng.standard_normal((n, 3)), 0.2 * rng.standard_normal(n)) for side in SIDES]
    legs = [Leg(BODY, posture, path) for path in paths]
    upper_kgm = upper_body_kgm(BODY, posture, legs, np.tile([0.0, 0.0, 0.8], (n, 1)))
    pelvis_m = np.array([0.0, 0.0, 0.7]) + 0.1 * rng.standard_normal((n, 3))
    pelvis_m[0, 2] = 1.5
    q[:, :3] = pelvis_m
    rises_m = [leg.set_angles(BODY, posture, q, pelvis_m) for leg in legs]
    assert min(rises_m) < -0.4
    com_m = [pin.centerOfMass(BODY.model, BODY.model.createData(), row) for row in q]
    moment_kgm = upper_kgm + sum(leg.moment_kgm(pelvis_m) for leg in legs)
    np.testing.assert_allclose(pelvis_m + moment_kgm / BODY.mass_kg, com_m, atol=1e-12)
