"""Postures at the phase boundaries of a plan: a plan that no posture fits is refused before the whole body follows it.

At a boundary the contacts of both phases hold, and the whole-body controller has to be on the CoM of the plan. If
inverse kinematics within the same joint ranges leaves an error beyond ``MISS_M`` from all starts, no motion passes the
certificate, whose limit is a tenth of that. Self-collisions and torques are left to the whole body: at one boundary
many postures exist, and another one may be free of them.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, NotEstimable
from stridelab.robots.inverse_kinematics import ComRegion, IkResult, reference_posture_at, stand_in_com_region
from stridelab.robots.part_names import part_words
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.task_stack import Settings

MISS_M: Final = 5e-3
"""Smallest error (m, rad) of a boundary that no posture fits."""
COM_TOLERANCE_M: Final = 2e-4
"""Half the edge of the cube around the CoM of the plan."""
RANDOM_STARTS: Final = 4
SPREAD_RAD: Final = 0.25
MAX_NAMED_JOINTS: Final = 3
_AXES: Final = np.vstack([np.eye(3), -np.eye(3)])


def require_boundary_postures(robot: Robot, plan: CentroidalPlan) -> None:
    """Require a posture on the contacts and the CoM of ``plan`` at each of its phase boundaries.

    Raises ``NotEstimable`` (``stance-unreachable``) with the boundary, what misses its place by how much, and the
    joints at the ends of their ranges.
    """
    sequence = plan.sequence
    limits, settings = JointLimits.of_model(robot.model), Settings()
    margins_rad = limits.margins_rad(settings.range_share, settings.joint_margin_rad)
    q: Float[np.ndarray, "nq"] | None = None
    for k in range(len(sequence.phases) + 1):
        time_s = float(sequence.starts_s[k]) if k < len(sequence.phases) else sequence.duration_s
        com_m = plan.reference_at(time_s).com_m
        room = ComRegion(_AXES, np.r_[com_m, -com_m] + COM_TOLERANCE_M)
        placements = {
            name: contact.placement
            for phase in sequence.phases[max(k - 1, 0) : k + 1]
            for name, contact in phase.contacts.items()
        }
        best: IkResult | None = None
        for q_start in _search_starts(robot, placements, com_m, q):
            posture = stand_in_com_region(
                robot, placements, room, com_m, q_start, margins_rad, is_near=q_start is not None and q_start is q
            )
            if best is None or _error_of(posture) < _error_of(best):
                best = posture
            if posture.converged:
                break
        if best is None:
            raise AssertionError("a search has at least one start")
        if _error_of(best) > MISS_M:
            raise _unreachable_boundary(robot, plan, k, time_s, best)
        q = best.q if best.converged else None


def _search_starts(
    robot: Robot, placements: dict[str, Placement], com_m: Vector3, q: Float[np.ndarray, "nq"] | None
) -> Iterator[Float[np.ndarray, "nq"] | None]:
    """The posture of the boundary before, the reference posture (None), and perturbed ones, always the same."""
    if q is not None:
        yield q
    yield None
    rng, model = np.random.default_rng(0), robot.model
    reference = reference_posture_at(robot, placements, com_m)
    for _ in range(RANDOM_STARTS):
        noise = SPREAD_RAD * rng.standard_normal(model.nv)
        noise[:3] = 0.0
        yield np.asarray(pin.integrate(model, reference, noise))


def _error_of(posture: IkResult) -> float:
    return max(posture.error_m, posture.error_rad)


def _unreachable_boundary(robot: Robot, plan: CentroidalPlan, k: int, time_s: float, posture: IkResult) -> NotEstimable:
    phase = min(k, len(plan.sequence.phases) - 1)
    when = f"where phase {phase} begins" if k == phase else f"at the end of phase {phase}"
    miss = f"by {1e3 * posture.error_m:.0f} mm"
    if posture.error_m < posture.error_rad:
        miss = f"or turns from its place by {posture.error_rad:.2f} rad"
    joints = [part_words(joint) for joint in posture.at_limit[:MAX_NAMED_JOINTS]]
    ends = f", with the {' and the '.join(joints)} at the end of the range" if joints else ""
    what = f"the {part_words(posture.worst)} misses its place {miss}{ends}"
    message = f"No posture of {robot.title} fits the plan at {time_s:.2f} s, {when}: {what}."
    place = f"phases[{phase}]"
    if posture.worst in plan.sequence.phases[phase].contacts:
        place += f".contacts[{posture.worst}]"
    return NotEstimable("stance-unreachable", message, [Fault(place, message)])
