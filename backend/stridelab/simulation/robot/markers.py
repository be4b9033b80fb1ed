"""Markers on the links of a robot, and the segment table computed from its link masses.

The labels are those of the simulated subject (marker set ``isb-head``). The markers are placed where the segment model
expects bony landmarks: on both sides of knees, ankles, elbows and wrists, and around pelvis and trunk such that the
regressed joint centres coincide with those of the robot's ``anatomy``. A head belongs to the trunk; arms that a robot
lacks are marked on its trunk and have no mass.

The links are lumped into the segments of the model (``RobotAnatomy.segment_of``). A row of the table is the CoM of such
a lump in its segment's frame while standing; in a walk the lumps are not quite rigid.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.body.joint_centres import joint_centres
from stridelab.body.segment_model import POSSIBLE_STATURE, SHANK_SHARE, segment_frames
from stridelab.body.segment_tables import SegmentTable, load_anthropometry, parse_table
from stridelab.conventions import Configurations, Points, Vector3
from stridelab.recordings.recording import Side
from stridelab.robots.robot import Robot
from stridelab.simulation.human.body_proportions import SIDES, sagittal_direction, side_prefix, side_sign
from stridelab.simulation.human.marker_layout import LABELS
from stridelab.simulation.robot.anatomy import RobotAnatomy
from stridelab.simulation.robot.forward_kinematics import LinkPoses, link_masses, link_poses

_THORAX_M: Final = 0.06
_NOTCH_SLOPE_RAD: Final = math.radians(-25.0)
_NECK_M: Final = 0.06
"""Cervical joint above the shoulders, for a robot of the size of TALOS."""
_TRUNK_PER_LEG: Final = 0.6
"""Height of the shoulders above the hips over the length of a leg, for a robot without arms."""
_ON_AXIS_M: Final = 0.005
Place = tuple[str, int, Vector3]
"""A landmark, the joint of its link, and its place in the world in the reference posture."""


def marker_places(robot: Robot) -> Mapping[str, tuple[int, Vector3]]:
    """Map from landmark to ``(joint of the link, position in the link)``. Raises as ``RobotAnatomy.of_robot``."""
    anatomy = RobotAnatomy.of_robot(robot)
    places = [*_pelvis_markers(anatomy), *_trunk_markers(anatomy)]
    for side in SIDES:
        places += [
            *_leg_markers(anatomy, side),
            *(_arm_markers(anatomy, side) if anatomy.arm[side] else _absent_arm_markers(anatomy, side)),
        ]
    return {name: (joint, anatomy.in_link(joint, place)) for name, joint, place in places}


def marker_tracks(robot: Robot, q: Configurations) -> Mapping[str, Points]:
    """Tracks of the markers by label over the configurations ``q``."""
    tracks = _landmark_tracks(robot, link_poses(robot.model, q))
    return {LABELS[name]: track for name, track in tracks.items()}


def segment_table(robot: Robot, q: Float[np.ndarray, "nq"]) -> SegmentTable:
    """Segment table from the link masses, lumped into segments at the standing configuration ``q``."""
    poses, masses = link_poses(robot.model, q[None]), link_masses(robot.model)
    tracks, body = _landmark_tracks(robot, poses), load_anthropometry(None)
    frames = segment_frames(tracks, joint_centres(tracks, body, {}), body)
    links = poses.coms_m(masses)[0]
    lumps: dict[str, list[int]] = {}
    for k, segment in enumerate(RobotAnatomy.of_robot(robot).segment_of()):
        lumps.setdefault(segment, []).append(k)
    rows = {}
    for name, members in lumps.items():
        m, frame = masses.mass_kg[members], frames[name]
        if not m.sum() > 0.0:
            continue
        away = (m @ links[members] / m.sum() - frame.origin_m[0]) / frame.length_m
        com = [float(away @ axis[0]) for axis in (frame.X, frame.Y, frame.Z)]
        rows[name] = {"mass_fraction": float(m.sum() / masses.mass_kg.sum()), "com": com}
    return parse_table({"name": robot.name, "segments": rows})


def stature_m(robot: Robot) -> float | None:
    """Height of the robot on straight legs; None where its legs are not those of a person of that height."""
    anatomy = RobotAnatomy.of_robot(robot)
    hips = [anatomy.centre_m(anatomy.leg[side][:3]) for side in SIDES]
    ankles = [anatomy.centre_m(anatomy.leg[side][4:]) for side in SIDES]
    height_m = anatomy.top_m + anatomy.leg_m - float(np.mean(hips, axis=0)[2] - np.mean(ankles, axis=0)[2])
    knees = [_knee_m(anatomy, side) for side in SIDES]
    shank_m = float(np.linalg.norm(np.array(knees) - ankles, axis=1).mean())
    low, high = POSSIBLE_STATURE
    return round(height_m, 2) if low < height_m * SHANK_SHARE / shank_m < high else None


def _landmark_tracks(robot: Robot, poses: LinkPoses) -> dict[str, Points]:
    tracks = {}
    for name, (joint, place) in marker_places(robot).items():
        link = joint - 1
        tracks[name] = np.asarray(poses.position_m[:, link] + poses.rotation[:, link] @ place)
    return tracks


def _pelvis_markers(anatomy: RobotAnatomy) -> Iterator[Place]:
    """Spines whose regression gives the hips, as far apart as these."""
    body = load_anthropometry(None)
    left, right = (anatomy.centre_m(anatomy.leg[side][:3]) for side in SIDES)
    w = float((left[1] - right[1]) / 2.0 / body.hip[2])
    hips = (left + right) / 2.0
    middle = hips - w * np.array([body.hip[0], 0.0, body.hip[1]])
    for side in SIDES:
        s, y = side_prefix(side), side_sign(side)
        yield f"{s}asis", 1, middle + np.array([0.0, y * w / 2, 0.0])
        yield f"{s}psis", 1, middle + np.array([-0.65 * w, y * 0.18 * w, 0.0])


def _trunk_markers(anatomy: RobotAnatomy) -> Iterator[Place]:
    """Neck above the middle of the shoulders, and a head."""
    body, size = load_anthropometry(None), anatomy.size
    cervical = np.mean([_shoulder_m(anatomy, side) for side in SIDES], axis=0) + np.array([0.0, 0.0, size * _NECK_M])
    c7 = cervical - _thorax_offset(size, body.cervical.angle_deg, body.cervical.scale)
    yield "c7", anatomy.trunk, c7
    yield "jugular_notch", anatomy.trunk, c7 + size * _THORAX_M * sagittal_direction(_NOTCH_SLOPE_RAD)
    for side in SIDES:
        s, y = side_prefix(side), side_sign(side)
        yield f"{s}head_front", anatomy.trunk, cervical + size * np.array([0.08, y * 0.06, 0.17])
        yield f"{s}head_back", anatomy.trunk, cervical + size * np.array([-0.08, y * 0.06, 0.17])


def _leg_markers(anatomy: RobotAnatomy, side: Side) -> Iterator[Place]:
    """Both sides of knee and ankle, and the sole's heel and ball, 2 cm above the ground for the size of TALOS."""
    s, out, size = side_prefix(side), np.array([0.0, side_sign(side), 0.0]), anatomy.size
    thigh, shank, foot = anatomy.leg[side][2], anatomy.leg[side][3], anatomy.leg[side][5]
    yield from _marker_pair(f"{s}knee_lateral", f"{s}knee_medial", thigh, _knee_m(anatomy, side), 0.06 * size * out)
    ankle = anatomy.centre_m(anatomy.leg[side][4:])
    yield from _marker_pair(f"{s}ankle_lateral", f"{s}ankle_medial", shank, ankle, 0.05 * size * out)
    x_m, y_m = anatomy.robot.effectors[f"{side}_foot"].contact_half_size_m or (0.1, 0.05)
    for name, along, across in (("heel", -0.9, 0.0), ("mt1", 0.9, -0.8), ("mt2", 0.95, -0.3), ("mt5", 0.9, 0.8)):
        offset = np.array([along * x_m, side_sign(side) * across * y_m, 0.02 * size])
        yield f"{s}{name}", foot, anatomy.effector_m(f"{side}_foot", offset)


def _arm_markers(anatomy: RobotAnatomy, side: Side) -> Iterator[Place]:
    """Shoulder, elbow (the fourth joint), wrist (the sixth, else the hand) and knuckles."""
    body, size, chain = load_anthropometry(None), anatomy.size, anatomy.arm[side]
    s, shoulder, hand = side_prefix(side), _shoulder_m(anatomy, side), anatomy.effector_m(f"{side}_hand", np.zeros(3))
    outwards = np.array([0.0, side_sign(side), 0.0])
    away = np.cross(anatomy.joint_axis(chain[0]), shoulder - anatomy.centre_m(chain[:1]))
    carrier = anatomy.trunk if float(np.linalg.norm(away)) < _ON_AXIS_M else chain[0]
    acromion = shoulder - _thorax_offset(size, body.shoulder.angle_deg, body.shoulder.scale)
    yield f"{s}acromion", carrier, acromion
    if len(chain) > 3:
        upper, fore = chain[2], chain[min(4, len(chain) - 1)]
        elbow, axis = anatomy.nearest_m(chain[3], shoulder, hand), anatomy.joint_axis(chain[3])
    else:
        upper = fore = chain[-1]
        elbow, axis = (shoulder + hand) / 2.0, outwards
    axis = axis if axis @ outwards >= 0.0 else -axis
    yield from _marker_pair(f"{s}elbow_lateral", f"{s}elbow_medial", upper, elbow, 0.05 * size * axis)
    wrist = anatomy.nearest_m(chain[5], elbow, hand) if len(chain) > 5 else hand
    along = (wrist - elbow) / max(float(np.linalg.norm(wrist - elbow)), 1e-9)
    ahead = -side_sign(side) * np.cross(axis, along)
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    yield from _marker_pair(f"{s}wrist_radial", f"{s}wrist_ulnar", fore, wrist, 0.04 * size * ahead)
    yield from _marker_pair(f"{s}mc2", f"{s}mc5", chain[-1], wrist + 0.10 * size * along, 0.04 * size * ahead)


def _absent_arm_markers(anatomy: RobotAnatomy, side: Side) -> Iterator[Place]:
    """An arm that hangs from the trunk and has no mass."""
    body, size, shoulder = load_anthropometry(None), anatomy.size, _shoulder_m(anatomy, side)
    s, out = side_prefix(side), np.array([0.0, side_sign(side), 0.0])
    ahead, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -size])
    acromion = shoulder - _thorax_offset(size, body.shoulder.angle_deg, body.shoulder.scale)
    yield f"{s}acromion", anatomy.trunk, acromion
    for first, second, below, offset in (
        ("elbow_lateral", "elbow_medial", 0.25, 0.05 * out),
        ("wrist_radial", "wrist_ulnar", 0.50, 0.04 * ahead),
        ("mc2", "mc5", 0.60, 0.04 * ahead),
    ):
        yield from _marker_pair(f"{s}{first}", f"{s}{second}", anatomy.trunk, shoulder + below * down, size * offset)


def _marker_pair(outer: str, inner: str, joint: int, centre: Vector3, across: Vector3) -> Iterator[Place]:
    yield outer, joint, centre + across
    yield inner, joint, centre - across


def _knee_m(anatomy: RobotAnatomy, side: Side) -> Vector3:
    chain = anatomy.leg[side]
    return anatomy.nearest_m(chain[3], anatomy.centre_m(chain[:3]), anatomy.centre_m(chain[4:]))


def _shoulder_m(anatomy: RobotAnatomy, side: Side) -> Vector3:
    """Where the second and the third axis of an arm meet; without arms, above the hips."""
    chain = anatomy.arm[side]
    if chain:
        return anatomy.centre_m(chain[1:3] or chain)
    hip = anatomy.centre_m(anatomy.leg[side][:3])
    return np.asarray(hip + np.array([0.0, 0.5 * hip[1], _TRUNK_PER_LEG * anatomy.leg_m]))


def _thorax_offset(size: float, angle_deg: float, scale: float) -> Vector3:
    """Offset of a regressed joint centre from its landmark on the trunk."""
    return np.asarray(scale * size * _THORAX_M * sagittal_direction(_NOTCH_SLOPE_RAD + math.radians(angle_deg)))
