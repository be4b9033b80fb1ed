"""The minimum-jerk CoM: (4.20) with the cost ``|c'''|^2``, without angular momentum and without cone constraints.

After Perrin et al. (2015), as described in section 4.7: L_c is zero by construction, (4.9c) is assumed but not
checked, and the end is viable because the jerk is small. Of all motions through given points at given times,

    min int |c'''|^2 dt      =>      c^(6) = 0 between the points, c to c'''' continuous at them

a quintic spline. Between two nodes it is the quintic Hermite polynomial of their positions, velocities and
accelerations; its cost is quadratic in these, so that the free ones solve one linear system. ``margins_n`` checks the
assumption afterwards: it returns the margin of the contacts for the wrench of the motion.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.contact_wrench import point_contacts
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.contacts.wrench_cones.wrench_feasibility import conic_margin
from stridelab.conventions import Points, Series, Vector3, g
from stridelab.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class MinimumJerk:
    """The spline: nodes in time and ``(n, 3)`` positions, velocities and accelerations there."""

    time_s: Series
    com_m: Points
    velocity_m_s: Points
    acceleration_m_s2: Points

    @staticmethod
    def through_points(time_s: Series, com_m: Points) -> "MinimumJerk":
        """Spline through the points ``com_m``, from rest at the first to rest at the last.

        Raises ``InvalidInput`` (``minimum-jerk-invalid``) unless there are at least two points and times ascend.
        """
        if len(time_s) < 2 or not (np.diff(time_s) > 0.0).all():
            raise InvalidInput("minimum-jerk-invalid", "A motion needs at least two points at ascending times.")
        n = len(time_s)
        H = np.zeros((3 * n, 3 * n))
        for k, h in enumerate(np.diff(time_s)):
            scale = np.tile([1.0, h, h * h], 2)
            H[3 * k : 3 * k + 6, 3 * k : 3 * k + 6] += _JERK_COST * np.outer(scale, scale) / h**5
        fixed = np.array([*(3 * np.arange(n)), 1, 2, 3 * n - 2, 3 * n - 1])
        free = np.setdiff1d(np.arange(3 * n), fixed)
        w = np.zeros((3 * n, 3))
        w[0::3] = com_m
        if len(free):
            w[free] = np.linalg.solve(H[np.ix_(free, free)], -H[free][:, fixed] @ w[fixed])
        return MinimumJerk(time_s, w[0::3], w[1::3], w[2::3])

    def evaluate_at(self, time_s: Series, derivative: int = 0) -> Points:
        """Position (m) or its ``derivative`` up to the fifth, ``(m, 3)``; constant before and after the motion."""
        k = np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, len(self.time_s) - 2)
        h = np.diff(self.time_s)[k]
        tau = np.clip((time_s - self.time_s[k]) / h, 0.0, 1.0)
        ends = np.stack(
            [values[k + j] for j in (0, 1) for values in (self.com_m, self.velocity_m_s, self.acceleration_m_s2)]
        )
        ends = ends * np.stack([np.ones_like(h), h, h * h] * 2)[:, :, np.newaxis]
        powers = np.array([_power_derivative(tau, p, derivative) for p in range(6)])
        return np.asarray(np.einsum("pm,pe,emx->mx", powers, _HERMITE, ends) / (h**derivative)[:, np.newaxis])

    @property
    def cost(self) -> float:
        """``int |c'''|^2 dt`` in m^2/s^5."""
        total = 0.0
        for k, h in enumerate(np.diff(self.time_s)):
            scale = np.tile([1.0, h, h * h], 2)
            ends = np.vstack(
                [values[k + j] for j in (0, 1) for values in (self.com_m, self.velocity_m_s, self.acceleration_m_s2)]
            )
            y = scale[:, np.newaxis] * ends
            total += float(np.einsum("ex,ef,fx->", y, _JERK_COST, y)) / h**5
        return total


def through_supports(problem: CentroidalProblem, height_m: float) -> MinimumJerk:
    """Spline through points ``height_m`` above the mean contact point, at mid-time of every phase but first and last.

    The first and the last point are those of the problem. Raises ``InvalidInput`` (``minimum-jerk-invalid``) for a
    phase without contacts.
    """
    phases, starts = problem.sequence.phases, problem.sequence.starts_s
    if not all(phase.contacts for phase in phases):
        raise InvalidInput("minimum-jerk-invalid", "Every phase needs a contact to pass over.")
    times = [0.0, *(starts[i] + phases[i].duration_s / 2.0 for i in range(1, len(phases) - 1)), starts[-1]]
    times[-1] = problem.sequence.duration_s
    points_m = [problem.com_start_m, *(_middle_m(problem, i, height_m) for i in range(1, len(phases) - 1))]
    return MinimumJerk.through_points(np.array(times), np.array([*points_m, problem.com_end_m]))


def margins_n(problem: CentroidalProblem, motion: MinimumJerk, time_s: Series) -> Series:
    """Margin (N) of the contacts for the wrench of the motion at every time; negative where it is infeasible."""
    com, acceleration = motion.evaluate_at(time_s), motion.evaluate_at(time_s, 2)
    margins = np.empty(len(time_s))
    for k, t in enumerate(time_s):
        force = problem.mass_kg * (acceleration[k] - g)
        wrench = np.concatenate([force, np.cross(com[k], force)])
        patches = problem.contact_patches(problem.sequence.phase_at(float(t)), np.zeros(3))
        margins[k] = conic_margin(point_contacts(patches), wrench).margin_n
    return margins


def _middle_m(problem: CentroidalProblem, phase: int, height_m: float) -> Vector3:
    points = np.vstack([patch.points_m for patch in problem.contact_patches(phase, np.zeros(3))])
    return np.asarray(points.mean(axis=0) + np.array([0.0, 0.0, height_m]))


def _power_derivative(tau: Series, p: int, derivative: int) -> Series:
    """``d^derivative / d tau^derivative`` of ``tau^p``."""
    factor = np.prod(np.arange(p - derivative + 1, p + 1)) if p >= derivative else 0.0
    return np.asarray(factor * tau ** max(0, p - derivative))


def _hermite_coefficients() -> Float[np.ndarray, "6 6"]:
    """Coefficients (powers by ends) of the quintic with given (c, h c', h^2 c'') at both ends."""
    ends = np.array([0.0, 1.0])
    rows = np.array([[_power_derivative(ends, p, derivative) for p in range(6)] for derivative in range(3)])
    return np.linalg.inv(np.concatenate([rows[..., 0], rows[..., 1]]))


def _jerk_cost() -> Float[np.ndarray, "6 6"]:
    """``int_0^1 (d3 c / d tau3)^2`` as a quadratic form of the ends."""
    third = [float(p * (p - 1) * (p - 2)) for p in range(6)]
    gram = np.array(
        [[third[p] * third[q] / (p + q - 5) if p >= 3 and q >= 3 else 0.0 for q in range(6)] for p in range(6)]
    )
    return np.asarray(_HERMITE.T @ gram @ _HERMITE)


_HERMITE = _hermite_coefficients()
_JERK_COST = _jerk_cost()
