"""Simulated human walking: whole-body motion with exact centre of mass, momentum and contact wrench.

1. footsteps and their timing                                  (``gait_plan``)
2. foot trajectories, posture of the upper body                (``foot_trajectories``, ``upper_body_motion``)
3. load of the feet and zero-moment point                      (``load_transfer``)
4. centre of mass for this zero-moment point, whole-body inverse kinematics (``load_transfer``, ``leg_ik``); repeated,
   because the angular momentum changes the zero-moment point
5. joint angles as quintic splines of time: these define the motion, and everything below is exact for it
6. wrench by Newton and Euler: f = m (c'' - g), moment at the origin = c x f + dL/dt, (4.2a), (4.2b), shared by the feet

Closed-form inverse kinematics of the legs, all samples at once.

Hip ball joint, knee hinge about y, ankle flexion about y then inversion about x, all axes of a joint meeting in a
point: six angles for the six coordinates of the foot. With ``r`` the vector from ankle to hip in the foot's frame,

    inversion  phi2 = atan2(r_y, r_z)                       (the shank's plane contains the hip)
    knee       cos(theta) = (|r|^2 - L_t^2 - L_s^2) / (2 L_t L_s)
    flexion    phi1 = angle of (-L_t sin theta, L_s + L_t cos theta) minus that of (r_x, sqrt(r_y^2 + r_z^2))

and the rotation of the hip is ``R_pelvis^T R_foot R_x(-phi2) R_y(-(phi1 + theta))``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin
from scipy.interpolate import BSpline, make_interp_spline
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from stridelab.conventions import GRAVITY_M_S2, Points, Rotations, Series, Vector3
from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.recording import Sex, Side
from stridelab.simulation.ground_truth import TrueMotion, true_motion
from stridelab.simulation.human.body_model import AnthropometricBody, Configurations, build_body
from stridelab.simulation.human.body_proportions import SIDES, Proportions, side_prefix, side_sign
from stridelab.simulation.human.foot_trajectories import FootPath, foot_path
from stridelab.simulation.human.gait_plan import GaitPlan, plan_gait
from stridelab.simulation.human.load_sharing import FootWrench, share_wrench
from stridelab.simulation.human.load_transfer import (
    LoadPlan,
    com_over_zmp,
    minimum_jerk,
    plan_load,
    steep_transfer,
)
from stridelab.simulation.human.upper_body_motion import Posture, StrideClock, prescribe_posture, stride_clock

PLAN_RATE_HZ: Final = 200.0
TRUTH_RATE_HZ: Final = 1000.0
MARGIN_S: Final = 0.1
"""Simulated time before and after the recording, for a force with latency."""
_PASSES: Final = 6
_TRACKED_HZ: Final = 25.0
_FROUDE: Final = 0.5
"""Froude number v^2 / (g leg length) above which humans run (Alexander 1989)."""
_LEG: Final = 0.53
"""Leg length over stature."""
_REACH: Final = 0.99
"""Largest leg length over thigh plus shank, for a knee flexion of at least 20 degrees."""
_STANCE_WIDTH: Final = 0.07
"""Distance of the ankles over stature."""


@dataclass(frozen=True)
class Walk:
    """Motion of one subject. ``posture`` gives the 34 joint coordinates at a time of the recording (0 = first frame).

    ``truth`` and ``feet`` are sampled at ``TRUTH_RATE_HZ`` from ``-MARGIN_S`` to ``duration_s + MARGIN_S``.
    """

    body: AnthropometricBody
    mass_kg: float
    plan: GaitPlan
    duration_s: float
    posture: BSpline
    truth: TrueMotion
    feet: Mapping[Side, FootWrench]

    @property
    def force_n(self) -> Points:
        """Contact force on the body."""
        return self.truth.force_n

    @property
    def moment_nm(self) -> Points:
        """Contact moment at the world origin."""
        return self.truth.moment_nm


@dataclass(frozen=True)
class HumanWalker:
    """A subject and a walking task; ``walk`` simulates it.

    ``from_rest``: the recording shows rest, walk, rest; otherwise the subject is already walking when it starts.
    ``steep_load``: a foot is loaded at once at its strike (``steep_transfer``), not smoothly.
    """

    height_m: float = 1.71
    mass_kg: float = 60.0
    sex: Sex = "female"
    speed_m_s: float = 1.2
    duration_s: float = 6.0
    seed: int = 0
    from_rest: bool = False
    steep_load: bool = False

    def walk(self) -> Walk:
        """Simulate the walk. Raises ``InvalidInput`` (``walker-out-of-range``) for parameters out of range."""
        self._check_ranges()
        rngs = [np.random.default_rng([self.seed, part]) for part in range(3)]
        body = build_body(self.height_m, self.mass_kg, self.sex)
        plan = plan_gait(
            self.height_m,
            self.speed_m_s,
            self.duration_s,
            from_rest=self.from_rest,
            stance_width_m=_STANCE_WIDTH * self.height_m,
            rng=rngs[0],
        )
        before, after = plan.record_from_s - MARGIN_S, plan.record_from_s + self.duration_s + MARGIN_S
        start_s, end_s = min(0.0, before) - 0.5, max(plan.end_s, after) + 0.5
        t = np.arange(start_s, end_s, 1.0 / PLAN_RATE_HZ)
        load = plan_load(plan, body.proportions, t, rngs[1], steep_transfer if self.steep_load else minimum_jerk)
        paths = {side: foot_path(plan, side, body.proportions, t) for side in SIDES}
        clock = stride_clock(plan, t)
        q = _whole_body(body, plan, clock, load, paths, prescribe_posture(body, plan, clock, rngs[2]))
        posture = make_interp_spline(t - plan.record_from_s, q, k=5)
        n = round((self.duration_s + 2 * MARGIN_S) * TRUTH_RATE_HZ) + 1
        truth = true_motion(body, posture, np.arange(n) / TRUTH_RATE_HZ - MARGIN_S)
        return Walk(
            body, self.mass_kg, plan, self.duration_s, posture, truth, share_wrench(truth, load, t - plan.record_from_s)
        )

    def _check_ranges(self) -> None:
        limits = {
            "height_m": (self.height_m, 1.0, 2.3),
            "mass_kg": (self.mass_kg, 15.0, 250.0),
            "speed_m_s": (self.speed_m_s, 0.0, 2.0),
            "duration_s": (self.duration_s, 1.0, 120.0),
        }
        for name, (value, low, high) in limits.items():
            if not low <= value <= high:
                raise _out_of_range(name, f"{name} must lie between {low:g} and {high:g}, not {value:g}.")
        if self.seed < 0:
            raise _out_of_range("seed", "seed must not be negative.")
        fastest = math.sqrt(_FROUDE * GRAVITY_M_S2 * _LEG * self.height_m)
        if self.speed_m_s > fastest:
            message = f"A person {self.height_m:g} m tall runs rather than walks at more than {fastest:.2f} m/s."
            raise _out_of_range("speed_m_s", message)


def _out_of_range(name: str, message: str) -> InvalidInput:
    return InvalidInput("walker-out-of-range", message, [Fault(name, message)])


def _whole_body(
    body: AnthropometricBody,
    plan: GaitPlan,
    clock: StrideClock,
    load: LoadPlan,
    paths: Mapping[Side, FootPath],
    posture: Posture,
) -> Configurations:
    """Joint angles at the instants of the plan that realise the planned zero-moment point."""
    dt, q = 1.0 / PLAN_RATE_HZ, posture.q.copy()
    leg_m = body.proportions.thigh_m + body.proportions.shank_m
    bob_m = plan.step_length_m**2 / (32.0 * leg_m) * clock.vigour * -np.cos(2.0 * clock.phi_double)
    height_m = 0.55 * body.proportions.height_m + bob_m
    momentum_rate = np.zeros((len(q), 3))
    pelvis_m = np.column_stack([load.zmp_m, np.full(len(q), 0.5 * body.proportions.height_m)])
    legs = [Leg(body, posture, path) for path in paths.values()]
    upper_kgm = upper_body_kgm(body, posture, legs, pelvis_m)
    for _ in range(_PASSES):
        com_m = com_over_zmp(load.zmp_m, height_m, momentum_rate, body.mass_kg, dt)
        for _ in range(25):
            q[:, :3] = pelvis_m
            error = com_m - pelvis_m - (upper_kgm + sum(leg.moment_kgm(pelvis_m) for leg in legs)) / body.mass_kg
            pelvis_m = pelvis_m + 1.2 * error
            if np.abs(error).max() < 1e-9:
                break
        slack_m = min(leg.set_angles(body, posture, q, q[:, :3]) for leg in legs)
        momentum_rate = _momentum_rate(body, q, dt)
        height_m = height_m + slack_m
    return q


class Leg:
    """A leg between a moving pelvis, whose orientation is given, and its foot: what stays while the pelvis moves.

    ``thigh_kgm`` and ``shank_kgm`` are mass times place, in the frames of thigh and shank and from the hip, of all that
    turns with them: their own masses, and at their ends those of the links below.
    """

    def __init__(self, body: AnthropometricBody, posture: Posture, path: FootPath) -> None:
        self.p, self.path, self.side = body.proportions, path, side_prefix(path.side)
        thigh, shank, foot = (body.model.inertias[body.joint[self.side + link]] for link in ("thigh", "shank", "foot"))
        self.mass_kg = float(thigh.mass + shank.mass + foot.mass)
        self.thigh_kgm = thigh.mass * thigh.lever - [0.0, 0.0, (shank.mass + foot.mass) * self.p.thigh_m]
        self.shank_kgm = shank.mass * shank.lever - [0.0, 0.0, foot.mass * self.p.shank_m]
        hip = np.array([0.0, side_sign(path.side) * self.p.hip_half_distance_m, 0.0])
        self.pelvis_to_hip_m = posture.pelvis.apply(hip)
        self.R_foot = path.foot.as_matrix()
        self.foot_kgm = self.R_foot @ (foot.mass * foot.lever)

    def moment_kgm(self, pelvis_m: Points) -> Points:
        """Mass of the leg times the place of its centre from the pelvis."""
        hip_in_foot = np.einsum("nji,nj->ni", self.R_foot, pelvis_m + self.pelvis_to_hip_m - self.path.ankle_m)
        inversion, knee, flexion = _bend_angles(self.p, hip_in_foot)
        x, y, z = (
            one + other
            for one, other in zip(
                _unbent(self.thigh_kgm, flexion + knee), _unbent(self.shank_kgm, flexion), strict=True
            )
        )
        c, s = np.cos(inversion), np.sin(inversion)
        below_hip = np.einsum("nij,nj->ni", self.R_foot, np.column_stack([x, c * y + s * z, c * z - s * y]))
        return np.asarray(self.mass_kg * self.pelvis_to_hip_m + below_hip + self.foot_kgm)

    def set_angles(self, body: AnthropometricBody, posture: Posture, q: Configurations, pelvis_m: Points) -> float:
        """Write the angles into ``q``; return how far the pelvis can rise before the leg is too short."""
        hip_m = pelvis_m + self.pelvis_to_hip_m
        angles = leg_angles(self.p, hip_m, posture.pelvis, self.path.ankle_m, self.path.foot)
        q[:, body.index[f"{self.side}hip"] : body.index[f"{self.side}hip"] + 3] = angles.hip_rad
        q[:, body.index[f"{self.side}knee"]] = angles.knee_rad
        q[:, body.index[f"{self.side}ankle_flexion"]] = angles.flexion_rad
        q[:, body.index[f"{self.side}ankle_inversion"]] = angles.inversion_rad
        away = hip_m - self.path.ankle_m
        longest = _REACH * (self.p.thigh_m + self.p.shank_m)
        return float(np.min(np.sqrt(np.maximum(longest**2 - np.sum(away[:, :2] ** 2, axis=1), 0.0)) - away[:, 2]))


def _unbent(place: Vector3, angle_rad: Series) -> tuple[Series, Series, Series]:
    """``R_y(-angle)`` times ``place``."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return c * place[0] - s * place[2], np.full_like(c, place[1]), s * place[0] + c * place[2]


def upper_body_kgm(body: AnthropometricBody, posture: Posture, legs: Sequence[Leg], pelvis_m: Points) -> Points:
    """Mass times place from the pelvis of all that the legs carry, which does not depend on where the pelvis is."""
    q, data = posture.q.copy(), body.model.createData()
    q[:, :3] = pelvis_m
    for leg in legs:
        leg.set_angles(body, posture, q, pelvis_m)
    com_m = np.array([pin.centerOfMass(body.model, data, row) for row in q])
    return np.asarray(body.mass_kg * (com_m - pelvis_m) - sum(leg.moment_kgm(pelvis_m) for leg in legs))


def _momentum_rate(body: AnthropometricBody, q: Configurations, dt_s: float) -> Points:
    """Low-passed rate of the angular momentum; the zero-moment point would amplify higher frequencies."""
    t = np.arange(len(q)) * dt_s
    rate = true_motion(body, make_interp_spline(t, q, k=5), t).momentum_rate_nm
    return np.asarray(sosfiltfilt(butter(2, _TRACKED_HZ, fs=1.0 / dt_s, output="sos"), rate, axis=0))


@dataclass(frozen=True)
class LegAngles:
    """Hip (yaw, pitch, roll), knee, ankle flexion and inversion, in radians."""

    hip_rad: Points
    knee_rad: Series
    flexion_rad: Series
    inversion_rad: Series


def leg_angles(p: Proportions, hip_m: Points, pelvis: Rotation, ankle_m: Points, foot: Rotation) -> LegAngles:
    """Angles that place the foot at its pose; a leg that is too short stays straight and points towards it."""
    R_foot = foot.as_matrix()
    inversion, knee, flexion = _bend_angles(p, np.einsum("nji,nj->ni", R_foot, hip_m - ankle_m))
    hip = _hip_rad(pelvis.as_matrix().swapaxes(1, 2) @ R_foot, inversion, flexion + knee)
    return LegAngles(hip, knee, flexion, inversion)


def _bend_angles(p: Proportions, hip_in_foot_m: Points) -> tuple[Series, Series, Series]:
    """Inversion, knee and ankle flexion of a leg whose hip is here in the frame of its foot."""
    x, y, z = hip_in_foot_m.T
    across = np.hypot(y, z)
    cosine = (x**2 + across**2 - p.thigh_m**2 - p.shank_m**2) / (2.0 * p.thigh_m * p.shank_m)
    knee = np.arccos(np.clip(cosine, -1.0, 1.0))
    in_shank = np.arctan2(-p.thigh_m * np.sin(knee), p.shank_m + p.thigh_m * np.cos(knee))
    return np.arctan2(y, z), knee, in_shank - np.arctan2(x, across)


def _hip_rad(foot_in_pelvis: Rotations, inversion_rad: Series, bend_rad: Series) -> Points:
    """Yaw, pitch and roll of the hip, from the required entries of the product."""
    x, y, z = np.moveaxis(foot_in_pelvis, 2, 0)
    c, s = np.cos(inversion_rad)[:, None], np.sin(inversion_rad)[:, None]
    y, z = c * y - s * z, s * y + c * z
    c, s = np.cos(bend_rad)[:, None], np.sin(bend_rad)[:, None]
    x, z = c * x + s * z, c * z - s * x
    yaw, roll = np.arctan2(x[:, 1], x[:, 0]), np.arctan2(y[:, 2], z[:, 2])
    return np.column_stack([yaw, np.arcsin(np.clip(-x[:, 2], -1.0, 1.0)), roll])
