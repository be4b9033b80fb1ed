"""Segment lengths of the simulated body and positions of its joints, soles and landmarks in the reference pose.

The segment lengths are the mean lengths of the sample behind the segment table (McConville 1980 for men, Young 1983 for
women, as printed by Dumas et al. 2007 and Dumas and Wojtusch 2018), scaled by one factor so that the upright body has
exactly the given stature. Breadths of shoulder, hip and foot, and the ankle's height, are fractions of stature after
Drillis and Contini (1966), rounded. The lumbar, hip, cervical and shoulder centres satisfy the regressions of the
segment table, inverted: they compute joints from landmarks, this module computes landmarks from joints.

Link frames: x forward, y left, z up in the reference pose (upright, feet flat, arms hanging, palms inwards); the origin
of a link is its proximal joint (pelvis: middle of the hips).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.body.segment_tables import Anthropometry, SagittalOffset, load_anthropometry
from stridelab.conventions import Vector3
from stridelab.recordings.recording import Sex, Side

SIDES: Final[tuple[Side, ...]] = ("left", "right")

# Mean lengths in metres (Dumas et al. 2007, table 2); the others are in ``models/anthropometry.toml``.
_UPPER_ARM_M: Final = {"female": 0.243, "male": 0.271}
_THIGH_M: Final = {"female": 0.379, "male": 0.432}
_PELVIS_WIDTH_M: Final = {"female": 0.238, "male": 0.224}

# Fractions of stature (Drillis and Contini 1966; foot and shoulder rounded).
_ANKLE_HEIGHT: Final = 0.039
_FOOT_LENGTH: Final = 0.152
_FOOT_BREADTH: Final = 0.055
_HEEL_BACK: Final = 0.032
_SHOULDER_HALF_BREADTH: Final = 0.105
_SHOULDER_DROP: Final = 0.045
_THORAX_DEPTH: Final = 0.075
_FOOT_MARKER_HEIGHT: Final = 0.015

_NOTCH_SLOPE_RAD: Final = math.radians(-25.0)
"""Slope of the line from C7 to the jugular notch in the reference pose."""


def side_sign(side: Side) -> float:
    """+1 on the left, where y is positive; -1 on the right."""
    return 1.0 if side == "left" else -1.0


def side_prefix(side: Side) -> str:
    """Prefix of a sided name: ``l_`` or ``r_``."""
    return "l_" if side == "left" else "r_"


def sagittal_direction(angle_rad: float) -> Vector3:
    """Unit vector in the sagittal plane, ``angle_rad`` above the horizontal."""
    return np.array([math.cos(angle_rad), 0.0, math.sin(angle_rad)])


@dataclass(frozen=True)
class Proportions:
    """Lengths in metres of one body, and the joint-centre regressions of its segment table."""

    height_m: float
    sex: Sex
    regressions: Anthropometry
    torso_m: float
    head_m: float
    upper_arm_m: float
    forearm_m: float
    hand_m: float
    thigh_m: float
    shank_m: float
    foot_m: float
    pelvis_width_m: float

    @property
    def ankle_height_m(self) -> float:
        """Ankle joint above the sole of a flat foot."""
        return _ANKLE_HEIGHT * self.height_m

    @property
    def heel_m(self) -> float:
        """Back edge of the sole behind the ankle."""
        return _HEEL_BACK * self.height_m

    @property
    def toe_m(self) -> float:
        """Front edge of the sole ahead of the ankle."""
        return (_FOOT_LENGTH - _HEEL_BACK) * self.height_m

    @property
    def ball_m(self) -> float:
        """Metatarsal heads ahead of the ankle; the heads' markers lie ``foot_m`` from the ankle."""
        drop = self.ankle_height_m - _FOOT_MARKER_HEIGHT * self.height_m
        return math.sqrt(self.foot_m**2 - drop**2)

    @property
    def sole_breadth_m(self) -> float:
        """From the inner to the outer edge of the sole."""
        return _FOOT_BREADTH * self.height_m

    @property
    def hip_half_distance_m(self) -> float:
        """From the middle of the hips to either of them."""
        return float(self.regressions.hip[2]) * self.pelvis_width_m

    @property
    def lumbar(self) -> Vector3:
        """Lumbar joint in the pelvis link."""
        return self._from_asis(self.regressions.lumbar)

    @property
    def mid_asis(self) -> Vector3:
        """Middle of the anterior iliac spines in the pelvis link."""
        return self._from_asis(np.zeros(3))

    @property
    def c7(self) -> Vector3:
        """C7 in the torso link, from the inverted regression of the cervical joint."""
        return np.asarray([0.0, 0.0, self.torso_m] - self._trunk_offset(self.regressions.cervical))

    @property
    def jugular_notch(self) -> Vector3:
        """Suprasternal notch in the torso link, ahead of C7 and below it."""
        return np.asarray(self.c7 + _THORAX_DEPTH * self.height_m * sagittal_direction(_NOTCH_SLOPE_RAD))

    def shoulder(self, side: Side) -> Vector3:
        """Shoulder joint in the torso link."""
        across, drop = _SHOULDER_HALF_BREADTH * self.height_m, _SHOULDER_DROP * self.height_m
        return np.array([0.0, side_sign(side) * across, self.torso_m - drop])

    def acromion(self, side: Side) -> Vector3:
        """Acromion in the torso link, from the inverted regression of the shoulder joint."""
        return np.asarray(self.shoulder(side) - self._trunk_offset(self.regressions.shoulder))

    def landmarks(self) -> Iterator[tuple[str, str, Vector3]]:
        """``(landmark, link, position in the link)`` of every landmark of the marker set."""
        yield from self._trunk_landmarks()
        for side in SIDES:
            yield from self._limb_landmarks(side)

    def _trunk_landmarks(self) -> Iterator[tuple[str, str, Vector3]]:
        w, length, h = self.pelvis_width_m, self.torso_m, self.head_m
        for side in SIDES:
            p, y = side_prefix(side), side_sign(side)
            yield f"{p}asis", "pelvis", self.mid_asis + np.array([0.0, y * w / 2, 0.0])
            yield f"{p}psis", "pelvis", self.mid_asis + np.array([-0.65 * w, y * 0.18 * w, 0.0])
            yield f"{p}acromion", "torso", self.acromion(side)
            yield f"{p}head_front", "head", np.array([0.34 * h, y * 0.25 * h, 0.70 * h])
            yield f"{p}head_back", "head", np.array([-0.34 * h, y * 0.25 * h, 0.70 * h])
        yield "c7", "torso", self.c7
        yield "jugular_notch", "torso", self.jugular_notch
        yield "t8", "torso", np.array([-0.20 * length, 0.0, 0.62 * length])
        yield "t10", "torso", np.array([-0.21 * length, 0.0, 0.48 * length])
        yield "xiphoid", "torso", np.array([0.24 * length, 0.0, 0.55 * length])
        yield "head_top", "head", np.array([0.0, 0.0, h])

    def _limb_landmarks(self, side: Side) -> Iterator[tuple[str, str, Vector3]]:
        p, y, H = side_prefix(side), side_sign(side), self.height_m
        knee, ankle, elbow, wrist, knuckle = (-np.array([0.0, 0.0, length]) for length in self._limb_lengths())

        def lateral_pair(
            link: str, end: Vector3, half_breadth: float, outer: str, inner: str
        ) -> Iterator[tuple[str, str, Vector3]]:
            yield f"{p}{outer}", f"{p}{link}", end + np.array([0.0, y * half_breadth * H, 0.0])
            yield f"{p}{inner}", f"{p}{link}", end - np.array([0.0, y * half_breadth * H, 0.0])

        def sagittal_pair(
            link: str, end: Vector3, half_depth: float, front: str, back: str
        ) -> Iterator[tuple[str, str, Vector3]]:
            yield f"{p}{front}", f"{p}{link}", end + np.array([half_depth * H, 0.0, 0.0])
            yield f"{p}{back}", f"{p}{link}", end - np.array([half_depth * H, 0.0, 0.0])

        yield f"{p}trochanter", f"{p}thigh", np.array([0.0, y * 0.048 * H, -0.005 * H])
        yield from lateral_pair("thigh", knee, 0.030, "knee_lateral", "knee_medial")
        yield f"{p}fibula_head", f"{p}shank", np.array([-0.012 * H, y * 0.027 * H, -0.022 * H])
        yield f"{p}tibial_tuberosity", f"{p}shank", np.array([0.026 * H, 0.0, -0.030 * H])
        yield from lateral_pair("shank", ankle, 0.021, "ankle_lateral", "ankle_medial")
        height = _FOOT_MARKER_HEIGHT * H - self.ankle_height_m
        yield f"{p}heel", f"{p}foot", np.array([-self.heel_m, 0.0, height])
        yield f"{p}mt1", f"{p}foot", np.array([self.ball_m, -y * 0.024 * H, height])
        yield f"{p}mt2", f"{p}foot", np.array([self.ball_m + 0.006 * H, -y * 0.010 * H, height + 0.006 * H])
        yield f"{p}mt5", f"{p}foot", np.array([self.ball_m, y * 0.024 * H, height])
        yield from lateral_pair("upper_arm", elbow, 0.020, "elbow_lateral", "elbow_medial")
        yield from sagittal_pair("forearm", wrist, 0.016, "wrist_radial", "wrist_ulnar")
        yield from sagittal_pair("hand", knuckle, 0.020, "mc2", "mc5")

    def _limb_lengths(self) -> tuple[float, ...]:
        return self.thigh_m, self.shank_m, self.upper_arm_m, self.forearm_m, self.hand_m

    def _from_asis(self, forwards_upwards_rightwards: Vector3) -> Vector3:
        forwards, upwards, _ = forwards_upwards_rightwards - self.regressions.hip
        return np.asarray(self.pelvis_width_m * np.array([forwards, 0.0, upwards]))

    def _trunk_offset(self, rule: SagittalOffset) -> Vector3:
        angle = _NOTCH_SLOPE_RAD + math.radians(rule.angle_deg)
        return np.asarray(rule.scale * _THORAX_DEPTH * self.height_m * sagittal_direction(angle))


def scale_proportions(height_m: float, sex: Sex) -> Proportions:
    """Proportions of a body of stature ``height_m``."""
    regressions = load_anthropometry(sex)
    mean, width = regressions.length_m, _PELVIS_WIDTH_M[sex]
    hip_to_lumbar = width * float(regressions.lumbar[1] - regressions.hip[1])
    upright = mean["shank"] + _THIGH_M[sex] + hip_to_lumbar + mean["torso"] + mean["head"]
    scale = height_m * (1.0 - _ANKLE_HEIGHT) / upright
    return Proportions(
        height_m=height_m,
        sex=sex,
        regressions=regressions,
        torso_m=scale * mean["torso"],
        head_m=scale * mean["head"],
        upper_arm_m=scale * _UPPER_ARM_M[sex],
        forearm_m=scale * mean["forearm"],
        hand_m=scale * mean["hand"],
        thigh_m=scale * _THIGH_M[sex],
        shank_m=scale * mean["shank"],
        foot_m=scale * mean["foot"],
        pelvis_width_m=scale * width,
    )
