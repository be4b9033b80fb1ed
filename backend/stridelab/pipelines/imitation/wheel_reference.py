"""The person's rolling wheel as a reference acceleration of the robot's CoM.

The wheel of (3.1), (3.2) turns once per step at a constant rate (3.4), omega = 2 pi / T, so that

    x'' = s r omega^2 sin(theta),    z'' = r omega^2 cos(theta),    theta = 2 pi (u - u_0)

with u the share of the step, from a lift-off to the next, and u_0 that at the lowest point. The person's steps give
r / R, the mean over the steps, and u_0; the robot's R follows from its own step, R = L / (2 pi). s = +1 is the thesis'
wheel, whose point is slowest at the lowest point; s = -1 is the one that people's timing follows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.problem import CentroidalProblem
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Points, Series
from stridelab.measures.walk_motion import AHEAD, UP
from stridelab.pipelines.imitation.robot_motion import FROM_REST, TO_REST
from stridelab.walking.curtate_cycloid import FULL_TURN_RAD, Branch
from stridelab.walking.step_fit import StepFit
from stridelab.walking.timed_fit import fit_in_time

BRANCHES: Final[tuple[Branch, ...]] = (1, -1)


@dataclass(frozen=True)
class RollingWheel:
    """Wheel of a walk that turns once per step: r / R, and the share of the step at its lowest point."""

    branch: Branch
    ratio: float
    lowest_share: float

    def accelerations_m_s2(self, sequence: ContactSequence, times_s: Series) -> Float[np.ndarray, "m 3"]:
        """Mean accelerations between ``times_s`` (n,) in the steady steps of a walk along x, else zero: (n - 1, 3).

        A mean is the difference of the wheel's velocity against that of its hub over the length of the interval.
        """
        mean: Float[np.ndarray, "m 3"] = np.zeros((len(times_s) - 1, 3))
        begin, end = times_s[:-1], times_s[1:]
        middle_s = 0.5 * (begin + end)
        for start_s, end_s, length_m in steady_spans(sequence):
            inside = (middle_s >= start_s) & (middle_s < end_s)
            omega, r_m = FULL_TURN_RAD / (end_s - start_s), self.ratio * length_m / FULL_TURN_RAD
            before, after = (
                self._velocity_m_s((at[inside] - start_s) / (end_s - start_s), omega, r_m) for at in (begin, end)
            )
            mean[inside] = (after - before) / (end - begin)[inside, None]
        return mean

    def change(self, problem: CentroidalProblem) -> CentroidalProblem:
        """The problem with the wheel's acceleration as reference."""
        times_s = problem.limb_times_s()
        return replace(problem, reference_m_s2=self.accelerations_m_s2(problem.sequence, times_s))

    def _velocity_m_s(self, share: Series, omega_rad_s: float, r_m: float) -> Points:
        theta = FULL_TURN_RAD * (share - self.lowest_share)
        velocity = np.zeros((len(share), 3))
        velocity[:, AHEAD] = -self.branch * r_m * omega_rad_s * np.cos(theta)
        velocity[:, UP] = r_m * omega_rad_s * np.sin(theta)
        return velocity


def steady_spans(sequence: ContactSequence) -> list[tuple[float, float, float]]:
    """Start and end (s) of each steady step, from a lift-off to the next, and the advance (m) of the feet's middle."""
    swings = [k for k, phase in enumerate(sequence.phases) if len(phase.contacts) == 1]
    spans = []
    for index in range(FROM_REST, len(swings) - TO_REST):
        k, later = swings[index], swings[index + 1]
        start_m, end_m = (_middle_ahead_m(sequence, at) for at in (k - 1, later - 1))
        spans.append((float(sequence.starts_s[k]), float(sequence.starts_s[later]), end_m - start_m))
    return spans


def rolling_wheel(fits: Sequence[StepFit], branch: Branch) -> RollingWheel:
    """The wheel of the steps of a person, of which at least one is needed."""
    ratios, lowest = [], []
    for fit in fits:
        span_s = fit.step.end_s - fit.step.start_s
        timed = fit_in_time(fit.time_s, fit.path_m, span_s, branch, one_turn_per_step=True)
        ratios.append(timed.wheel.r_m / timed.wheel.R_m)
        first = (fit.time_s[0] - fit.step.start_s) / span_s
        lowest.append(first - timed.theta0_rad / FULL_TURN_RAD)
    angle = np.angle(np.mean(np.exp(1j * FULL_TURN_RAD * np.array(lowest))))
    return RollingWheel(branch, float(np.mean(ratios)), float(angle / FULL_TURN_RAD % 1.0))


def _middle_ahead_m(sequence: ContactSequence, phase: int) -> float:
    places: Float[np.ndarray, "k"] = np.array(
        [contact.placement.position_m[AHEAD] for contact in sequence.phases[phase].contacts.values()]
    )
    return float(places.mean())
