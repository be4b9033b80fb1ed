"""Footholds: whole soles on one level surface, and what a sole passes over."""

import numpy as np
import pytest

from stridelab.contacts.terrain import Box, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.wholebody.recovery.footholds import Footholds

SOLE_M = np.array([[0.1, 0.06], [-0.1, 0.06], [-0.1, -0.06], [0.1, -0.06]])


def box(name: str, x_m: tuple[float, float], top_m: float, tilt_rad: float = 0.0) -> Box:
    wxyz = [np.cos(tilt_rad / 2), 0.0, np.sin(tilt_rad / 2), 0.0]
    placement = Placement.from_wxyz([(x_m[0] + x_m[1]) / 2, 0.0, top_m - 0.5], wxyz)
    return Box(name, placement, np.array([x_m[1] - x_m[0], 2.0, 1.0]))


def steps() -> Footholds:
    """Ground from -1 to 2 m, a step of 0.1 m from 0.5 to 2 m, nothing beyond."""
    return Footholds(Terrain((box("ground", (-1.0, 2.0), 0.0), box("step", (0.5, 2.0), 0.1))))


@pytest.mark.parametrize(
    ("x", "height_m"),
    [(0.0, 0.0), (0.39, 0.0), (0.41, np.nan), (0.59, np.nan), (0.61, 0.1), (1.95, np.nan), (3.0, np.nan)],
)
def test_a_whole_sole_stands_on_one_surface_or_not_at_all(x: float, height_m: float) -> None:
    assert steps().sole_heights_m(np.array([[x, 0.0]]), SOLE_M)[0] == pytest.approx(height_m, nan_ok=True)


def test_tilted_surfaces_are_no_footholds() -> None:
    tilted = Footholds(Terrain((box("ramp", (-1.0, 1.0), 0.0, tilt_rad=0.1),)))
    assert np.isnan(tilted.sole_heights_m(np.zeros((1, 2)), SOLE_M)).all()


def test_the_highest_surface_below_a_swing_counts() -> None:
    assert steps().highest_m(np.array([-0.5, 0.0]), np.array([0.2, 0.0]), SOLE_M) == 0.0
    assert steps().highest_m(np.array([-0.5, 0.0]), np.array([0.45, 0.0]), SOLE_M) == pytest.approx(0.1)
