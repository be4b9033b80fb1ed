"""Checks that thigh and shank have constant length; needs markers only."""

import itertools
from collections.abc import Mapping
from typing import Final

import numpy as np

from stridelab.conventions import Points

LEG: Final = ("hip", "knee", "ankle")
_MIN_FRAMES = 10


def length_change(joint_centres_m: Mapping[str, Points]) -> tuple[str, float] | None:
    """The thigh or shank whose length changes most: its name, and its 5 to 95 % length range over the median.

    None if no segment of the legs has both of its joints in ten frames.
    """
    changes: list[tuple[float, str]] = []
    for side, (upper, lower) in itertools.product("lr", itertools.pairwise(LEG)):
        one, other = joint_centres_m.get(f"{side}_{upper}"), joint_centres_m.get(f"{side}_{lower}")
        if one is None or other is None:
            continue
        lengths = np.linalg.norm(one - other, axis=1)
        lengths = lengths[np.isfinite(lengths)]
        if len(lengths) < _MIN_FRAMES or np.median(lengths) <= 0.0:
            continue
        low, high = np.percentile(lengths, (5.0, 95.0))
        name = f"{'left' if side == 'l' else 'right'} {'thigh' if upper == 'hip' else 'shank'}"
        changes.append((float((high - low) / np.median(lengths)), name))
    if not changes:
        return None
    change, name = max(changes)
    return name, change
