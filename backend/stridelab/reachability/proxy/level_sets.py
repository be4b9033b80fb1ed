"""Level sets of a mixture as surfaces: where the density is at least what it is around a share of its mass.

    V_m = {c : p(c) >= t_m}        P_p(V_m) = m        |V_m| = E_p[1 / p(c) ; c in V_m]

The threshold ``t_m`` is the ``(1 - m)`` quantile of ``p`` over the mixture's own draws, so that the smallest volume
that holds the mass ``m`` is enclosed (Hyndman 1996, "Computing and graphing highest density regions"). The volume is
the mean over the same draws, which no grid makes coarse. The surface is found by marching cubes (Lorensen and Cline
1987) on ``log p``, which is nearly quadratic between grid points where ``p`` itself is not.
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
"""The mass inside is then known to 0.4 percent, the volume to about 1 percent."""
CELLS: Final = 20
"""Cells along the longest edge of the grid: some 1500 triangles per surface."""
MARGIN: Final = 0.06
"""How far the grid reaches beyond the draws inside, as a share of their extent: surfaces must close."""


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
    """The level sets that hold ``masses`` of ``mixture``, in its frame.

    Raises ``InvalidInput`` (``mass-out-of-range``) for a mass that is not inside (0, 1).
    """
    wrong = [Fault("masses", f"{mass:g} is not between 0 and 1") for mass in masses if not 0.0 < mass < 1.0]
    if wrong:
        raise InvalidInput("mass-out-of-range", "A level set holds a share of the mass between 0 and 1.", wrong)
    draws_m = mixture.sample(DRAWS, np.random.default_rng(seed))
    log_p = mixture.log_density(draws_m)
    return tuple(_level_set(mixture, mass, draws_m, log_p) for mass in masses)


def _level_set(mixture: Mixture, mass: float, draws_m: Points, log_p: Float[np.ndarray, "n"]) -> LevelSet:
    threshold = float(np.quantile(log_p, 1.0 - mass))
    there = log_p >= threshold
    inside = draws_m[there]
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
    volume_m3 = float(np.exp(-log_p[there]).sum() / len(log_p))
    return LevelSet(mass, threshold, vertices_m, np.asarray(triangles, dtype=np.int64), volume_m3)
