"""Projections of the kernel density and of the mixture along one axis (figures 4.2 and 4.4).

    p(x, y) = int p(x, y, z) dz

The projection of a Gaussian mixture is the mixture of its projected Gaussians: the entries of the axis are removed from
means and covariances. An isotropic kernel keeps its bandwidth. Both are exact.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.kde import KernelDensity

CELLS: Final = 64
"""Grid points along the longest of the three axes."""
TAILS: Final = (0.1, 99.9)
"""Percentiles of the kernel centres that the grid covers."""
MARGIN_BANDWIDTHS: Final = 3.0
"""Margin of the grid in bandwidths."""
PLOT_AXES: Final = ((1, 2), (0, 2), (0, 1))
"""Horizontal and vertical axes of a projection along x, y and z."""

Map = Float[np.ndarray, "up right"]


@dataclass(frozen=True, eq=False)
class Grid:
    """Points ``low_m + step_m * k`` along each axis, ``counts`` of them; the same step on all three."""

    low_m: Float[np.ndarray, "3"]
    step_m: float
    counts: tuple[int, int, int]

    def axis_m(self, axis: int) -> Float[np.ndarray, "n"]:
        """The points along ``axis``."""
        return np.asarray(self.low_m[axis] + self.step_m * np.arange(self.counts[axis]))


def grid_around(kernels: KernelDensity) -> Grid:
    """A grid that covers all but the outermost kernels."""
    low, high = np.percentile(kernels.centres_m, TAILS, axis=0)
    low, high = low - MARGIN_BANDWIDTHS * kernels.bandwidth_m, high + MARGIN_BANDWIDTHS * kernels.bandwidth_m
    step_m = float((high - low).max() / (CELLS - 1))
    nx, ny, nz = (int(n) for n in np.ceil((high - low) / step_m - 1e-9).astype(int) + 1)
    return Grid(low, step_m, (nx, ny, nz))


def project_kernels(kernels: KernelDensity, grid: Grid, along: int) -> Map:
    """The kernel density (per m^2) projected along axis ``along``: rows go up, columns to the right (``PLOT_AXES``)."""
    right, up = PLOT_AXES[along]
    h = kernels.bandwidth_m

    def kernel_values(axis: int) -> Float[np.ndarray, "points kernels"]:
        z = (grid.axis_m(axis)[:, None] - kernels.centres_m[:, axis]) / h
        return np.asarray(np.exp(-0.5 * z**2) / (np.sqrt(2 * np.pi) * h))

    return np.asarray(kernel_values(up) @ kernel_values(right).T / len(kernels.centres_m))


def project_mixture(mixture: Mixture, grid: Grid, along: int) -> Map:
    """The mixture (per m^2) projected along axis ``along``, as ``project_kernels``."""
    right, up = PLOT_AXES[along]
    u, v = np.meshgrid(grid.axis_m(right), grid.axis_m(up))
    points = np.stack([u, v], axis=-1)
    density = np.zeros(u.shape)
    for w, mu, S in zip(mixture.weights, mixture.means_m, mixture.covariances_m2, strict=True):
        flat = S[np.ix_((right, up), (right, up))]
        d = points - mu[[right, up]]
        square = np.einsum("ija,ab,ijb->ij", d, np.linalg.inv(flat), d)
        density += w * np.exp(-0.5 * square) / (2 * np.pi * np.sqrt(np.linalg.det(flat)))
    return density
