"""Level sets of a mixture as surfaces that enclose a given share of its mass.

    V_m = {c : p(c) >= t_m}        P_p(V_m) = m        |V_m| = E_p[1 / p(c) ; c in V_m]

The threshold ``t_m`` is the ``(1 - m)`` quantile of ``p`` over draws from the mixture, which gives the smallest set of
mass ``m`` (Hyndman 1996, "Computing and graphing highest density regions"). The volume is the mean over the same draws
and does not depend on the grid. Marching cubes (Lorensen and Cline 1987) computes the surface from ``log p``, which is
closer to quadratic between grid points than ``p``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from skimage.measure import marching_cubes

from stridelab.conventions import Points
from stridelab.errors import Fault, InvalidInput
from stridelab.reachability.gaussian_mixture import Mixture

MASSES: Final = (0.5, 0.8, 0.95)
DRAWS: Final = 20_000
"""Gives the mass within 0.4 percent and the volume within about 1 percent."""
CELLS: Final = 20
"""Cells along the longest edge of the grid: some 1500 triangles per surface."""
MARGIN: Final = 0.06
"""Margin of the grid around the draws inside, relative to their extent; surfaces must close."""


@dataclass(frozen=True, eq=False)
class LevelSet:
    """A closed surface, outwards counterclockwise: ``vertices_m`` ``(n, 3)``, ``triangles`` ``(m, 3)``.

    It may have several pieces. ``log_density`` (nats, per m^3) is the threshold, ``volume_m3`` that of the set.
    """

    mass: float
    log_density: float
    vertices_m: Points
    triangles: Int[np.ndarray, "m 3"]
    volume_m3: float


def level_sets(mixture: Mixture, masses: Sequence[float] = MASSES, seed: int = 0) -> tuple[LevelSet, ...]:
    """The level sets of ``mixture`` that contain ``masses``, in its frame.

    Raises ``InvalidInput`` (``mass-out-of-range``) for a mass outside (0, 1).
    """
    wrong = [Fault("masses", f"{mass:g} is not between 0 and 1") for mass in masses if not 0.0 < mass < 1.0]
    if wrong:
        raise InvalidInput("mass-out-of-range", "The mass of a level set must lie between 0 and 1.", wrong)
    draws_m = mixture.sample(DRAWS, np.random.default_rng(seed))
    log_p = mixture.log_density(draws_m)
    return tuple(_level_set(mixture, mass, draws_m, log_p) for mass in masses)


def _level_set(mixture: Mixture, mass: float, draws_m: Points, log_p: Float[np.ndarray, "n"]) -> LevelSet:
    threshold = float(np.quantile(log_p, 1.0 - mass))
    is_inside = log_p >= threshold
    inside = draws_m[is_inside]
    low, high = inside.min(axis=0), inside.max(axis=0)
    margin = MARGIN * (high - low).max()
    low, high = low - margin, high + margin
    step_m = (high - low).max() / CELLS
    counts = np.ceil((high - low) / step_m).astype(int) + 1
    axes = [low[i] + step_m * np.arange(counts[i]) for i in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = mixture.log_density(grid.reshape(-1, 3)).reshape(counts)
    vertices, triangles, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
        values, threshold, spacing=(step_m,) * 3, gradient_direction="ascent"
    )
    vertices_m = np.asarray(vertices, dtype=float) + low
    volume_m3 = float(np.exp(-log_p[is_inside]).sum() / len(log_p))
    return LevelSet(mass, threshold, vertices_m, np.asarray(triangles, dtype=np.int64), volume_m3)
