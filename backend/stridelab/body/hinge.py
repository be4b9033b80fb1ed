"""Centre of a hinge joint (knee, ankle, elbow) from its outer and inner landmark, or from the outer one alone."""

from collections.abc import Mapping

from stridelab.body.anthropometry import Anthropometry
from stridelab.body.joints import SIGN, Joints, Tracks, has
from stridelab.body.vectors import across, distance_m, unit
from stridelab.conventions import Points


def hinge(
    p: Tracks, name: str, proximal: Points, Z: Points, body: Anthropometry, widths_m: Mapping[str, float]
) -> Joints | None:
    """Joint ``name`` (``l_knee``, ...), or None where neither its outer landmark nor its centre is marked.

    Midway between both landmarks where both are marked. With the outer one o alone, c = o - s w/2 z: half the joint
    width w inwards, z being ``Z`` (rightwards) made perpendicular to the segment above, s = -1 on the left. ``w`` is
    the measured width, else the mean proportion of the shank.
    """
    s, joint = name.split("_")
    outer, inner, centre = (p.get(f"{name}_{kind}") for kind in ("lateral", "medial", "centre"))
    if outer is not None and inner is not None:
        middle = (outer + inner) / 2 if centre is None else centre
        return Joints({name: middle}, {name: SIGN[s] * (outer - inner)})
    if centre is not None:
        return Joints({name: centre}, {name: Z})
    if outer is None:
        return None
    width = widths_m.get(name, body.proportions[joint] * shank_length_m(p))
    z = across(Z, unit(proximal - outer))
    return Joints({name: outer - SIGN[s] * width / 2 * z}, {name: z}, frozenset({f"{joint}-medial-missing"}))


def shank_length_m(p: Tracks) -> float:
    """Typical length of the shank between outer markers (or centres): the yardstick of the proportions; else NaN."""
    for kind in ("lateral", "centre"):
        sides = [s for s in "lr" if has(p, f"{s}_knee_{kind}", f"{s}_ankle_{kind}")]
        if sides:
            return sum(distance_m(p[f"{s}_knee_{kind}"], p[f"{s}_ankle_{kind}"]) for s in sides) / len(sides)
    return float("nan")
