"""Inverse kinematics of the leg against pinocchio's forward kinematics."""

import numpy as np
import pinocchio as pin
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stridelab.simulation.human.body_model import build_body
from stridelab.simulation.human.walker import leg_angles

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
