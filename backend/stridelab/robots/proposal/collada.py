"""COLLADA documents of meshes: their up axis and unit, and their parts, which are read one by one."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

PRIMITIVES: Final = ("triangles", "polylist", "polygons", "tristrips", "trifans")
DROPPED: Final = (
    "library_images", "library_effects", "library_materials", "library_animations", "library_controllers",
    "bind_material", "instance_controller", "lines", "linestrips",
)  # fmt: skip
Colour = tuple[float, float, float]
Y_UP: Final = re.compile(rb"<up_axis>\s*Y_UP\s*</up_axis>")
UNIT: Final = re.compile(rb'<unit\b[^>]*\bmeter\s*=\s*["\']\s*([^"\']*)')
_HEAD_BYTES: Final = 1 << 16


def states_y_up(path: Path) -> bool:
    """Whether a file states that its y axis points up."""
    with path.open("rb") as file:
        return Y_UP.search(file.read(_HEAD_BYTES)) is not None


def unit_m(path: Path) -> float:
    """Length of the unit that a file states, in metres; 1 if it states none, or none that is a length."""
    with path.open("rb") as file:
        stated = UNIT.search(file.read(_HEAD_BYTES))
    try:
        length_m = 1.0 if stated is None else float(stated.group(1))
    except ValueError:
        return 1.0
    return length_m if math.isfinite(length_m) and length_m > 0.0 else 1.0


def may_repeat_nodes(root: ET.Element) -> bool:
    """Whether nodes may occur several times, or not at all, in the scene: the parts may not be all of it."""
    scenes = _all_of(root, "visual_scene")
    return len(scenes) != 1 or any(_all_of(root, name) for name in ("instance_node", "library_nodes"))


@dataclass(frozen=True)
class Part:
    """Triangles of one material in a COLLADA file, with the geometry and the node's instance that they belong to."""

    geometry: ET.Element
    primitive: ET.Element
    instance: ET.Element


def collada_parts(root: ET.Element) -> Iterator[Part]:
    """The parts of every instance of a geometry in a document."""
    geometries = {one.get("id", ""): one for one in _all_of(root, "geometry")}
    for instance in _all_of(root, "instance_geometry"):
        geometry = geometries.get(instance.get("url", "").removeprefix("#"))
        for primitive in [] if geometry is None else geometry.iter():
            if _local_name(primitive) in PRIMITIVES:
                assert geometry is not None
                yield Part(geometry, primitive, instance)


def part_alone(root: ET.Element, part: Part) -> bytes:
    """A document with nothing but this part, and without the names of materials and images."""
    one_of = {"geometry": part.geometry, "instance_geometry": part.instance} | dict.fromkeys(PRIMITIVES, part.primitive)

    def copy_element(element: ET.Element) -> ET.Element:
        copy = ET.Element(_local_name(element), element.attrib)
        copy.text = element.text
        for child in element:
            name = _local_name(child)
            if one_of.get(name, child) is child and name not in DROPPED:
                copy.append(copy_element(child))
        return copy

    return bytes(ET.tostring(copy_element(root), encoding="utf-8", xml_declaration=True))


def part_colour(root: ET.Element, part: Part) -> Colour | None:
    """Diffuse colour of the part's material; None without one, or for a texture."""
    by_id = {one.get("id", ""): one for kind in ("material", "effect") for one in _all_of(root, kind)}
    symbol = part.primitive.get("material")
    for bound in _all_of(part.instance, "instance_material"):
        material = by_id.get(bound.get("target", "").removeprefix("#")) if bound.get("symbol") == symbol else None
        for effect in [] if material is None else _all_of(material, "instance_effect"):
            shading = by_id.get(effect.get("url", "").removeprefix("#"))
            for diffuse in [] if shading is None else _all_of(shading, "diffuse"):
                for color in _all_of(diffuse, "color"):
                    values = [min(max(float(value), 0.0), 1.0) for value in (color.text or "").split()]
                    if len(values) >= 3:
                        return values[0], values[1], values[2]
    return None


def _all_of(element: ET.Element, name: str) -> list[ET.Element]:
    """Elements below ``element`` by their name without namespace."""
    return [one for one in element.iter() if _local_name(one) == name]


def _local_name(element: ET.Element) -> str:
    return element.tag.rsplit("}", 1)[-1]
