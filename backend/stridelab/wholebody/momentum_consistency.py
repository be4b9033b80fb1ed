"""Plan and body until they agree on the angular momentum: what the limbs take is planned for, and planned again.

The plan knows a point mass and asks for ``L_c = 0``; swinging legs have an ``L_c`` of their own, for which the soles'
forces have to move. With the body's momentum ``L`` at the times t_k of ``limb_times_s`` its mean rates

    r_k = (L(t_k+1) - L(t_k)) / (t_k+1 - t_k)

go back into (4.20), whose cost then weighs ``|L_c' - r|^2`` in place of ``|L_c'|^2``: forces and CoM make room for the
limbs. The body follows the new plan, and so on until its momentum and the plan's are as near as wanted, or come no
nearer.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.ndimage import convolve1d
from scipy.signal.windows import hann

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.swing import swing_of
from stridelab.conventions import Progress
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import WholeBodyMotion, WholeBodyStopped

STRIDE_M: Final = 0.9
"""Swings that go farther matter."""
SINGLE_SUPPORT_S: Final = 0.8
"""So do swings that last less."""
AGREED_NMS: Final = 1.0
NEARER: Final = 0.9
"""A pass that leaves more than this share of the mismatch before it is the last one."""
PASSES: Final = 4
SMOOTHED_S: Final = 0.2
"""Strides of 1.0 m agree to 0.8 Nms with this, to 3.1 with half of it, and never without."""
_ROUNDING: Final = 1e-6

Solve = Callable[[CentroidalProblem], CentroidalPlan]
Follow = Callable[[Robot, ContactSequence, CentroidalPlan, Progress | None], WholeBodyMotion]


@dataclass(frozen=True)
class Pass:
    """One pass: the largest and the mean (RMS) difference of the angular momenta, N m s; process time of its plan."""

    mismatch_max_nms: float
    mismatch_rms_nms: float
    solve_time_s: float


@dataclass(frozen=True, eq=False)
class Agreement:
    """The best plan and the motion that follows it, and what came of every pass, the first without the limbs."""

    plan: CentroidalPlan
    motion: WholeBodyMotion
    passes: tuple[Pass, ...]


def matters(sequence: ContactSequence) -> bool:
    """Whether any sole swings by more than ``STRIDE_M`` or in less than ``SINGLE_SUPPORT_S``."""
    for name in sequence.effectors:
        for k, phase in enumerate(sequence.phases):
            before, after = sequence.last_contact(name, k), sequence.next_contact(name, k)
            if name in phase.contacts or before is None or after is None or before.kind != "surface":
                continue
            far_m = np.linalg.norm(after.placement.position_m - before.placement.position_m)
            brief = swing_of(sequence, name, k).duration_s < SINGLE_SUPPORT_S - _ROUNDING
            if far_m > STRIDE_M + _ROUNDING or brief:
                return True
    return False


def agree(
    robot: Robot,
    problem: CentroidalProblem,
    plan: CentroidalPlan,
    solve: Solve,
    follow: Follow,
    progress: Progress | None = None,
    *,
    passes: int | None = None,
) -> Agreement:
    """Follow ``plan`` of ``problem``; where it matters, plan and follow again, at most ``passes`` times in all.

    Of the plans that converge and can be followed the one is kept that agrees best. Raises what ``follow``, the
    controller's ``run``, does with the first.
    """
    most = passes or (PASSES if matters(plan.sequence) else 1)
    motion = follow(robot, plan.sequence, plan, _share(progress, 0, most))
    best = Agreement(plan, motion, (_compared(plan, motion),))
    while len(best.passes) < most and best.passes[-1].mismatch_max_nms > AGREED_NMS:
        fixed = replace(problem, sequence=plan.sequence, durations=None, placements=None)
        again = solve(replace(fixed, limbs_nm=limb_rates_nm(fixed, best.motion)))
        if not again.converged:
            break
        try:
            motion = follow(robot, again.sequence, again, _share(progress, len(best.passes), most))
        except WholeBodyStopped:  # the plan before could be followed
            break
        came = _compared(again, motion)
        better = came.mismatch_max_nms < best.passes[-1].mismatch_max_nms
        nearer = came.mismatch_max_nms < NEARER * best.passes[-1].mismatch_max_nms
        best = Agreement(again, motion, (*best.passes, came)) if better else replace(best, passes=(*best.passes, came))
        if not nearer:
            break
    return best


def limb_rates_nm(problem: CentroidalProblem, motion: WholeBodyMotion) -> Float[np.ndarray, "m 3"]:
    """Mean rates of the body's angular momentum between the times that the plan takes them for.

    Splines, which ask for them every 15 to 35 ms, get them smoothed by Hann's window: a body that is asked to take back
    every jerk of a landing leg answers with others.
    """
    time_s, l_nms = problem.limb_times_s(), motion.l_nms
    if problem.shape == "cubic":
        window = hann(round(SMOOTHED_S * motion.rate_hz) + 2)[1:-1]
        l_nms = convolve1d(l_nms, window / window.sum(), axis=0, mode="nearest")
    at_times = np.array([np.interp(time_s, motion.time_s, l) for l in l_nms.T]).T
    return np.asarray(np.diff(at_times, axis=0) / np.diff(time_s)[:, None])


def _share(progress: Progress | None, done: int, most: int) -> Progress | None:
    """Progress of one pass after ``done`` of at most ``most``."""
    return None if progress is None else lambda fraction, message: progress((done + fraction) / most, message)


def _compared(plan: CentroidalPlan, motion: WholeBodyMotion) -> Pass:
    apart = np.linalg.norm(motion.l_nms - motion.l_reference_nms, axis=1)
    return Pass(float(apart.max()), float(np.sqrt(np.mean(apart**2))), plan.solve_time_s)
