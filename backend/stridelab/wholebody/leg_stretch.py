"""Length of the legs along a centroidal plan, and plans with a CoM low enough for the legs to reach.

The plan knows a point mass and learned densities, not knees: where a foot lands below the body, or far from it, the leg
may have to be longer than it is. With an upright base of the planned heading and legs whose CoM lies between hip h and
ankle a, ``c_leg = lam h + (1 - lam) a + R o``, the position of the base follows from the CoM and the feet,

    m c = m_r (p + R o_r) + sum_legs m_l (lam h + (1 - lam) a + R o) ,    h = p + R h_0 ,

and with it the vector ``h - a``, whose length may be at most ``l``, that of the leg with a knee ``BEND_RAD`` from the
end of its range. The missing height is what the base has to be lower. The acceleration of a smooth curve of these
heights becomes the reference of the plan's CoM, ``|c'' - r''|^2`` in place of ``|c''|^2``, and the plan is solved
again: a few milliseconds, before the whole body. A leg in the air may be short by ``AIR_M`` in the middle of its swing,
which its detour (``control.swing_detour``) makes up for.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.ndimage import convolve1d, maximum_filter1d
from scipy.signal.windows import hann

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.sequence_swings import swing_of
from stridelab.contacts.swing import quintic_scaling
from stridelab.conventions import Points, Rotations, Series, Vector3
from stridelab.robots.contact_frames import to_se3
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.tasks import Heading

BEND_RAD: Final = 0.05
"""Distance of a knee from the straight end of its usable range at which a leg counts as fully stretched."""
RANGE_SHARE: Final = 0.025
AIR_M: Final = 0.04
AIR_WINDOWS: Final = ((0.0, 0.3), (0.65, 0.96))
"""Shares of a swing in which the allowance of a leg in the air grows and ends."""
ENOUGH_M: Final = 0.008
"""Missing height that is left alone: the base tilts by as much. Lower plans bend the knees towards the next tread."""
MAX_LOWERING_M: Final = 0.12
MAX_PASSES: Final = 4
RATE_HZ: Final = 50.0
HOLD_S: Final = 0.2
SMOOTH_S: Final = (1.6, 1.2, 0.8, 0.4)
"""A height counts for ``HOLD_S`` around its time, and is smoothed over the first of these that is sufficient."""
MAX_VERTICAL_M_S2: Final = 2.5
MAX_VERTICAL_WITH_HANDS_M_S2: Final = 0.5
"""Largest vertical acceleration of a lowered plan; arms whose hands stay on a rail follow every drop of the body."""
LEG_JOINTS: Final = 4
"""Joints from the hip's last on: hip, knee, two at the ankle."""

Solve = Callable[[CentroidalProblem], CentroidalPlan]


class Leg(NamedTuple):
    """One leg in the reference posture: ``hip_m`` in the base, ``ankle_m`` in the contact frame of its sole."""

    hip_m: Vector3
    ankle_m: Vector3
    length_max_m: float
    mass_kg: float
    share: float
    offset_m: Vector3


@dataclass(frozen=True, eq=False)
class LegModel:
    """Legs by sole, and mass and CoM (in the base) of everything else."""

    legs: Mapping[str, Leg]
    mass_kg: float
    rest_m: Vector3

    @staticmethod
    def of_robot(robot: Robot) -> "LegModel":
        """The model in the robot's reference posture; without legs of at least four joints it is empty."""
        model, data, q = robot.model, robot.model.createData(), robot.q_reference
        pin.centerOfMass(model, data, q, True)
        pin.computeSubtreeMasses(model, data)
        R, p = data.oMi[1].rotation @ robot.R_root_trunk, data.oMi[1].translation
        legs: dict[str, Leg] = {}
        moment = data.mass[0] * data.com[0]
        for name, effector in robot.effectors.items():
            frame = model.frames[model.getFrameId(effector.frame)]
            chain = list(model.supports[frame.parentJoint])
            if effector.kind != "surface" or len(chain) < LEG_JOINTS + 2:
                continue
            hip, knee, ankle = chain[-4], chain[-3], chain[-2]
            contact = data.oMi[frame.parentJoint] * frame.placement * to_se3(effector.T_frame_contact)
            h, a, com = (
                data.oMi[hip].translation,
                data.oMi[ankle].translation,
                data.oMi[chain[2]].act(data.com[chain[2]]),
            )
            mass = float(data.mass[chain[2]])
            moment = moment - mass * com
            share = float((com - a)[2] / (h - a)[2])
            legs[name] = Leg(
                R.T @ (h - p),
                contact.inverse().act(a),
                _longest_m(robot, hip, knee, ankle),
                mass,
                share,
                R.T @ (com - share * h - (1.0 - share) * a),
            )
        total = float(data.mass[0])
        rest = moment / (total - sum(leg.mass_kg for leg in legs.values()))
        return LegModel(legs, total, R.T @ (rest - p))

    def missing_height_m(self, plan: CentroidalPlan, time_s: Series) -> Series:
        """How much lower the CoM has to be for all legs to reach, at ``time_s`` (n,); zero where they do."""
        sequence, heading = plan.sequence, Heading.of_sequence(plan.sequence)
        phase = np.array([sequence.phase_at(t + 1e-9) for t in time_s.tolist()])
        com = np.array([plan.reference_at(t).com_m for t in time_s.tolist()])
        R = np.array([heading.orientation_at(k, t)[0] for k, t in zip(phase.tolist(), time_s.tolist(), strict=True)])
        feet = {name: _ankle_path(sequence, name, leg.ankle_m, phase, time_s) for name, leg in self.legs.items()}
        base, base_share = self._base_m(com, R, {name: ankle for name, (ankle, _) in feet.items()})
        missing = np.zeros(len(time_s))
        for name, leg in self.legs.items():
            ankle, allowed_m = feet[name]
            v = base + R @ leg.hip_m - ankle
            reach = leg.length_max_m + allowed_m
            high = v[:, 2] - np.sqrt(np.maximum(reach**2 - (v[:, :2] ** 2).sum(axis=1), 0.0))
            missing = np.maximum(missing, high / base_share)
        return np.asarray(missing)

    def _base_m(self, com_m: Points, R: Rotations, ankles_m: Mapping[str, Points]) -> tuple[Points, float]:
        """Positions of the base, and its displacement per displacement of the CoM."""
        rest_kg = self.mass_kg - sum(leg.mass_kg for leg in self.legs.values())
        moved, kg = self.mass_kg * com_m - rest_kg * (R @ self.rest_m), rest_kg
        for name, leg in self.legs.items():
            fixed = R @ (leg.share * leg.hip_m + leg.offset_m) + (1.0 - leg.share) * ankles_m[name]
            moved, kg = moved - leg.mass_kg * fixed, kg + leg.mass_kg * leg.share
        return moved / kg, self.mass_kg / kg


def lower_for_legs(
    robot: Robot, problem: CentroidalProblem, plan: CentroidalPlan, solve: Solve
) -> tuple[CentroidalProblem, CentroidalPlan]:
    """The problem and plan with a CoM that is lower where legs are too short; as given where they reach.

    The gentlest lowering that is sufficient, with a vertical acceleration within its limit, else that within it which
    misses least, else the gentlest.
    """
    legs = LegModel.of_robot(robot)
    time_s = np.linspace(0.0, plan.sequence.duration_s, max(2, round(plan.sequence.duration_s * RATE_HZ) + 1))
    missing = legs.missing_height_m(plan, time_s)
    if float(missing.max(initial=0.0)) <= ENOUGH_M:
        return problem, plan
    holds = any(contact.kind == "point" for phase in plan.sequence.phases for contact in phase.contacts.values())
    limit_m_s2 = MAX_VERTICAL_WITH_HANDS_M_S2 if holds else MAX_VERTICAL_M_S2
    best: _Lowered | None = None
    for smooth_s in SMOOTH_S:
        lowered = _lower_smoothly(legs, problem, plan, solve, time_s, missing, smooth_s)
        is_gentle = _vertical_max_m_s2(lowered.plan, time_s) <= limit_m_s2
        if best is None or (is_gentle and lowered.missing_m < best.missing_m):
            best = lowered
        if is_gentle and lowered.missing_m <= ENOUGH_M:
            break
    assert best is not None
    return best.problem, best.plan


class _Lowered(NamedTuple):
    """A problem, its plan, and the height (m) that its legs miss."""

    problem: CentroidalProblem
    plan: CentroidalPlan
    missing_m: float


def _lower_smoothly(
    legs: LegModel,
    problem: CentroidalProblem,
    plan: CentroidalPlan,
    solve: Solve,
    time_s: Series,
    missing: Series,
    smooth_s: float,
) -> _Lowered:
    """Lower a plan that has the ``missing`` heights at ``time_s``, with heights smoothed over ``smooth_s``.

    A plan that does not converge, or misses more than the one before, ends the search.
    """
    best, wanted = (problem, plan), np.zeros(len(time_s))
    least_m = float(missing.max(initial=0.0))
    for _ in range(MAX_PASSES):
        if least_m <= ENOUGH_M:
            break
        wanted = np.minimum(wanted + _smooth_heights(missing, smooth_s), MAX_LOWERING_M)
        fixed = replace(problem, sequence=plan.sequence, durations=None, placements=None)
        times = fixed.limb_times_s()
        reference = _accelerations_m_s2(time_s, -wanted, times)
        given = problem.reference_m_s2
        lower = replace(fixed, reference_m_s2=reference if given is None else given + reference)
        new = solve(lower)
        if not new.converged:
            break
        missing = legs.missing_height_m(new, time_s)
        if float(missing.max()) >= least_m:
            break
        best, least_m = (lower, new), float(missing.max())
    return _Lowered(*best, least_m)


def _vertical_max_m_s2(plan: CentroidalPlan, time_s: Series) -> float:
    """Largest vertical acceleration of the CoM at ``time_s``."""
    return max(abs(float(plan.reference_at(t).com_a_m_s2[2])) for t in time_s.tolist())


def _longest_m(robot: Robot, hip: int, knee: int, ankle: int) -> float:
    """Largest distance of hip and ankle within the usable range of the knee."""
    model, data = robot.model, robot.model.createData()
    at = model.joints[knee].idx_q
    low, high = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
    margin, longest = RANGE_SHARE * (high - low) + BEND_RAD, 0.0
    for angle in np.linspace(low + margin, high - margin, 50):
        q = robot.q_reference.copy()
        q[at] = angle
        pin.forwardKinematics(model, data, q)
        longest = max(longest, float(np.linalg.norm(data.oMi[hip].translation - data.oMi[ankle].translation)))
    return longest


def _ankle_path(
    sequence: ContactSequence, name: str, ankle_m: Vector3, phase: np.ndarray, time_s: Series
) -> tuple[Points, Series]:
    """Positions of an ankle (n, 3), and by how much its leg may be short (n,)."""
    positions, allowed = np.zeros((len(time_s), 3)), np.zeros(len(time_s))
    for k, part in enumerate(sequence.phases):
        inside = np.flatnonzero(phase == k)
        if not len(inside):
            continue
        if name in part.contacts:
            placement = part.contacts[name].placement
            positions[inside] = placement.position_m + placement.rotation @ ankle_m
            continue
        curve = swing_of(sequence, name, k)
        shares = (time_s[inside] - curve.starts_s) / curve.duration_s
        points, rotations = curve.poses_at(shares)
        positions[inside] = points + rotations @ ankle_m
        rise, end = AIR_WINDOWS
        allowed[inside] = [
            AIR_M * quintic_scaling(u, rise, 1.0)[0] * (1.0 - quintic_scaling(u, end, 1.0)[0]) for u in shares.tolist()
        ]
    return positions, allowed


def _smooth_heights(height_m: Series, smooth_s: float) -> Series:
    """A smooth curve that is not below ``height_m`` where it peaks."""
    held = maximum_filter1d(height_m, 2 * round(0.5 * (HOLD_S + smooth_s) * RATE_HZ) + 1)
    window = hann(round(smooth_s * RATE_HZ) + 2)[1:-1]
    return np.asarray(convolve1d(held, window / window.sum(), mode="nearest"))


def _accelerations_m_s2(
    time_s: Series, height_m: Series, times_s: Float[np.ndarray, "times"]
) -> Float[np.ndarray, "m 3"]:
    """Mean vertical accelerations between ``times_s`` of a curve of heights."""
    speed = np.interp(times_s, time_s, np.gradient(height_m, time_s))
    mean = np.zeros((len(times_s) - 1, 3))
    mean[:, 2] = np.diff(speed) / np.diff(times_s)
    return mean
