"""Momentum consistency: replans with the angular momentum of the limbs until plan and body agree.

The plan models a point mass and aims for ``L_c = 0``; swinging legs have angular momentum, which the forces on the
soles must provide. With the body's momentum ``L`` at the times t_k of ``limb_times_s`` its mean rates

    r_k = (L(t_k+1) - L(t_k)) / (t_k+1 - t_k)

enter (4.20), whose cost then weighs ``|L_c' - r|^2`` instead of ``|L_c'|^2``: forces and CoM account for the limbs. The
body follows the new plan, and the iteration repeats until both momenta agree within a tolerance or stop converging.
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
from stridelab.contacts.sequence_swings import swing_of
from stridelab.conventions import Progress
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certify import momentum_limit_nms
from stridelab.wholebody.motion import WholeBodyMotion, WholeBodyStopped

STRIDE_M: Final = 0.9
"""Longer swings need replanning."""
SINGLE_SUPPORT_S: Final = 0.8
"""Shorter swings need replanning."""
AGREEMENT_NMS: Final = 1.0
"""Largest mismatch of the angular momenta that counts as agreement."""
MAX_REMAINING_SHARE: Final = 0.9
"""The iteration stops if a pass leaves more than this share of the previous mismatch."""
MAX_PASSES: Final = 4
SMOOTHING_WINDOW_S: Final = 0.2
"""Length of the smoothing window: strides of 1.0 m agree to 0.8 Nms with it, to 3.1 with half of it, never without."""
MAX_LIMIT_SHARE: Final = 0.7
"""Share of the certificate's limit above which a mismatch needs replanning, whatever the swings."""
_ROUNDING: Final = 1e-6

Solve = Callable[[CentroidalProblem], CentroidalPlan]
Follow = Callable[[Robot, ContactSequence, CentroidalPlan, Progress | None], WholeBodyMotion]


@dataclass(frozen=True)
class Pass:
    """One pass: largest and RMS difference of the angular momenta (N m s), process time of its plan (s)."""

    mismatch_max_nms: float
    mismatch_rms_nms: float
    solve_time_s: float


@dataclass(frozen=True, eq=False)
class Agreement:
    """The best plan, the motion that follows it, and the results of all passes; the first is without the limbs."""

    plan: CentroidalPlan
    motion: WholeBodyMotion
    passes: tuple[Pass, ...]


def needs_replanning(sequence: ContactSequence) -> bool:
    """Whether any sole swings by more than ``STRIDE_M`` or in less than ``SINGLE_SUPPORT_S``."""
    for name in sequence.effectors:
        for k, phase in enumerate(sequence.phases):
            before, after = sequence.last_contact(name, k), sequence.next_contact(name, k)
            if name in phase.contacts or before is None or after is None or before.kind != "surface":
                continue
            length_m = np.linalg.norm(after.placement.position_m - before.placement.position_m)
            is_short = swing_of(sequence, name, k).duration_s < SINGLE_SUPPORT_S - _ROUNDING
            if length_m > STRIDE_M + _ROUNDING or is_short:
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
    """Follow ``plan`` of ``problem``; if necessary, replan and follow again, at most ``passes`` times in total.

    Returns the best agreement among the plans that converge and can be followed. Raises what ``follow``, the
    controller's ``run``, raises for the first plan.
    """
    max_passes = passes or (MAX_PASSES if needs_replanning(plan.sequence) else 1)
    motion = follow(robot, plan.sequence, plan, _progress_of_pass(progress, 0, max_passes))
    best = Agreement(plan, motion, (_compare_momenta(plan, motion),))
    if passes is None and best.passes[0].mismatch_max_nms > MAX_LIMIT_SHARE * momentum_limit_nms(robot):
        max_passes = MAX_PASSES
    while len(best.passes) < max_passes and best.passes[-1].mismatch_max_nms > AGREEMENT_NMS:
        fixed_problem = replace(problem, sequence=plan.sequence, durations=None, placements=None)
        new_plan = solve(replace(fixed_problem, limbs_nm=limb_rates_nm(fixed_problem, best.motion)))
        if not new_plan.converged:
            break
        try:
            motion = follow(
                robot, new_plan.sequence, new_plan, _progress_of_pass(progress, len(best.passes), max_passes)
            )
        except WholeBodyStopped:  # the plan before could be followed
            break
        result = _compare_momenta(new_plan, motion)
        improved = result.mismatch_max_nms < best.passes[-1].mismatch_max_nms
        converging = result.mismatch_max_nms < MAX_REMAINING_SHARE * best.passes[-1].mismatch_max_nms
        best = (
            Agreement(new_plan, motion, (*best.passes, result))
            if improved
            else replace(best, passes=(*best.passes, result))
        )
        if not converging:
            break
    return best


def limb_rates_nm(problem: CentroidalProblem, motion: WholeBodyMotion) -> Float[np.ndarray, "m 3"]:
    """Mean rates of the body's angular momentum between the problem's ``limb_times_s``.

    For splines, which sample them every 15 to 35 ms, they are smoothed by a Hann window: compensating every jerk of a
    landing leg would excite others.
    """
    time_s, l_nms = problem.limb_times_s(), motion.l_nms
    if problem.shape == "cubic":
        window = hann(round(SMOOTHING_WINDOW_S * motion.rate_hz) + 2)[1:-1]
        l_nms = convolve1d(l_nms, window / window.sum(), axis=0, mode="nearest")
    at_times = np.array([np.interp(time_s, motion.time_s, l) for l in l_nms.T]).T
    return np.asarray(np.diff(at_times, axis=0) / np.diff(time_s)[:, None])


def _progress_of_pass(progress: Progress | None, done: int, most: int) -> Progress | None:
    """Progress of one pass after ``done`` of at most ``most``."""
    return None if progress is None else lambda fraction, message: progress((done + fraction) / most, message)


def _compare_momenta(plan: CentroidalPlan, motion: WholeBodyMotion) -> Pass:
    mismatch = np.linalg.norm(motion.l_nms - motion.l_reference_nms, axis=1)
    return Pass(float(mismatch.max()), float(np.sqrt(np.mean(mismatch**2))), plan.solve_time_s)
