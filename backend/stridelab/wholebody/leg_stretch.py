"""Length of the legs along a centroidal plan, and plans with a CoM that legs and ankles can follow.

The plan knows a point mass and learned densities, not knees: where a foot lands below the body, or far from it, the leg
may have to be longer than it is. With an upright base of the planned heading and legs whose CoM lies between hip h and
ankle a, ``c_leg = lam h + (1 - lam) a + R o``, the position of the base follows from the CoM and the feet,

    m c = m_r (p + R o_r) + sum_legs m_l (lam h + (1 - lam) a + R o) ,    h = p + R h_0 ,

and with it the vector ``v = h - a``. Its length may be at most ``l``, that of the leg with a knee ``BEND_RAD`` from the
end of its range, and the shank of a standing leg may lean ahead of the normal of its sole by what the ankle and the
terrain before it (``shank_lean``) allow,

    |v| <= l ,    atan2(v_x, v_z) + beta(|v|) <= phi ,

``beta`` the angle of shank and ``v``, in the axes of the sole. What is missing of the first is how much lower, of the
second how much higher the base has to be. These heights become bounds of the CoM at the nodes near them, and the plan
is solved again: a few milliseconds, before the whole body. The bounds of all solutions hold together: a plan that sinks
before a leg is stretched is lifted by the next one. A leg in the air may be short by ``AIR_M`` in the middle of its
swing, which its detour (``control.swing_detour``) makes up for.
"""

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.sequence_swings import swing_of
from stridelab.contacts.swing import quintic_scaling
from stridelab.conventions import Points, Rotations, Series, Vector3
from stridelab.robots.contact_frames import to_se3
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.tasks import Heading
from stridelab.wholebody.shank_lean import ShankLean

BEND_RAD: Final = 0.05
"""Distance of a knee from the straight end of its usable range at which a leg counts as fully stretched."""
RANGE_SHARE: Final = 0.025
AIR_M: Final = 0.04
AIR_WINDOWS: Final = ((0.0, 0.3), (0.65, 0.96))
"""Shares of a swing in which the allowance of a leg in the air grows and ends."""
ENOUGH_M: Final = 0.008
"""Missing height that is left alone: the base tilts by as much. Lower plans bend the knees towards the next tread."""
GAP_M: Final = 0.005
"""Between the bounds of a height, where legs and ankles contradict each other."""
MAX_RAISE_M: Final = 0.2
STEPS_OF_BISECTION: Final = 12
SPARE_M: Final = 0.001
"""Between the samples, which are ``RATE_HZ`` apart."""
MAX_PASSES: Final = 4
RATE_HZ: Final = 50.0
LEG_JOINTS: Final = 4
"""Joints from the hip's last on: hip, knee, two at the ankle."""

Solve = Callable[[CentroidalProblem], CentroidalPlan]


class Leg(NamedTuple):
    """One leg in the reference posture: ``hip_m`` in the base, ``ankle_m`` in the contact frame of its sole.

    ``lengths_m`` are distances of hip and ankle within the usable range of the knee, increasing, and ``shank_rad`` how
    far the shank then leans ahead of the line from ankle to hip; ``tilt_max_rad`` is how far it can lean ahead of the
    normal of the sole.
    """

    hip_m: Vector3
    ankle_m: Vector3
    lengths_m: Series
    shank_rad: Series
    tilt_max_rad: float
    mass_kg: float
    share: float
    offset_m: Vector3


class MissingHeights(NamedTuple):
    """How much lower the CoM has to be for all legs to reach, and how much higher for ankles to bend and for shanks.

    Ankles and shanks count while their soles are in contact; a shank of a standing leg has to be clear of the terrain.
    """

    high_m: Series
    bend_m: Series
    riser_m: Series

    @property
    def low_m(self) -> Series:
        """How much higher for ankles and shanks."""
        return np.asarray(np.maximum(self.bend_m, self.riser_m))

    @property
    def worst_m(self) -> float:
        """Largest height that legs or shanks need."""
        return float(max(self.high_m.max(), self.riser_m.max()))


@dataclass(frozen=True, eq=False)
class LegModel:
    """Legs by sole, and mass and CoM (in the base) of everything else."""

    legs: Mapping[str, Leg]
    mass_kg: float
    rest_m: Vector3

    @staticmethod
    @lru_cache(maxsize=8)
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
            hip, knee, ankle = _hip_pitch_joint(robot, chain[2:-3]), chain[-3], chain[-2]
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
                *_knee_table(robot, hip, knee, ankle),
                _tilt_max_rad(robot, name, knee, ankle),
                mass,
                share,
                R.T @ (com - share * h - (1.0 - share) * a),
            )
        total = float(data.mass[0])
        rest = moment / (total - sum(leg.mass_kg for leg in legs.values()))
        return LegModel(legs, total, R.T @ (rest - p))

    def missing_heights_m(self, plan: CentroidalPlan, time_s: Series, shanks: ShankLean) -> MissingHeights:
        """How much lower or higher the CoM has to be at ``time_s`` (n,), zero where it need not."""
        sequence, heading = plan.sequence, Heading.of_sequence(plan.sequence)
        phase = sequence.phases_at(time_s + 1e-9)
        com = plan.references_at(time_s).com_m
        R = heading.orientations_at(phase, time_s)[0]
        feet = {name: _ankle_path(sequence, name, leg.ankle_m, phase, time_s) for name, leg in self.legs.items()}
        base, base_share = self._base_m(com, R, {name: ankle for name, (ankle, _) in feet.items()})
        high_m, bend_m, riser_m = np.zeros((3, len(time_s)))
        for name, leg in self.legs.items():
            ankle, allowed_m = feet[name]
            v = base + R @ leg.hip_m - ankle
            reach = leg.lengths_m[-1] + allowed_m
            high = v[:, 2] - np.sqrt(np.maximum(reach**2 - (v[:, :2] ** 2).sum(axis=1), 0.0))
            high_m = np.maximum(high_m, high / base_share)
            stands, sole, leans_rad = np.zeros(len(time_s), dtype=bool), R.copy(), np.full(len(time_s), np.inf)
            for k, part in enumerate(sequence.phases):
                if name in part.contacts:
                    contact, during = part.contacts[name], phase == k
                    stands |= during
                    sole[during] = contact.placement.rotation
                    leans_rad[during] = shanks.largest_lean_rad(name, contact, k, leg.ankle_m, leg.tilt_max_rad)
            raised = _raised_for_lean_m(leg, v[stands], sole[stands], np.full(int(stands.sum()), leg.tilt_max_rad))
            bend_m[stands] = np.maximum(bend_m[stands], raised / base_share)
            blocked = stands & (leans_rad < leg.tilt_max_rad)
            raised = _raised_for_lean_m(leg, v[blocked], sole[blocked], leans_rad[blocked])
            riser_m[blocked] = np.maximum(riser_m[blocked], raised / base_share)
        return MissingHeights(high_m, bend_m, riser_m)

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
    """The problem and plan with a CoM that legs can follow; as given where they reach and are clear of the terrain.

    Bounds are tightened in up to ``MAX_PASSES`` solutions, as long as the plans converge; the one that misses least is
    returned.
    """
    *_, best = iterate_lower_plans(robot, problem, plan, solve)
    return best


def iterate_lower_plans(
    robot: Robot, problem: CentroidalProblem, plan: CentroidalPlan, solve: Solve
) -> Generator[tuple[CentroidalProblem, CentroidalPlan], None, None]:
    """The best of ``lower_for_legs`` so far: that given, then after every further solution; the last is its result."""
    legs = LegModel.of_robot(robot)
    time_s = np.linspace(0.0, plan.sequence.duration_s, max(2, round(plan.sequence.duration_s * RATE_HZ) + 1))
    fixed = replace(problem, sequence=plan.sequence, durations=None, placements=None)
    between_m = problem.bounds.com_between_m
    if between_m is None:
        between_m = np.tile([-np.inf, np.inf], (len(fixed.grid().phase), 1))
    shanks = ShankLean(robot, plan.sequence)
    missing = legs.missing_heights_m(plan, time_s, shanks)
    best, latest, least_m = (problem, plan), plan, missing.worst_m
    for _ in range(MAX_PASSES):
        yield best
        if least_m <= ENOUGH_M:
            break
        com_m = latest.references_at(time_s).com_m[:, 2]
        between_m = _tighten_bounds(between_m, fixed.grid().time_s, time_s, com_m, missing.high_m, missing.low_m)
        bounded = replace(fixed, bounds=replace(problem.bounds, com_between_m=between_m))
        latest = solve(bounded)
        if not latest.converged:
            break
        missing = legs.missing_heights_m(latest, time_s, shanks)
        if missing.worst_m < least_m:
            best, least_m = (bounded, latest), missing.worst_m
    yield best


def _tighten_bounds(
    between_m: Float[np.ndarray, "m 2"],
    nodes_s: Float[np.ndarray, "nodes"],
    time_s: Series,
    com_m: Series,
    high_m: Series,
    low_m: Series,
) -> Float[np.ndarray, "m 2"]:
    """Bounds at the nodes from what is missing around them; where both cannot hold, their mean does.

    A node is moved by at most what is missing anywhere around it: a CoM that climbs by 0.2 m/s would otherwise get the
    bound of the lower of two nodes at the higher one, and could not pass between its bounds.
    """
    between_m = between_m.copy()
    at_nodes_m = np.interp(nodes_s, time_s, com_m)
    highest_m, lowest_m = com_m - high_m - SPARE_M, com_m + low_m + SPARE_M
    for k in range(1, len(between_m)):
        near = (time_s > nodes_s[k - 1]) & (time_s < nodes_s[k + 1])
        if high_m[near].any():
            shifted_m = at_nodes_m[k] - high_m[near].max() - SPARE_M
            between_m[k, 1] = min(between_m[k, 1], max(shifted_m, highest_m[near & (high_m > 0.0)].min()))
        if low_m[near].any():
            shifted_m = at_nodes_m[k] + low_m[near].max() + SPARE_M
            between_m[k, 0] = max(between_m[k, 0], min(shifted_m, lowest_m[near & (low_m > 0.0)].max()))
        if between_m[k, 1] - between_m[k, 0] < GAP_M:
            between_m[k] = between_m[k].mean() + np.array([-0.5, 0.5]) * GAP_M
    return between_m


def _raised_for_lean_m(leg: Leg, v: Points, soles: Rotations, most_rad: Series) -> Series:
    """How much higher hips at ``v`` (n, 3) from their ankle have to be for its shank to lean at most ``most_rad``."""
    low, high = np.zeros(len(v)), np.full(len(v), MAX_RAISE_M)
    at_first, up = np.einsum("ni,nij->nj", v, soles), soles[:, 2]
    for _ in range(STEPS_OF_BISECTION if len(v) else 0):
        middle = 0.5 * (low + high)
        at = at_first + middle[:, None] * up
        shank = np.interp(np.sqrt((at * at).sum(axis=1)), leg.lengths_m, leg.shank_rad)
        leans = np.arctan2(at[:, 0], at[:, 2]) + shank > most_rad
        low, high = np.where(leans, middle, low), np.where(leans, high, middle)
    return np.where(low > 0.0, high, 0.0)


def _hip_pitch_joint(robot: Robot, joints: Sequence[int]) -> int:
    """The joint of a hip whose axis is the most lateral in the reference posture: the leg stretches from there."""
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, robot.q_reference)
    across = (data.oMi[1].rotation @ robot.R_root_trunk)[:, 1]
    return max(joints, key=lambda joint: abs(float(across @ data.J[3:, model.joints[joint].idx_v])))


def _knee_table(robot: Robot, hip: int, knee: int, ankle: int) -> tuple[Series, Series]:
    """Distances of hip and ankle in the usable range of the knee, and how far the shank leans ahead of their line."""
    model, data = robot.model, robot.model.createData()
    at = model.joints[knee].idx_q
    low, high = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
    margin, rows = RANGE_SHARE * (high - low) + BEND_RAD, []
    for angle in np.linspace(low + margin, high - margin, 50):
        q = robot.q_reference.copy()
        q[at] = angle
        pin.forwardKinematics(model, data, q)
        leg, shank = ((data.oMi[joint].translation - data.oMi[ankle].translation) for joint in (hip, knee))
        lead = np.arctan2(shank[0], shank[2]) - np.arctan2(leg[0], leg[2])
        rows.append((float(np.linalg.norm(leg)), float((lead + np.pi) % (2.0 * np.pi) - np.pi)))
    lengths_m, shank_rad = np.array(sorted(rows)).T
    return lengths_m, shank_rad


def _tilt_max_rad(robot: Robot, name: str, knee: int, ankle: int) -> float:
    """How far a shank can lean ahead of the normal of the sole ``name``, within the usable ranges of its ankle."""
    model, data, effector = robot.model, robot.model.createData(), robot.effectors[name]
    frame = model.frames[model.getFrameId(effector.frame)]
    tilts = []
    for joint in (ankle, frame.parentJoint):
        at = model.joints[joint].idx_q
        low, high = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
        margin = RANGE_SHARE * (high - low)
        for angle in (low + margin, high - margin):
            q = robot.q_reference.copy()
            q[at] = angle
            pin.forwardKinematics(model, data, q)
            contact = data.oMi[frame.parentJoint] * frame.placement * to_se3(effector.T_frame_contact)
            shank = contact.rotation.T @ (data.oMi[knee].translation - data.oMi[ankle].translation)
            tilts.append(float(np.arctan2(shank[0], shank[2])))
    return max(tilts)


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
