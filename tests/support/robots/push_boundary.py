"""How hard a robot may be pushed under way (section 4.8): the boundary, found by bisection.

At a time of a plan the CoM gets a velocity on top of its own. The push is recovered from where the rest of the contact
sequence, at its given times and places, still leads to the goal at rest, with what is left of the cost as it may be.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.centroidal.native.availability import native_can_solve
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.receding_horizon import SOLVE_LIMITS, RecedingHorizon, State
from stridelab.centroidal.solver import solve
from stridelab.conventions import Vector3

MOST_M_S: Final = 5.0
"""Harder pushes are not tried."""
CLOSE_M_S: Final = 0.005
"""The bisection ends there."""


@dataclass(frozen=True)
class Boundary:
    """``held_m_s`` was recovered from, ``lost_m_s`` was not (infinite: even the hardest was)."""

    held_m_s: float
    lost_m_s: float


def push_boundary(problem: CentroidalProblem, plan: CentroidalPlan, time_s: float, direction: Vector3) -> Boundary:
    """Bisect the size of a push along ``direction`` (of length one) at ``time_s`` of a plan of ``problem``."""
    there = plan.reference_at(time_s)
    horizon = RecedingHorizon(problem=problem, horizon_s=max(problem.sequence.duration_s, 1.0))

    def recovered(size_m_s: float) -> bool:
        state = State(there.com_m, there.com_v_m_s + size_m_s * np.asarray(direction), there.l_nms)
        rest = horizon.horizon_problem(time_s, state)
        return solve(rest, "native" if native_can_solve(rest) else "ipopt", SOLVE_LIMITS).converged

    if recovered(MOST_M_S):
        return Boundary(MOST_M_S, np.inf)
    held, lost = 0.0, MOST_M_S
    while lost - held > CLOSE_M_S:
        middle = 0.5 * (held + lost)
        held, lost = (middle, lost) if recovered(middle) else (held, middle)
    return Boundary(held, lost)
