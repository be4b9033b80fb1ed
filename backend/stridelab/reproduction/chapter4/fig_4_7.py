"""Figure 4.7: feasible horizontal accelerations of the CoM at constant height and angular momentum.

Plane sections of the wrench cones of circular friction cones, of pyramids with four rays, of the thesis' cones for
alpha = 1, 0.5, 0.3 and 0.2, and of the largest inner Lorentz cone; on two, three and four contacts.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.contacts.wrench_cones.support_region import Outline, area_m2, intersect_half_planes
from stridelab.contacts.wrench_cones.wrench_cone import LinearCone, LorentzCone
from stridelab.conventions import GRAVITY_M_S2, Progress
from stridelab.reproduction.claims import (
    Claim,
    Column,
    Criterion,
    Measured,
    Reproduction,
    above,
    at_least,
    reproduces,
    target,
)
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg
from stridelab.reproduction.studies.cone_validation import thesis_cone
from stridelab.reproduction.studies.random_contact_sets import com_m, stair_sets

ROBOT: Final = "hrp2"
FINE_RAYS: Final = 16
"""Rays of the inner pyramids that approximate the circular cones: 2 % less friction between two rays."""
ALPHAS: Final = (1.0, 0.5, 0.3, 0.2)
FAR_M_S2: Final = 50.0
ANGLE: Final = np.linspace(0.0, 2.0 * np.pi, 181)
MIN_AREA: Final = 1e-9


@reproduces("fig-4.7", "Sections of the wrench cones", printed=("areas",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Deterministic."""
    outlines: dict[str, dict[str, Outline]] = {}
    sets = stair_sets(ROBOT)
    for number, (name, contacts) in enumerate(sets.items()):
        tell(number / len(sets), name)
        outlines[name] = cone_sections(contacts)
    return Reproduction(
        claims=figure_claims(outlines),
        note="The stances of figure 4.5 (HRP-2, friction 0.5), the CoM 0.8 m above the mean of the contacts. "
        f"Circular cones are approximated by inner pyramids of {FINE_RAYS} rays. Areas in (m/s²)².",
        tables={"areas": area_table(outlines)},
        n=len(outlines),
        drawing=render_svg(*(_outline_panel(name, of_set) for name, of_set in outlines.items())),
    )


def cone_sections(contacts: PointContacts) -> dict[str, Outline]:
    """Outlines in the plane of horizontal accelerations (m/s²) by cone; empty if the plane does not intersect it."""
    lift = _acceleration_to_wrench(com_m(contacts))
    thesis = thesis_cone(contacts)
    return {
        "circular": _linear_section(LinearCone.from_contacts(contacts, FINE_RAYS), lift),
        "4 rays": _linear_section(LinearCone.from_contacts(contacts, 4), lift),
        **{f"alpha {alpha:g}": _lorentz_section(thesis.shrink(alpha), lift) for alpha in ALPHAS},
        "largest": _lorentz_section(LinearCone.from_contacts(contacts).largest_lorentz(), lift),
    }


def figure_claims(outlines: Mapping[str, Mapping[str, Outline]]) -> tuple[Claim, ...]:
    """Claims of the text on the figure."""
    inside = {
        name: [_share_inside(o[name], o["circular"]) for o in outlines.values()]
        for name in ("alpha 0.5", "alpha 0.3", "alpha 0.2", "largest")
    }
    closely = min(area_m2(o["4 rays"]) / area_m2(o["circular"]) for o in outlines.values())
    contains = min(_share_inside(o["circular"], o["alpha 1"]) for o in outlines.values())
    areas = [area_m2(o["circular"]) for o in outlines.values()]
    ratio = min(area_m2(o["largest"]) / max(area_m2(o["alpha 0.3"]), MIN_AREA) for o in outlines.values())
    return (
        _text_claim(
            "linear",
            "the linear approximation is inside and closely matches",
            "closely",
            closely,
            above(0.9, "ours"),
            "Smallest area over that of the circular cones.",
        ),
        _text_claim(
            "outer",
            "the outer approximation contains the true cone, in the section of the figure",
            1.0,
            contains,
            at_least(1.0, "words"),
            "Smallest share of the true outline inside, in this section.",
        ),
        _text_claim(
            "alpha_03",
            "alpha = 0.3 is in the cone",
            1.0,
            min(inside["alpha 0.3"]),
            at_least(1.0, "words"),
            "Smallest share of its outline inside, in this section.",
        ),
        _text_claim(
            "alpha_05_four",
            "alpha = 0.5 is in the cone for four contacts",
            1.0,
            inside["alpha 0.5"][-1],
            at_least(1.0, "words"),
            "Share of its outline inside, in this section.",
        ),
        _text_claim(
            "grows",
            "the cone grows with a third contact",
            "> 1",
            areas[1] / areas[0],
            above(1.0, "words"),
            "Area with three contacts over that with two.",
        ),
        target("largest_inside", min(inside["largest"]), "1", at_least=1.0).says(
            "largest inner cone: share of its outline inside"
        ),
        target("largest_area", ratio, "1", at_least=1.0).says(
            "its area over that of alpha = 0.3, minimum of the three"
        ),
    )


def area_table(outlines: Mapping[str, Mapping[str, Outline]]) -> Mapping[str, Column]:
    """Areas with one row per contact set."""
    columns: dict[str, Column] = {"contacts": np.array(list(outlines))}
    for name in next(iter(outlines.values())):
        key = name.replace(" ", "_").replace(".", "")
        columns[key] = np.array([area_m2(of_set[name]) for of_set in outlines.values()])
    return columns


def _acceleration_to_wrench(com: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6 3"]:
    """Map from ``(c_x'', c_y'', 1)`` to the wrench per unit mass about the world origin with c_z'' = L' = 0."""
    forces = np.diag([1.0, 1.0, GRAVITY_M_S2])
    return np.vstack([forces, np.cross(com, forces).T])


def _linear_section(cone: LinearCone, lift: Float[np.ndarray, "6 3"]) -> Outline:
    lines = cone.facets @ lift
    return intersect_half_planes(lines[:, :2], -lines[:, 2], FAR_M_S2)


def _lorentz_section(cone: LorentzCone, lift: Float[np.ndarray, "6 3"]) -> Outline:
    ellipse = cone.section_ellipsoid(lift)
    if ellipse is None:
        return np.zeros((0, 2))
    outline = ellipse.center + np.stack([np.cos(ANGLE[:-1]), np.sin(ANGLE[:-1])], axis=1) @ ellipse.axes.T
    return np.asarray(outline if area_m2(outline) > 0.0 else outline[::-1])


def _share_inside(outline: Outline, polygon: Outline) -> float:
    """Share of vertices inside a convex polygon; 1 for an empty outline."""
    if not len(outline):
        return 1.0
    edges = np.roll(polygon, -1, axis=0) - polygon
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    beyond = outline @ normals.T - (normals * polygon).sum(axis=1)
    return float((beyond <= 1e-9).all(axis=1).mean())


def _text_claim(key: str, says: str, thesis: float | str, ours: float, holds: Criterion, note: str) -> Claim:
    return Measured(key, thesis, ours, "1", holds).says(says, note)


def _outline_panel(name: str, outlines: Mapping[str, Outline]) -> Panel:
    curves = [
        Curve(np.append(x, x[0]), np.append(y, y[0]), label, colour, dashed=label == "4 rays")
        for colour, (label, outline) in enumerate(outlines.items())
        if len(outline)
        for x, y in [outline.T]
    ]
    return Panel(f"{name}: horizontal acceleration", "x (m/s²)", "y (m/s²)", curves)
