"""Where things stand in the vector of variables."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from stridelab.centroidal.cone import N_RAYS
from stridelab.centroidal.dynamics import N_STATE, N_WRENCH
from stridelab.centroidal.problem import CentroidalProblem, Grid


@dataclass(frozen=True, eq=False)
class Layout:
    """Interval by interval: state ``x_k``, ray lengths ``lambda_k``, wrench ``(F, T)_k``; ``x_N`` at the end.

    ``n`` variables; ``state`` ``(nodes,)`` and ``wrench`` ``(intervals,)`` are first indices; ``ray[effector]`` maps an
    interval in which it touches to the first of its ``N_RAYS`` lengths per point.
    """

    n: int
    state: Int[np.ndarray, "nodes"]
    wrench: Int[np.ndarray, "intervals"]
    ray: Mapping[str, Mapping[int, int]]


def lay_out(problem: CentroidalProblem, grid: Grid) -> Layout:
    """The layout of a problem on its grid."""
    n, state, wrench = 0, [], []
    ray: dict[str, dict[int, int]] = {name: {} for name in problem.sequence.effectors}
    for k, phase in enumerate(grid.phase):
        state.append(n)
        n += N_STATE
        for name in problem.sequence.phases[int(phase)].contacts:
            ray[name][k] = n
            n += N_RAYS * len(problem.points_m(name))
        wrench.append(n)
        n += N_WRENCH
    return Layout(n + N_STATE, np.array([*state, n]), np.array(wrench), ray)
