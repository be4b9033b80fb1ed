"""Joint centres with the orientation of the adjacent segments, and the centre of a hinge joint.

The centre of a hinge joint (knee, ankle, elbow) follows from its outer and inner landmark, or the outer one alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from stridelab.body.anthropometry import Anthropometry
from stridelab.body.vectors import median_distance_m, perpendicular_unit, unit
from stridelab.conventions import Points

Tracks = Mapping[str, Points]
"""Points by name, all of one trial."""

OUTWARD_SIGN: Final = {"l": -1.0, "r": 1.0}
"""Outwards on this side is ``SIGN`` times rightwards."""


@dataclass(frozen=True)
class Joints:
    """Joint centres (``l_hip``, ``lumbar``, ...) and, per segment, a vector that points roughly to its right.

    ``substitutes`` holds the codes of the substitutes in use.
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


def has_landmarks(p: Tracks, *names: str) -> bool:
    """Whether all of these landmarks are present."""
    return set(names) <= p.keys()


_SHANKS: Final = (
    ("knee_lateral", "ankle_lateral", 1.0),
    ("knee_centre", "ankle_centre", 1.0),
    ("knee_lateral", "ankle_centre", 1.0),
    ("knee_lateral", "heel", 0.874),
)
"""Landmark pairs that measure the shank, with its length per distance (0.874, sd 0.008 in ten adults)."""


def hinge_joint(
    p: Tracks, name: str, proximal: Points, Z: Points, body: Anthropometry, widths_m: Mapping[str, float]
) -> Joints | None:
    """Joint ``name`` (``l_knee``, ...), or None if neither its outer landmark nor its centre is marked.

    If both landmarks are marked, the centre is midway between them. With the outer one o alone, the centre c lies half
    the joint width w/2 inwards, perpendicular to the segment above with upper end h (as in the conventional gait
    model):

        c = o + w/2 (cos a i + sin a u),   u = (h - o) / |h - o|,   sin a = w / (2 |h - o|)

    with i the part of ``Z`` (rightwards, with the sign of the side) perpendicular to u. ``w`` is the measured width,
    else the mean proportion of the shank.
    """
    s, joint = name.split("_")
    outer, inner, centre = (p.get(f"{name}_{kind}") for kind in ("lateral", "medial", "centre"))
    if outer is not None and inner is not None:
        middle = (outer + inner) / 2 if centre is None else centre
        return Joints({name: middle}, {name: OUTWARD_SIGN[s] * (outer - inner)})
    if centre is not None:
        return Joints({name: centre}, {name: Z})
    if outer is None:
        return None
    half = widths_m.get(name, body.proportions[joint] * shank_length_m(p)) / 2
    u = unit(proximal - outer)
    i = -OUTWARD_SIGN[s] * perpendicular_unit(Z, u)
    sin_a = min(half / median_distance_m(proximal, outer), 1.0)
    cos_a = (1.0 - sin_a**2) ** 0.5
    inwards = cos_a * i + sin_a * u
    return Joints(
        {name: outer + half * inwards}, {name: -OUTWARD_SIGN[s] * inwards}, frozenset({f"{joint}-medial-missing"})
    )


def shank_length_m(p: Tracks) -> float:
    """Length of the shank between outer markers, the unit of the proportions; NaN without suitable landmarks.

    Without ankles, the distance from knee to heel marker is used, which changes little with the ankle's angle.
    """
    for upper, lower, share in _SHANKS:
        sides = [s for s in "lr" if has_landmarks(p, f"{s}_{upper}", f"{s}_{lower}")]
        if sides:
            return share * sum(median_distance_m(p[f"{s}_{upper}"], p[f"{s}_{lower}"]) for s in sides) / len(sides)
    return float("nan")
