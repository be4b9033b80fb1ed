"""Finds plates that repeat the force of others: virtual plates of a treadmill beside the real ones.

Some programs write the force of a treadmill several times: as that of its belts, of the left and the right foot, and of
both together. Their sum would be a multiple of the force on the body. Real plates do not lie over each other. Let the
plates S be some of the loaded ones, and each of the others, R, lie with half of its area on one of S, or one of S with
half of its area on it; the contacts of a force file have no place of their own. If for a whole number k >= 1

    | sum_R f - k sum_S f |  <=  0.1 k | sum_S f |   and   | p_R - p_S |  <=  3 cm

with the centres of pressure p at three quarters of the samples above 100 N, R repeats S k times and is not used. Of
several such S the one with the fewest plates over each other is used, of those the one with the largest area.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from stridelab.recordings.files.raw import CONTACT_TYPE
from stridelab.recordings.force_plates import plate_axes
from stridelab.recordings.recording import Plate, Remark

_OVER_SHARE: Final = 0.5
_APART_SHARE, _SAME_SHARE = 0.1, 0.75
_APART_M, _HEAVY_N = 0.03, 100.0
_MOST_PLATES: Final = 12
_GRID: Final = 9
"""Points per side of a plate that are looked up on another."""


def without_repeated(plates: Sequence[Plate]) -> tuple[tuple[Plate, ...], tuple[Remark, ...]]:
    """The plates with those that repeat others out of use, and a remark that names them."""
    loaded = [i for i, plate in enumerate(plates) if plate.use and plate.loaded.any()]
    over = {(i, j) for i, j in itertools.permutations(loaded, 2) if _share_over(plates[i], plates[j]) > _OVER_SHARE}
    placeless = any(plates[i].type == CONTACT_TYPE for i in loaded)
    if not (over or placeless) or len(loaded) > _MOST_PLATES:
        return tuple(plates), ()
    choices = [
        chosen
        for n in range(1, len(loaded) // 2 + 1)
        for chosen in itertools.combinations(loaded, n)
        if _repeats(plates, chosen, [i for i in loaded if i not in chosen], over)
    ]
    if not choices:
        return tuple(plates), ()

    def rank(chosen: tuple[int, ...]) -> tuple[int, float]:
        n_over = sum(pair in over for pair in itertools.permutations(chosen, 2))
        return n_over, -sum(_area_m2(plates[i]) for i in chosen)

    best = min(choices, key=rank)
    repeated = [plates[i].index for i in loaded if i not in best]
    names = ", ".join(str(index) for index in repeated)
    kept = ", ".join(str(plates[i].index) for i in best)
    message = f"Plates {names} lie over plates {kept} and repeat their force; they are not used."
    used = tuple(replace(plate, use=plate.use and plate.index not in repeated) for plate in plates)
    return used, (Remark("plates-repeated", message),)


def _repeats(plates: Sequence[Plate], chosen: Sequence[int], others: Sequence[int], over: set[tuple[int, int]]) -> bool:
    """Whether the ``others`` lie over the ``chosen`` plates and measure a multiple of their force at all times."""
    placed = [i for i in others if plates[i].type != CONTACT_TYPE]
    if not others or not all(any(over & {(i, j), (j, i)} for j in chosen) for i in placed):
        return False
    one, more = (np.sum([plates[i].force_n for i in group], axis=0) for group in (chosen, others))
    one_nm, more_nm = (np.sum([plates[i].moment_nm for i in group], axis=0) for group in (chosen, others))
    heavy = one[:, 2] > _HEAVY_N
    one, more, one_nm, more_nm = one[heavy], more[heavy], one_nm[heavy, :2], more_nm[heavy, :2]
    if len(one) == 0:
        return False
    k = round(float(np.median((one * more).sum(axis=1) / (one * one).sum(axis=1))))
    if k < 1:
        return False
    same = np.linalg.norm(more - k * one, axis=1) <= _APART_SHARE * k * np.linalg.norm(one, axis=1)
    same &= np.linalg.norm(more_nm / k - one_nm, axis=1) <= _APART_M * one[:, 2]
    return float(np.mean(same)) >= _SAME_SHARE


def _area_m2(plate: Plate) -> float:
    c1, c2, _, c4 = plate.corners_m
    return float(np.linalg.norm(np.cross(c2 - c1, c4 - c1)))


def _share_over(plate: Plate, other: Plate) -> float:
    """Share of the area of ``plate`` that lies over or under ``other``."""
    a, b = np.meshgrid(*[(np.arange(_GRID) + 0.5) / _GRID] * 2)
    c1, c2, c3, c4 = plate.corners_m
    a, b = a.reshape(-1, 1), b.reshape(-1, 1)
    points = (1.0 - a) * ((1.0 - b) * c1 + b * c4) + a * ((1.0 - b) * c2 + b * c3)
    local = (points - other.corners_m.mean(axis=0)) @ plate_axes(other.corners_m)
    half = [np.linalg.norm(other.corners_m[0] - other.corners_m[i]) / 2.0 for i in (1, 3)]
    return float(np.mean((np.abs(local[:, 0]) <= half[0]) & (np.abs(local[:, 1]) <= half[1])))
