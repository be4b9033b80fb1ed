"""Inertias and shapes of a link that contradict each other, since all matter of a link lies within its shapes.

Its centre of mass therefore lies within their bounding box. One that does not hints at a mesh in other axes, as of a
left-handed file, in another unit, or at a wrong number; it is remarked on. And with all matter at most r away from the
centre of mass, no principal moment exceeds m r^2. Where even the smallest one exceeds it by far, as in files in other
units than kg m2, all three are replaced by those of a sphere of water of the mass m. A motor adds to one moment only
(``motor_inertias``).
"""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points
from stridelab.robots.inertias import completed_inertia, read_link
from stridelab.robots.proposal.meshes import placement_of_element, read_mesh

OVERSIZED: Final = 4.0
"""Ratio of the smallest moment and m r^2 from which on the moments are replaced: shapes may be smaller than links."""
OUTSIDE_M: Final = 0.03
"""Distance of a centre of mass from the bounding box of its shapes from which on it is remarked on."""
REMARKED_MASS_SHARE: Final = 0.01
"""Share of the mass of the robot that a link has at least to be remarked on."""
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


def remark_masses_outside_shapes(root: ET.Element, folder: Path, assumed: dict[str, str]) -> None:
    """Name the links of a plain description whose centre of mass lies outside of their shapes in ``assumed``."""
    masses = {
        link: float(mass.attrib["value"])
        for link in root.findall("link")
        if (mass := link.find("inertial/mass")) is not None
    }
    total_kg = sum(masses.values())
    for link, mass_kg in masses.items():
        boxes = [_corners_in_link(shape, folder) for shape in (*link.findall("visual"), *link.findall("collision"))]
        if not boxes or mass_kg < REMARKED_MASS_SHARE * total_kg:
            continue
        corners_m, com_m = np.concatenate(boxes), placement_of_element(link.find("inertial/origin")).translation
        nearest_m = np.clip(com_m, corners_m.min(axis=0), corners_m.max(axis=0))
        outside_m = float(np.linalg.norm(com_m - nearest_m))
        if outside_m > OUTSIDE_M:
            assumed[f"link {link.attrib['name']}: centre of mass"] = (
                f"as stated, {100.0 * outside_m:.0f} cm outside of the link's shapes; either these are not where they "
                "belong (axes, unit, left-handed meshes), or it is wrong"
            )


def _corners_in_link(shape: ET.Element, folder: Path) -> Float[np.ndarray, "8 3"]:
    """Corners of the bounding box of a shape, (8, 3), in the frame of the link."""
    form = shape.find("geometry/*")
    assert form is not None
    if form.tag == "mesh":
        points_m = _shape_corners(form, folder)
        low_m, high_m = points_m.min(axis=0), points_m.max(axis=0)
    else:
        size_m = np.abs(_shape_corners(form, folder)).max(axis=0)
        high_m = size_m if form.tag == "box" else np.array([size_m[0], size_m[0], max(size_m[0], size_m[2])])
        low_m = -high_m
    T = placement_of_element(shape.find("origin"))
    corners_m = np.where(np.indices((2, 2, 2)).reshape(3, 8).T, high_m, low_m)
    return np.asarray(corners_m @ T.rotation.T + T.translation)


def _reach_m(link: ET.Element, folder: Path) -> float:
    """Upper bound of the distances of all points of a link's shapes from its centre of mass; 0 without shapes."""
    com_m = placement_of_element(link.find("inertial/origin")).translation
    reach_m = 0.0
    for shape in (*link.findall("visual"), *link.findall("collision")):
        form = next(iter(shape.find("geometry") or ()), None)
        if form is not None:
            away_m = float(np.linalg.norm(placement_of_element(shape.find("origin")).translation - com_m))
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
