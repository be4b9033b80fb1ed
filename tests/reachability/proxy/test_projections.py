"""Projections are integrals of the densities along an axis."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.kde import KernelDensity
from stridelab.reachability.proxy.projections import PLOT_AXES, Grid, grid_around, project_kernels, project_mixture

RNG = np.random.default_rng(3)
MIXTURE = Mixture(
    np.array([0.6, 0.4]),
    np.array([[0.1, -0.2, 0.8], [-0.2, 0.1, 0.6]]),
    np.array([np.diag([0.02, 0.01, 0.015]) + 0.005, np.diag([0.01, 0.02, 0.01])]),
)
KERNELS = KernelDensity(MIXTURE.sample(300, RNG), 0.05)
FINE_M = np.linspace(-2.0, 3.0, 801)


@pytest.mark.parametrize("along", [0, 1, 2])
@pytest.mark.parametrize("which", ["kernels", "mixture"])
def test_a_projection_is_the_integral_along_its_axis(along: int, which: str) -> None:
    """By the trapezoidal rule, which for smooth bells is exact to rounding."""
    grid = grid_around(KERNELS)
    drawn = project_kernels(KERNELS, grid, along) if which == "kernels" else project_mixture(MIXTURE, grid, along)
    right, up = PLOT_AXES[along]
    assert drawn.shape == (grid.counts[up], grid.counts[right])
    density = KERNELS if which == "kernels" else MIXTURE
    for row, column in ((10, 20), (25, 12), (30, 30)):
        line = np.zeros((len(FINE_M), 3))
        line[:, along] = FINE_M
        line[:, right], line[:, up] = grid.axis_m(right)[column], grid.axis_m(up)[row]
        expected = trapezoid(np.exp(density.log_density(line)), FINE_M)
        assert drawn[row, column] == pytest.approx(expected, rel=1e-9)


def test_a_picture_holds_nearly_all_and_its_cells_are_square() -> None:
    grid = grid_around(KERNELS)
    assert max(grid.counts) == 64
    for along in range(3):
        for drawn in (project_kernels(KERNELS, grid, along), project_mixture(MIXTURE, grid, along)):
            assert drawn.sum() * grid.step_m**2 == pytest.approx(1.0, abs=0.02)


def test_axes_run_from_their_low_end() -> None:
    grid = Grid(np.array([-1.0, 0.0, 2.0]), 0.5, (3, 2, 4))
    assert grid.axis_m(2).tolist() == [2.0, 2.5, 3.0, 3.5]
