"""Joint centres of the whole body from skin landmarks, region by region."""

from collections.abc import Mapping

from stridelab.body import lower_body, upper_body
from stridelab.body.anthropometry import Anthropometry
from stridelab.body.joints import Joints, Tracks


def joint_centres(p: Tracks, body: Anthropometry, widths_m: Mapping[str, float]) -> Joints:
    """Centres of all joints from the landmark tracks ``p`` (world frame, z up).

    ``widths_m`` holds measured joint widths (``l_knee``, ...), marker centre to marker centre. A centre that the file
    names itself (landmark ``l_hip_centre``, ...) is taken as it is. Raises ``NotEstimable`` without pelvis or knees.
    """
    joints = lower_body.pelvis(p, body)
    for s in "lr":
        joints |= lower_body.leg(p, s, joints, body, widths_m)
    joints |= upper_body.trunk(p, joints, body)
    for s in "lr":
        joints |= upper_body.arm(p, s, joints, body, widths_m)
    return joints | upper_body.head(p, joints, body)
