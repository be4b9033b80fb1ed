"""Footholds on a terrain: where a whole sole stands on level surfaces, and at which height."""

import numpy as np
from jaxtyping import Float

from stridelab.contacts.terrain import Terrain

_LEVEL_COSINE = 0.9998
"""Cosine of the largest tilt of a surface that counts as level, 1.1 degrees."""
_SAME_HEIGHT_M = 2e-3


class Footholds:
    """Heights of the level upper faces of a terrain's boxes."""

    def __init__(self, terrain: Terrain) -> None:
        level = [box for box in terrain.boxes if box.placement.rotation[2, 2] > _LEVEL_COSINE]
        self._middle_m = np.array([box.placement.position_m[:2] for box in level]).reshape(-1, 2)
        self._axes = np.array([box.placement.rotation[:2, :2] for box in level]).reshape(-1, 2, 2)
        self._half_m = np.array([box.size_m[:2] / 2.0 for box in level]).reshape(-1, 2)
        self._top_m = np.array([box.placement.position_m[2] + box.size_m[2] / 2.0 for box in level])

    def ground_heights_m(self, points_m: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Height of the highest face below each point; ``-inf`` beside all of them."""
        if not len(self._top_m):
            return np.full(points_m.shape[:-1], -np.inf)
        local = np.einsum("...bi,bij->...bj", points_m[..., None, :] - self._middle_m, self._axes)
        inside = (np.abs(local) <= self._half_m).all(axis=-1)
        return np.asarray(np.where(inside, self._top_m, -np.inf).max(axis=-1))

    def sole_heights_m(
        self, centres_m: Float[np.ndarray, "*n 2"], corners_m: Float[np.ndarray, "4 2"]
    ) -> Float[np.ndarray, "*n"]:
        """Height at which a sole with these corners about its centre stands on one level; NaN where it does not."""
        heights = self.ground_heights_m(centres_m[..., None, :] + corners_m)
        low, high = heights.min(axis=-1), heights.max(axis=-1)
        with np.errstate(invalid="ignore"):
            stands = np.isfinite(low) & (high - low < _SAME_HEIGHT_M)
        return np.asarray(np.where(stands, high, np.nan))

    def highest_m(
        self, start_m: Float[np.ndarray, "2"], end_m: Float[np.ndarray, "2"], corners_m: Float[np.ndarray, "4 2"]
    ) -> float:
        """Highest face below a sole that moves straight from one place to another."""
        shares = np.linspace(0.0, 1.0, 9)[:, None, None]
        path = start_m + shares * (end_m - start_m) + np.concatenate([corners_m, np.zeros((1, 2))])
        return float(self.ground_heights_m(path).max())
