"""Joint centres, and the directions in which the segments between them face."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from stridelab.conventions import Points

Tracks = Mapping[str, Points]
"""Points by name, all of one trial."""

SIGN: Final = {"l": -1.0, "r": 1.0}
"""Outwards on this side is ``SIGN`` times rightwards."""


@dataclass(frozen=True)
class Joints:
    """Joint centres (``l_hip``, ``lumbar``, ...) and, per segment, a vector that points roughly to its right.

    ``substitutes`` holds the codes of the substitutes that were used.
    """

    centres: Tracks
    rightward: Tracks
    substitutes: frozenset[str] = frozenset()

    def __or__(self, other: "Joints") -> "Joints":
        return Joints(
            {**self.centres, **other.centres},
            {**self.rightward, **other.rightward},
            self.substitutes | other.substitutes,
        )


def has(p: Tracks, *names: str) -> bool:
    """Whether all of these landmarks are there."""
    return set(names) <= p.keys()
