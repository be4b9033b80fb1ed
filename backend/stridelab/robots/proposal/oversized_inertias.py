"""Moments of inertia beyond those of any body as large as its link, as of files in other units than kg m2.

All matter of a link lies within its shapes, at most r away from its centre of mass, so that no principal moment exceeds
m r^2. Where even the smallest one exceeds it by far, all three are replaced by those of a sphere of water of the mass
m. A motor adds to one moment only (``motor_inertias``).
"""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Vector3
from stridelab.robots.inertias import completed_inertia, read_link
from stridelab.robots.proposal.meshes import read_mesh

OVERSIZED: Final = 4.0
"""Ratio of the smallest moment and m r^2 from which on the moments are replaced: shapes may be smaller than links."""
_POINT: Final = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 0.0)


def replace_oversized_inertias(root: ET.Element, folder: Path, assumed: dict[str, str]) -> None:
    """Replace them in a plain description whose meshes are in ``folder``; ``assumed`` is extended.

    A link without shapes is taken to be as large as the largest of the others.
    """
    links = [link for link in root.findall("link") if link.find("inertial/inertia") is not None]
    reach_m = {link.attrib["name"]: _reach_m(link, folder) for link in links}
    largest_m = max(reach_m.values(), default=0.0)
    for link in links:
        name, inertia = link.attrib["name"], link.find("inertial/inertia")
        assert inertia is not None
        try:
            stated = read_link(link)
        except ValueError:
            continue  # reported when the links are checked
        r_m = reach_m[name] or largest_m
        if not (stated.mass_kg > 0.0 and stated.moments_kg_m2[0] > OVERSIZED * stated.mass_kg * r_m**2 > 0.0):
            continue
        sphere = completed_inertia(stated.mass_kg, _POINT)
        assert sphere is not None
        inertia.attrib.update({key: repr(value) for key, value in sphere[0].items()})
        gyration_m = float(np.sqrt(stated.moments_kg_m2[0] / stated.mass_kg))
        how = f"a radius of gyration of {gyration_m:.2g} m is stated, and no part is farther than {r_m:.2g} m"
        assumed[f"link {name}: inertia"] = f"that of a sphere of water: {how}"


def _reach_m(link: ET.Element, folder: Path) -> float:
    """Upper bound of the distances of all points of a link's shapes from its centre of mass; 0 without shapes."""
    com_m = _origin_position(link.find("inertial/origin"))
    reach_m = 0.0
    for shape in (*link.findall("visual"), *link.findall("collision")):
        form = next(iter(shape.find("geometry") or ()), None)
        if form is not None:
            away_m = float(np.linalg.norm(_origin_position(shape.find("origin")) - com_m))
            reach_m = max(reach_m, away_m + float(np.linalg.norm(_shape_corners(form, folder), axis=1).max()))
    return reach_m


def _shape_corners(form: ET.Element, folder: Path) -> Points | Float[np.ndarray, "1 3"]:
    """Points of a shape that include its farthest from its origin."""
    if form.tag == "mesh":
        return read_mesh(folder / form.attrib["filename"].rsplit("/", 1)[1])
    sizes = {key: np.array(form.get(key, "0").split(), float) for key in ("size", "radius", "length")}
    if form.tag == "box":
        return 0.5 * sizes["size"][None]
    return np.array([[sizes["radius"][0], 0.0, 0.5 * sizes["length"][0]]])


def _origin_position(origin: ET.Element | None) -> Vector3:
    return np.zeros(3) if origin is None else np.array(origin.get("xyz", "0 0 0").split(), float)
