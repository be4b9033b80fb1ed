"""Effectors of a card: soles of the legs, hands at the ends of the arms."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Rotation, Vector3
from stridelab.robots.card import EffectorCard
from stridelab.robots.proposal.limbs import Chain, Limbs, not_humanoid
from stridelab.robots.proposal.soles import Sole, shape_points, sole_of

MIN_HALF_SIZE: Final = (0.04, 0.015)
"""Minimum half edges of a sole, over the length of the leg."""
MIN_FOOT_SHARE: Final = 0.3
"""Minimum share of the flat patch in the length of the foot; that of a wheel is smaller."""
NEAR_M: Final = 0.02
"""Distance of two joints that counts as the same place."""


def foot_soles(
    model: pin.Model, shapes: pin.GeometryModel, limbs: Limbs, q: Float[np.ndarray, "nq"]
) -> tuple[tuple[Sole, Sole], Limbs]:
    """The soles; a last joint whose body carries the smaller part of the sole is that of the toes and is locked."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    length_m = float(np.linalg.norm(data.oMi[limbs.legs[0][0]].translation - data.oMi[limbs.legs[0][-1]].translation))
    soles, legs = [], []
    for leg in limbs.legs:
        chain, sole = leg, _sole(model, data, shapes, leg, limbs.R_root, length_m)
        if len(leg) > 6:
            shorter = _sole(model, data, shapes, leg[:-1], limbs.R_root, length_m)
            area = 0.0 if sole is None else float(np.prod(sole.half_size_m))
            if shorter is not None and float(np.prod(shorter.half_size_m)) > 1.5 * area:
                chain, sole = leg[:-1], shorter
        reason = _sole_fault(sole, length_m)
        foot_m, all_m = (_lowest_m(data, shapes, leg[-1], limbs, others=others) for others in (False, True))
        if all_m < foot_m - 0.1 * length_m:
            raise not_humanoid(
                f"its lowest part is not the end of the limb that starts at {model.names[leg[0]]!r}: it stands on "
                "wheels or a fixed base, or its legs are not in the description",
                "effectors",
            )
        if sole is None or reason:
            where = f"the body behind {model.names[leg[-1]]!r}, the end of its longest pair of limbs,"
            raise not_humanoid(f"{where} {reason}", "effectors")
        soles.append(sole)
        legs.append(chain)
    return (soles[0], soles[1]), replace(limbs, legs=(legs[0], legs[1]))


def _lowest_m(data: pin.Data, shapes: pin.GeometryModel, foot: int, limbs: Limbs, *, others: bool) -> float:
    """Height of the lowest point of the foot, or of all shapes, along the up axis of the root link."""
    up = limbs.R_root[:, 2]
    heights = [np.inf]
    for part in shapes.geometryObjects:
        if others or part.parentJoint == foot:
            T = data.oMi[part.parentJoint]
            points = shape_points(part, T.rotation.T @ -up)
            heights += list((points @ T.rotation.T + T.translation) @ up)
    return float(min(heights))


def _sole(
    model: pin.Model, data: pin.Data, shapes: pin.GeometryModel, leg: Chain, R_root: Rotation, length_m: float
) -> Sole | None:
    own = [part for part in shapes.geometryObjects if part.parentJoint == leg[-1]]
    R = data.oMi[leg[-1]].rotation.T @ R_root
    return sole_of(own, R[:, 0], R[:, 2], length_m)


def _sole_fault(sole: Sole | None, leg_m: float) -> str:
    """Why a sole is none; empty if it is one."""
    if sole is None:
        return "has no flat patch below: it is a point foot, or it has no collision shape"
    x, y = sole.half_size_m
    size = f"{2e3 * x:.0f} by {2e3 * y:.0f} mm"
    if x < MIN_FOOT_SHARE * sole.foot_half_size_m[0]:
        foot = f"{2e3 * sole.foot_half_size_m[0]:.0f} mm"
        return f"has a flat patch of {size} below a body {foot} long: a wheel or an edge, not a sole"
    if x < MIN_HALF_SIZE[0] * leg_m or y < MIN_HALF_SIZE[1] * leg_m:
        return f"has a flat patch of {size} only: a point or line foot; soles are required"
    return ""


def effector_cards(
    model: pin.Model, shapes: pin.GeometryModel, limbs: Limbs, soles: Sequence[Sole], q: Float[np.ndarray, "nq"]
) -> dict[str, EffectorCard]:
    """Effectors by name at the rest posture ``q`` ``(nq,)`` of the full ``model``."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    effectors = {}
    for side, leg, sole in zip(("left", "right"), limbs.legs, soles, strict=True):
        frame, T_joint_frame = _last_link(model, leg[-1])
        x, y = (np.floor(990.0 * half) / 1000.0 for half in sole.half_size_m)
        effectors[f"{side}_foot"] = _effector(
            frame, T_joint_frame, sole.R, sole.centre_m, (float(x), float(y)), _ankle(model, data, leg, limbs.R_root)
        )
    for side, arm in zip(("left", "right"), limbs.arms, strict=False):
        frame, T_joint_frame = _last_link(model, arm[-1])
        T = data.oMi[arm[-1]]
        tip, out = _hand_tip(model, data, shapes, arm)
        z = -out
        x = T.rotation.T @ limbs.R_root[:, 0]
        if abs(x @ z) > 0.8:
            x = T.rotation.T @ limbs.R_root[:, 1]
        x = x - (x @ z) * z
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(z, x), z])
        effectors[f"{side}_hand"] = _effector(frame, T_joint_frame, R, tip, None, None)
    return effectors


def _effector(
    frame: str,
    T_joint_frame: pin.SE3,
    R_joint_contact: Rotation,
    position_m: Vector3,
    half: tuple[float, float] | None,
    ankle: tuple[str, str] | None,
) -> EffectorCard:
    x, y, z = (round(float(v), 5) for v in T_joint_frame.actInv(position_m))
    qx, qy, qz, qw = ScipyRotation.from_matrix(T_joint_frame.rotation.T @ R_joint_contact).as_quat(canonical=True)
    wxyz = float(qw), float(qx), float(qy), float(qz)
    return EffectorCard(frame, "point" if half is None else "surface", (x, y, z), wxyz, half, ankle)


def _ankle(model: pin.Model, data: pin.Data, leg: Chain, R_root: Rotation) -> tuple[str, str] | None:
    """Pitch and roll joint above a sole, if the last two joints turn about the lateral and the forward axis."""
    axes = {}
    for joint in leg[-2:]:
        axis = R_root.T @ data.oMi[joint].rotation @ np.array(model.joints[joint].createData().S).reshape(6, -1)[3:, 0]
        axes[int(np.argmax(np.abs(axis)))] = str(model.names[joint])
    return (axes[1], axes[0]) if axes.keys() == {0, 1} else None


def _hand_tip(model: pin.Model, data: pin.Data, shapes: pin.GeometryModel, arm: Chain) -> tuple[Vector3, Vector3]:
    """Contact point and outward direction of a hand, in the frame of its last joint.

    The direction is the axis of the joint's frame nearest to the middle of the hand's shapes or, without shapes, to the
    continuation of the forearm; the point is the middle of the far end of their bounding box.
    """
    last = data.oMi[arm[-1]]
    before = (data.oMi[joint].translation for joint in reversed(arm[:-1]))
    far = (at for at in before if np.linalg.norm(at - last.translation) > NEAR_M)
    out = last.rotation.T @ (last.translation - next(far, data.oMi[arm[0]].translation))
    carried = [part for part in shapes.geometryObjects if arm[-1] in model.supports[part.parentJoint]]
    points = np.zeros((0, 3))
    for part in carried:
        T = last.actInv(data.oMi[part.parentJoint])
        local = np.concatenate([shape_points(part, sign * (T.rotation.T @ out)) for sign in (-1.0, 1.0)])
        points = np.vstack([points, local @ T.rotation.T + T.translation])
    if not len(points):
        return np.zeros(3), out / max(float(np.linalg.norm(out)), 1e-9)
    low, high = points.min(axis=0), points.max(axis=0)
    tip = 0.5 * (low + high)
    if np.linalg.norm(tip) > NEAR_M:
        out = tip
    axis = int(np.argmax(np.abs(out)))
    ahead = bool(out[axis] > 0.0)
    tip[axis] = high[axis] if ahead else low[axis]
    return tip, (1.0 if ahead else -1.0) * np.eye(3)[axis]


def _last_link(model: pin.Model, joint: int) -> tuple[str, pin.SE3]:
    """The link that a joint carries directly, and its placement in the joint's frame."""
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.parentJoint == joint:
            return str(frame.name), frame.placement
    raise AssertionError(f"joint {joint} carries no link")


def carrying_link(model: pin.Model, joint: int) -> str:
    """The link to which a joint is attached."""
    frame = model.frames[model.getFrameId(model.names[joint], pin.FrameType.JOINT)]
    parent = model.frames[frame.parentFrame]
    while parent.type != pin.FrameType.BODY:
        parent = model.frames[parent.parentFrame]
    return str(parent.name)
