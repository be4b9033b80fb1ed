"""Figure 4.7: horizontal accelerations that contacts can give a CoM, with constant height and angular momentum.

Plane sections through the cone of wrenches of the circular friction cones, the pyramids with four rays, the thesis'
cones for alpha = 1, 0.5, 0.3 and 0.2, and the largest Lorentz cone inside; on two, three and four contacts.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.contacts.wrench_cones.support_region import Outline, area_m2, intersection
from stridelab.contacts.wrench_cones.wrench_cone import LinearCone, LorentzCone
from stridelab.conventions import GRAVITY_M_S2, Progress
from stridelab.reproduction.claims import Claim, Column, Item, Reproduction, aimed
from stridelab.reproduction.report.svg_plots import Curve, Panel, svg
from stridelab.studies.cone_validation import thesis_cone
from stridelab.studies.random_contact_sets import com_m, stair_sets

ROBOT: Final = "hrp2"
FINE: Final = 16
"""Rays of the pyramids inside that stand for the circular cones: 2 % less friction between two of them."""
ALPHAS: Final = (1.0, 0.5, 0.3, 0.2)
FAR_M_S2: Final = 50.0
ANGLE: Final = np.linspace(0.0, 2.0 * np.pi, 181)
NOT_SAFE: Final = 1e-9


def run(seeds: int, tell: Progress) -> Reproduction:
    """Deterministic, whatever ``seeds``."""
    outlines: dict[str, dict[str, Outline]] = {}
    sets = stair_sets(ROBOT)
    for number, (name, contacts) in enumerate(sets.items()):
        tell(number / len(sets), name)
        outlines[name] = sections(contacts)
    tell(1.0, "done")
    return Reproduction(
        claims=claims(outlines),
        note="The stances of figure 4.5 (HRP-2, friction 0.5), the CoM 0.8 m above the middle of the contacts. "
        f"Circular cones by pyramids of {FINE} rays inside. Areas in (m/s²)².",
        tables={"areas": table(outlines)},
        drawing=svg([_panel(name, found) for name, found in outlines.items()]),
    )


def sections(contacts: PointContacts) -> dict[str, Outline]:
    """Outlines in the plane of horizontal accelerations (m/s²), by name; empty where the plane misses a cone."""
    lift = _lift(com_m(contacts))
    thesis = thesis_cone(contacts)
    found = {
        "circular": _polygon(LinearCone.of(contacts, FINE), lift),
        "4 rays": _polygon(LinearCone.of(contacts, 4), lift),
    }
    found |= {f"alpha {alpha:g}": _ellipse(thesis.shrunk(alpha), lift) for alpha in ALPHAS}
    return found | {"largest": _ellipse(LinearCone.of(contacts).largest_lorentz(), lift)}


def claims(outlines: Mapping[str, Mapping[str, Outline]]) -> tuple[Claim, ...]:
    """What the text says of the figure."""
    inside = {name: [_share_inside(found[name], found["circular"]) for found in outlines.values()] for name in
              ("alpha 0.5", "alpha 0.3", "alpha 0.2", "largest")}  # fmt: skip
    closely = min(area_m2(found["4 rays"]) / area_m2(found["circular"]) for found in outlines.values())
    contains = min(_share_inside(found["circular"], found["alpha 1"]) for found in outlines.values())
    areas = [area_m2(found["circular"]) for found in outlines.values()]
    ratio = min(area_m2(found["largest"]) / max(area_m2(found["alpha 0.3"]), NOT_SAFE) for found in outlines.values())
    return (
        _said("linear", "the linear approximation is inside and closely matches", "closely", closely, closely > 0.9,
              "Least area over that of the circular cones."),
        _said("outer", "the outer approximation contains the true cone", 1.0, contains, contains == 1.0,
              "Least share of the true outline inside, in this section."),
        _said("alpha_03", "alpha = 0.3 is in the cone", 1.0, min(inside["alpha 0.3"]), min(inside["alpha 0.3"]) == 1.0,
              "Least share of its outline inside, in this section."),
        _said("alpha_05_four", "alpha = 0.5 is in the cone for four contacts", 1.0, inside["alpha 0.5"][-1],
              inside["alpha 0.5"][-1] == 1.0, "Share of its outline inside, in this section."),
        _said("grows", "the cone grows with a third contact", "> 1", areas[1] / areas[0], areas[1] > areas[0],
              "Area with three contacts over that with two."),
        aimed("largest_inside", "the largest cone inside: share of its outline inside", min(inside["largest"]), "1",
              at_least=1.0),
        aimed("largest_area", "its area over that of alpha = 0.3, least of the three", ratio, "1", at_least=1.0),
    )  # fmt: skip


def table(outlines: Mapping[str, Mapping[str, Outline]]) -> Mapping[str, Column]:
    """Areas, one row per contact set."""
    columns: dict[str, Column] = {"contacts": np.array(list(outlines))}
    for name in next(iter(outlines.values())):
        key = name.replace(" ", "_").replace(".", "")
        columns[key] = np.array([area_m2(found[name]) for found in outlines.values()])
    return columns


def _lift(com: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6 3"]:
    """From ``(c_x'', c_y'', 1)`` to the wrench per unit of mass about the world origin, c_z'' = L' = 0."""
    forces = np.diag([1.0, 1.0, GRAVITY_M_S2])
    return np.vstack([forces, np.cross(com, forces).T])


def _polygon(cone: LinearCone, lift: Float[np.ndarray, "6 3"]) -> Outline:
    lines = cone.facets @ lift
    return intersection(lines[:, :2], -lines[:, 2], FAR_M_S2)


def _ellipse(cone: LorentzCone, lift: Float[np.ndarray, "6 3"]) -> Outline:
    found = cone.section(lift)
    if found is None:
        return np.zeros((0, 2))
    outline = found.center + np.stack([np.cos(ANGLE[:-1]), np.sin(ANGLE[:-1])], axis=1) @ found.axes.T
    return np.asarray(outline if area_m2(outline) > 0.0 else outline[::-1])


def _share_inside(outline: Outline, polygon: Outline) -> float:
    """Share of vertices inside a convex polygon; 1 for an empty outline."""
    if not len(outline):
        return 1.0
    edges = np.roll(polygon, -1, axis=0) - polygon
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    beyond = outline @ normals.T - (normals * polygon).sum(axis=1)
    return float((beyond <= 1e-9).all(axis=1).mean())


def _said(key: str, says: str, thesis: float | str, ours: float, holds: bool, note: str) -> Claim:
    return Claim(key, says, thesis, ours, "1", "met" if holds else "not_met", note)


def _panel(name: str, found: Mapping[str, Outline]) -> Panel:
    curves = [
        Curve(np.append(x, x[0]), np.append(y, y[0]), label, colour, dashed=label == "4 rays")
        for colour, (label, outline) in enumerate(found.items())
        if len(outline)
        for x, y in [outline.T]
    ]
    return Panel(f"{name}: horizontal acceleration", "x (m/s²)", "y (m/s²)", curves)


ITEM: Final = Item("fig-4.7", "Sections of the wrench cones", run, printed=("areas",))
