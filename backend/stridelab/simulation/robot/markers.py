"""Markers on the links of TALOS, and the segment table computed from its link masses.

The labels are those of the simulated subject (marker set ``isb-head``). The markers are placed where the segment model
expects bony landmarks: on both sides of knees, ankles, elbows and wrists, and around pelvis and trunk such that the
regressed joint centres coincide with the robot's. The head is locked and belongs to the trunk.

The links are lumped into the segments of the model: hip yaw with the pelvis, hip roll with the thigh, both ankle links
with the foot, the three shoulder links with the upper arm. A row of the table is the CoM of such a lump in its
segment's frame while standing; in a walk the lumps are not quite rigid, with an error below a millimetre.
"""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.body.joint_centres import joint_centres
from stridelab.body.segment_model import segment_frames
from stridelab.body.segment_tables import SegmentTable, load_anthropometry, parse_table
from stridelab.conventions import Configurations, Points, Vector3
from stridelab.robots.robot import Robot
from stridelab.simulation.human.body_proportions import SIDES, sagittal_direction, side_prefix, side_sign
from stridelab.simulation.human.marker_layout import LABELS
from stridelab.simulation.robot.forward_kinematics import LinkPoses, link_masses, link_poses

HEIGHT_M: Final = 1.75
"""Stature of TALOS according to its manufacturer."""
_SEGMENT: Final[Mapping[str, str]] = {
    "leg_1": "pelvis",
    "leg_2": "thigh",
    "leg_3": "thigh",
    "leg_4": "shank",
    "leg_5": "foot",
    "leg_6": "foot",
    **{f"arm_{k}": "upper_arm" for k in (1, 2, 3)},
    **{f"arm_{k}": "forearm" for k in (4, 5)},
    **{f"arm_{k}": "hand" for k in (6, 7)},
}
_THORAX_M: Final = 0.06
_NOTCH_SLOPE_RAD: Final = math.radians(-25.0)
_CERVICAL: Final = np.array([0.0, 0.0, 0.33])
"""Upper end of the trunk in the frame of its last link."""


def marker_places(robot: Robot) -> Mapping[str, tuple[str, Vector3]]:
    """Map from landmark to ``(joint of the link, position in the link)``."""
    places: dict[str, tuple[str, Vector3]] = {}
    body, model = load_anthropometry(None), robot.model

    def joint_origin(joint: str) -> Vector3:
        """Position of a joint in its parent link."""
        return np.array(model.jointPlacements[model.getJointId(joint)].translation)

    hip = joint_origin("leg_left_1_joint")
    w = float(hip[1] / body.hip[2])
    middle = np.array([hip[0] - w * body.hip[0], 0.0, hip[2] - w * body.hip[1]])
    c7 = _CERVICAL - _thorax_offset(body.cervical.angle_deg, body.cervical.scale)
    for name, place in (
        ("c7", c7),
        ("jugular_notch", c7 + _THORAX_M * sagittal_direction(_NOTCH_SLOPE_RAD)),
    ):
        places[name] = ("torso_2_joint", place)
    for side in SIDES:
        s, y = side_prefix(side), side_sign(side)

        def put_marker(landmark: str, joint: str, place: Vector3, s: str = s, side: str = side) -> None:
            places[f"{s}{landmark}"] = (joint.replace("*", side), place)

        def put_pair(end: str, link: str, across: Vector3, outer: str, inner: str, side: str = side) -> None:
            centre = joint_origin(end.replace("*", side))
            put_marker(outer, link, centre + across)
            put_marker(inner, link, centre - across)

        put_marker("asis", "root_joint", middle + np.array([0.0, y * w / 2, 0.0]))
        put_marker("psis", "root_joint", middle + np.array([-0.65 * w, y * 0.18 * w, 0.0]))
        put_marker("head_front", "torso_2_joint", np.array([0.08, y * 0.06, 0.50]))
        put_marker("head_back", "torso_2_joint", np.array([-0.08, y * 0.06, 0.50]))
        shoulder = joint_origin(f"arm_{side}_2_joint")
        put_marker("acromion", "arm_*_1_joint", shoulder - _thorax_offset(body.shoulder.angle_deg, body.shoulder.scale))
        outwards = np.array([0.0, y, 0.0])
        put_pair("leg_*_4_joint", "leg_*_3_joint", 0.06 * outwards, "knee_lateral", "knee_medial")
        put_pair("leg_*_5_joint", "leg_*_4_joint", 0.05 * outwards, "ankle_lateral", "ankle_medial")
        put_pair("arm_*_4_joint", "arm_*_3_joint", 0.05 * outwards, "elbow_lateral", "elbow_medial")
        forwards = np.array([0.04, 0.0, 0.0])
        put_marker("wrist_radial", "arm_*_5_joint", forwards)
        put_marker("wrist_ulnar", "arm_*_5_joint", -forwards)
        put_marker("mc2", "arm_*_7_joint", np.array([0.04, 0.0, -0.10]))
        put_marker("mc5", "arm_*_7_joint", np.array([-0.04, 0.0, -0.10]))
        for name, x, across_m in (
            ("heel", -0.10, 0.0),
            ("mt1", 0.09, -0.05),
            ("mt2", 0.10, -0.02),
            ("mt5", 0.09, 0.05),
        ):
            put_marker(name, "leg_*_6_joint", np.array([x, y * across_m, -0.087]))
    return places


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
    for k, joint in enumerate(("root_joint", *robot.joint_names)):
        lumps.setdefault(_segment_of_joint(joint), []).append(k)
    rows = {}
    for name, members in lumps.items():
        m, frame = masses.mass_kg[members], frames[name]
        away = (m @ links[members] / m.sum() - frame.origin_m[0]) / frame.length_m
        com = [float(away @ axis[0]) for axis in (frame.X, frame.Y, frame.Z)]
        rows[name] = {"mass_fraction": float(m.sum() / masses.mass_kg.sum()), "com": com}
    return parse_table({"name": robot.name, "segments": rows})


def _segment_of_joint(joint: str) -> str:
    part, _, rest = joint.partition("_")
    if part == "root":
        return "pelvis"
    if part == "torso":
        return "torso"
    side, number, _ = rest.split("_")
    segment = _SEGMENT[f"{part}_{number}"]
    return segment if segment == "pelvis" else f"{side[0]}_{segment}"


def _landmark_tracks(robot: Robot, poses: LinkPoses) -> dict[str, Points]:
    tracks = {}
    for name, (joint, place) in marker_places(robot).items():
        link = robot.model.getJointId(joint) - 1
        tracks[name] = np.asarray(poses.position_m[:, link] + poses.rotation[:, link] @ place)
    return tracks


def _thorax_offset(angle_deg: float, scale: float) -> Vector3:
    """Offset of a regressed joint centre from its landmark on the trunk."""
    return np.asarray(scale * _THORAX_M * sagittal_direction(_NOTCH_SLOPE_RAD + math.radians(angle_deg)))
