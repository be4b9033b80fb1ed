"""The simulated subject as an articulated rigid body: 15 segments, 34 joint coordinates.

Masses and centres of mass are those of the Dumas segment table, placed in its own segment frames; moments of inertia
use its radii of gyration (Dumas et al. 2007, table 2; the products of inertia, a few percent, are neglected). The body
matches the table exactly: a segment model with this table gives its true centre of mass.

Joints: the pelvis floats (three translations, then yaw, pitch, roll); lumbar, cervical, shoulder and hip joints are
ball joints with angles (yaw, pitch, roll); elbow, wrist and knee are hinges about y; the ankle is a flexion hinge
followed by an inversion hinge. Positive pitch turns forward towards down: knees flex positively, elbows negatively.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.body import segment_tables
from stridelab.body.segment_tables import SegmentRow, SegmentTable
from stridelab.conventions import Points, Rotation, Vector3
from stridelab.recordings.recording import Sex
from stridelab.simulation.human.body_proportions import SIDES, Proportions, scale_proportions, side_prefix, side_sign

Configurations = Float[np.ndarray, "n 34"]
"""One configuration (root position, joint angles) per sample, or its rate."""
Configuration = Float[np.ndarray, "34"]

# Radii of gyration about the axes forwards, upwards, rightwards, per segment length (Dumas et al. 2007, table 2).
# The hand's and the foot's are rescaled to the lengths used here (wrist to knuckles; ankle to metatarsal heads).
_GYRATION: Final[Mapping[str, Mapping[str, tuple[float, float, float]]]] = {
    "female": {
        "head": (0.32, 0.27, 0.34),
        "torso": (0.29, 0.27, 0.29),
        "pelvis": (0.91, 1.00, 0.79),
        "upper_arm": (0.33, 0.17, 0.33),
        "forearm": (0.26, 0.14, 0.25),
        "hand": (0.63, 0.43, 0.58),
        "thigh": (0.31, 0.19, 0.32),
        "shank": (0.28, 0.10, 0.28),
        "foot": (0.17, 0.36, 0.35),
    },
    "male": {
        "head": (0.31, 0.25, 0.33),
        "torso": (0.27, 0.25, 0.28),
        "pelvis": (1.01, 1.06, 0.95),
        "upper_arm": (0.31, 0.14, 0.32),
        "forearm": (0.28, 0.11, 0.27),
        "hand": (0.61, 0.38, 0.56),
        "thigh": (0.29, 0.15, 0.30),
        "shank": (0.28, 0.10, 0.28),
        "foot": (0.17, 0.37, 0.36),
    },
}


@dataclass(frozen=True)
class SegmentFrame:
    """Frame of the segment table inside a link: origin, axes (forwards, upwards, rightwards) as columns, length."""

    origin_m: Vector3
    axes: Rotation
    length_m: float


@dataclass(frozen=True)
class AnthropometricBody:
    """Mechanical model, segment table and proportions of one simulated subject.

    ``model`` is a ``pinocchio.Model``; ``index`` maps a joint name to the position of its first angle in the
    configuration; ``joint`` maps a link name to the number of the joint that carries it.
    """

    model: Any
    proportions: Proportions
    table: SegmentTable
    index: Mapping[str, int]
    joint: Mapping[str, int]
    landmarks_m: Mapping[str, tuple[int, Vector3]]

    @property
    def mass_kg(self) -> float:
        """Sum over all links."""
        return float(pin.computeTotalMass(self.model))

    def neutral_pose(self) -> Configuration:
        """Upright reference pose, feet flat on z = 0, middle of the hips above the origin."""
        p = self.proportions
        q = np.zeros(34)
        q[2] = p.thigh_m + p.shank_m + p.ankle_height_m
        return q


def build_body(height_m: float, mass_kg: float, sex: Sex) -> AnthropometricBody:
    """Build a subject of stature ``height_m`` with the mass distribution of the Dumas table."""
    p = scale_proportions(height_m, sex)
    table = segment_tables.load_table("dumas2007", sex)
    model, index, joint = pin.Model(), {}, {}

    def add_joint(name: str, parent: int, kind: Any, place: Vector3) -> int:
        number = int(model.addJoint(parent, kind, pin.SE3(np.eye(3), place), name))
        index[name] = int(model.joints[number].idx_q)
        return number

    nowhere = np.zeros(3)
    floating = add_joint("position", 0, pin.JointModelTranslation(), nowhere)
    joint["pelvis"] = add_joint("pelvis", floating, pin.JointModelSphericalZYX(), nowhere)
    joint["torso"] = add_joint("lumbar", joint["pelvis"], pin.JointModelSphericalZYX(), p.lumbar)
    joint["head"] = add_joint("cervical", joint["torso"], pin.JointModelSphericalZYX(), np.array([0.0, 0.0, p.torso_m]))
    for side in SIDES:
        s = side_prefix(side)
        hip = np.array([0.0, side_sign(side) * p.hip_half_distance_m, 0.0])
        thigh = joint[f"{s}thigh"] = add_joint(f"{s}hip", joint["pelvis"], pin.JointModelSphericalZYX(), hip)
        shank = joint[f"{s}shank"] = add_joint(f"{s}knee", thigh, pin.JointModelRY(), _downward(p.thigh_m))
        flexion = add_joint(f"{s}ankle_flexion", shank, pin.JointModelRY(), _downward(p.shank_m))
        joint[f"{s}foot"] = add_joint(f"{s}ankle_inversion", flexion, pin.JointModelRX(), nowhere)
        arm = joint[f"{s}upper_arm"] = add_joint(
            f"{s}shoulder", joint["torso"], pin.JointModelSphericalZYX(), p.shoulder(side)
        )
        forearm = joint[f"{s}forearm"] = add_joint(f"{s}elbow", arm, pin.JointModelRY(), _downward(p.upper_arm_m))
        joint[f"{s}hand"] = add_joint(f"{s}wrist", forearm, pin.JointModelRY(), _downward(p.forearm_m))
    for name, frame in segment_frames(p).items():
        row = table.segments[name]
        radii = _GYRATION[sex][name.removeprefix("l_").removeprefix("r_")]
        inertia = _segment_inertia(frame, row, radii, mass_kg * row.mass_fraction)
        model.appendBodyToJoint(joint[name], inertia, pin.SE3.Identity())
    landmarks = {name: (joint[link], place) for name, link, place in p.landmarks()}
    return AnthropometricBody(model, p, table, index, joint, landmarks)


def segment_frames(p: Proportions) -> Mapping[str, SegmentFrame]:
    """Frames of the segment table (``models/segment_tables/dumas2007.toml``) in the links, keyed by segment."""
    upright, hip_to_lumbar = _axes_from_forward(np.array([1.0, 0.0, 0.0])), float(np.linalg.norm(p.lumbar))
    cervical = np.array([0.0, 0.0, p.torso_m])
    frames = {
        "pelvis": SegmentFrame(p.lumbar, upright, hip_to_lumbar),
        "torso": SegmentFrame(cervical, upright, p.torso_m),
        "head": SegmentFrame(np.zeros(3), upright, p.head_m),
    }
    for side in SIDES:
        # The palms look inwards, so that the table's rightward axis of forearm and hand points forward on the right.
        pronated = _axes_from_forward(np.array([0.0, -side_sign(side), 0.0]))
        for name, axes, length in (
            ("upper_arm", upright, p.upper_arm_m),
            ("forearm", pronated, p.forearm_m),
            ("hand", pronated, p.hand_m),
            ("thigh", upright, p.thigh_m),
            ("shank", upright, p.shank_m),
            ("foot", upright, p.foot_m),
        ):
            frames[f"{side_prefix(side)}{name}"] = SegmentFrame(np.zeros(3), axes, length)
    return frames


def landmark_tracks(body: AnthropometricBody, q: Configurations) -> Mapping[str, Points]:
    """World positions of all landmarks over the configurations ``q``."""
    data = body.model.createData()
    tracks = {name: np.empty((len(q), 3)) for name in body.landmarks_m}
    for k, configuration in enumerate(q):
        pin.forwardKinematics(body.model, data, configuration)
        for name, (number, place) in body.landmarks_m.items():
            tracks[name][k] = data.oMi[number].act(place)
    return tracks


def _downward(length_m: float) -> Vector3:
    return np.array([0.0, 0.0, -length_m])


def _axes_from_forward(forwards: Vector3) -> Rotation:
    up = np.array([0.0, 0.0, 1.0])
    return np.column_stack([forwards, up, np.cross(forwards, up)])


def _segment_inertia(frame: SegmentFrame, row: SegmentRow, radii: tuple[float, float, float], mass_kg: float) -> Any:
    lever = frame.origin_m + frame.length_m * frame.axes @ np.array(row.com)
    about_com = mass_kg * np.diag((frame.length_m * np.array(radii)) ** 2)
    return pin.Inertia(mass_kg, lever, frame.axes @ about_com @ frame.axes.T)
