"""Time windows of a quick or high swing: the gentlest among those whose sole clears the terrain.

The usual windows lift a sole to the top of its curve before the middle of the swing. A sole that climbs two treads in a
second is then accelerated with more than its weight, and the momentum of the leg is more than the soles on the ground
can absorb. Above ``GENTLE_M_S2`` the windows are chosen among ``CANDIDATES``: those of the smallest peak acceleration
for which

* an eighth of the swing from either end the sole is ``LEAVES_M`` above the contact that it leaves or approaches, as
  with the usual windows, and
* in between no point of a shoe, ``SHOE_SHARES`` times as large as its contact rectangle, comes closer than ``NEAR_M``
  to a box (``LEAVES_M`` to those that carry its contacts), or than with the usual windows.
"""

from collections.abc import Collection
from functools import cache
from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.effector_geometry import sole_points_m
from stridelab.contacts.swing import LEAVES_M, Profile, SwingCurve, quintic_scaling
from stridelab.contacts.terrain import Box, Terrain
from stridelab.conventions import Points

GENTLE_M_S2: Final = 5.0
NEAR_M: Final = 0.02
SHOE_SHARES: Final = (1.17, 1.15)
UP_ENDS: Final = (0.40, 0.48, 0.56, 0.64, 0.72)
DOWN_STARTS: Final = (0.60, 0.52, 0.44, 0.36)
MOVES: Final = tuple(product((0.18, 0.12, 0.06), (0.80, 0.86, 0.92)))
CANDIDATES: Final = tuple(
    Profile((0.0, up), move, (down, 1.0)) for up, down, move in product(UP_ENDS, DOWN_STARTS, MOVES)
)
_SHARES: Final = np.linspace(0.0, 1.0, 41)
_INNER: Final = slice(5, 36)
"""The middle three quarters of ``_SHARES``; its ends lie an eighth of the swing from either end."""
_AROUND_M: Final = 0.3

Scalings = Float[np.ndarray, "n t 3"]


def gentle_windows(
    curve: SwingCurve, half_size_m: tuple[float, float], terrain: Terrain, carriers: Collection[str]
) -> Profile:
    """The windows of ``curve``, or gentler ones if its acceleration exceeds ``GENTLE_M_S2``.

    ``half_size_m`` are the half edges of the sole's rectangle, ``carriers`` the surfaces of its two contacts.
    """
    given: Profile = curve.profile
    usual = (given,)
    peak = float(_peaks_m_s2(curve, usual)[0])
    if peak <= GENTLE_M_S2:
        return given
    x, y = half_size_m
    shoe = sole_points_m((SHOE_SHARES[0] * x, SHOE_SHARES[1] * y))
    boxes = _boxes_near(curve, terrain)
    limits = np.array([LEAVES_M if box.name in carriers else NEAR_M for box in boxes])
    required = np.minimum(limits, _clearances_m(curve, usual, 0, shoe, boxes))
    peaks = _peaks_m_s2(curve, CANDIDATES)
    for k in np.argsort(peaks, kind="stable").tolist():
        if peaks[k] >= peak:
            break
        if _leaves_in_time(curve, k) and (_clearances_m(curve, CANDIDATES, k, shoe, boxes) >= required).all():
            gentler: Profile = CANDIDATES[k]
            return gentler
    return given


@cache
def _scalings(windows: tuple[Profile, ...]) -> tuple[Scalings, Scalings]:
    """Scalings of rise, travel and descent at ``_SHARES``, and their second derivatives by the share."""
    values = np.array(
        [[[quintic_scaling(u, window, 1.0) for window in one] for u in _SHARES.tolist()] for one in windows]
    )
    return values[..., 0], values[..., 2]


def _peaks_m_s2(curve: SwingCurve, windows: tuple[Profile, ...]) -> Float[np.ndarray, "n"]:
    a = _scalings(windows)[1] @ curve.parts_m
    return np.asarray(np.linalg.norm(a, axis=2).max(axis=1) / curve.duration_s**2)


def _leaves_in_time(curve: SwingCurve, k: int) -> bool:
    """Whether the sole is ``LEAVES_M`` above its contacts an eighth of the swing from either end."""
    travelled = _scalings(CANDIDATES)[0][k, [_INNER.start, _INNER.stop - 1]] @ curve.parts_m
    from_end = travelled[1] - (curve.end.position_m - curve.start.position_m)
    return min(
        float(curve.start.rotation[:, 2] @ travelled[0]), float(curve.end.rotation[:, 2] @ from_end)
    ) >= LEAVES_M  # fmt: skip


def _boxes_near(curve: SwingCurve, terrain: Terrain) -> list[Box]:
    """Boxes near the swing, as long as they are higher than the lower of its contacts."""
    ends = np.array([curve.start.position_m, curve.end.position_m])
    low, high = ends.min(axis=0) - _AROUND_M, ends.max(axis=0) + _AROUND_M
    low_m, high_m = terrain.box_bounds_m
    near = (low_m <= high).all(axis=1) & (high_m >= low).all(axis=1) & (high_m[:, 2] > ends[:, 2].min())
    return [terrain.boxes[k] for k in np.flatnonzero(near)]


def _clearances_m(
    curve: SwingCurve, windows: tuple[Profile, ...], k: int, shoe: Points, boxes: list[Box]
) -> Float[np.ndarray, "boxes"]:
    """Smallest distance of the shoe's points from every box in the middle three quarters of the swing."""
    s = _scalings(windows)[0][k, _INNER]
    positions = curve.start.position_m + s @ curve.parts_m
    points = positions[:, None] + np.einsum("tij,kj->tki", curve.rotations_at(s[:, 1]), shoe)
    return np.array([_distances_m(box, points.reshape(-1, 3)).min() for box in boxes])


def _distances_m(box: Box, points: Points) -> Float[np.ndarray, "n"]:
    """Signed distances of points from a box."""
    outside = np.abs((points - box.placement.position_m) @ box.placement.rotation) - 0.5 * np.asarray(box.size_m)
    away_m = np.linalg.norm(np.maximum(outside, 0.0), axis=1)
    return np.asarray(away_m + np.minimum(outside.max(axis=1), 0.0))
