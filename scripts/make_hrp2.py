"""Writes models/robots/hrp2/hrp2.urdf from the numbers in models/robots/hrp2/numbers.toml.

    .venv/bin/python scripts/make_hrp2.py

The table holds the trunk and the right side; the left side is mirrored (y becomes -y), but for what it states itself.
Every link looks like what it collides with: boxes and cylinders, coloured by body part.
"""

import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any, Final

from stridelab.machine.models_folder import models_dir

FOLDER: Final = models_dir() / "robots" / "hrp2"
COLOURS: Final = {"BODY": "trunk", "CHEST": "trunk", "HEAD": "head", "LEG": "limb", "ARM": "limb"}
RGBA: Final = {"trunk": "0.35 0.42 0.55 1", "head": "0.75 0.76 0.8 1", "limb": "0.62 0.66 0.72 1"}
TURNED: Final = {"x": "0 1.5707963267948966 0", "y": "1.5707963267948966 0 0", "z": "0 0 0"}
"""A URDF's cylinder stands along z."""

Json = dict[str, Any]


def main() -> None:
    """Write the file."""
    (FOLDER / "hrp2.urdf").write_text(urdf(tomllib.loads((FOLDER / "numbers.toml").read_text(encoding="utf-8"))))


def urdf(numbers: Json) -> str:
    """The whole description."""
    robot = ET.Element("robot", name="hrp2")
    for name, rgba in RGBA.items():
        ET.SubElement(ET.SubElement(robot, "material", name=name), "color", rgba=rgba)
    for link in sides(numbers["links"], numbers["left"]):
        _add_link(robot, link)
    for frame in sides(numbers["frames"], {}):
        ET.SubElement(robot, "link", name=frame["name"])
        _add_joint(robot, frame | {"joint": f"{frame['name']}_fixed"}, "fixed")
    ET.indent(robot)
    text = ET.tostring(robot, encoding="unicode")
    note = "<!-- Written by scripts/make_hrp2.py from numbers.toml, which says where the numbers come from. -->"
    return f'<?xml version="1.0"?>\n{note}\n{text}\n'


def sides(items: list[Json], left: dict[str, Json]) -> Iterator[Json]:
    """The trunk and the right side as they stand, then the left side."""
    yield from items
    for item in items:
        if item["name"][0] in "Rr":
            image = mirrored(item)
            yield image | left.get(image["name"], {})


def mirrored(item: Json) -> Json:
    """Mirror image in the plane y = 0: an axis x or z turns the other way round, an axis y the same way."""
    image = dict(item)
    for key in ("name", "joint", "parent"):
        if key in item and item[key][:4] in ("RLEG", "RARM", "r_so", "r_gr"):
            image[key] = ("L" if item[key][0] == "R" else "l") + item[key][1:]
    for key in ("origin_m", "com_m"):
        if key in item:
            x, y, z = item[key]
            image[key] = [x, -y, z]
    if "inertia_kg_m2" in item:
        xx, xy, xz, yy, yz, zz = item["inertia_kg_m2"]
        image["inertia_kg_m2"] = [xx, -xy, xz, yy, -yz, zz]
    if item.get("axis") in ("x", "z"):
        low, high = item["range_rad"]
        image["range_rad"] = [-high, -low]
    if "shapes" in item:
        image["shapes"] = [shape | {"centre_m": _opposite(shape["centre_m"])} for shape in item["shapes"]]
    return image


def _opposite(point: list[float]) -> list[float]:
    x, y, z = point
    return [x, -y, z]


def _add_link(robot: ET.Element, link: Json) -> None:
    element = ET.SubElement(robot, "link", name=link["name"])
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(link["com_m"]))
    ET.SubElement(inertial, "mass", value=_text([link["mass_kg"]]))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    ET.SubElement(inertial, "inertia", {n: _text([v]) for n, v in zip(names, link["inertia_kg_m2"], strict=True)})
    colour = next(value for key, value in COLOURS.items() if key in link["name"])
    for tag in ("visual", "collision"):
        for shape in link["shapes"]:
            part = ET.SubElement(element, tag)
            ET.SubElement(part, "origin", xyz=_text(shape["centre_m"]), rpy=TURNED[shape.get("axis", "z")])
            _add_shape(ET.SubElement(part, "geometry"), shape)
            if tag == "visual":
                ET.SubElement(part, "material", name=colour)
    if "joint" in link:
        _add_joint(robot, link, "revolute")


def _add_shape(geometry: ET.Element, shape: Json) -> None:
    if shape["kind"] == "box":
        ET.SubElement(geometry, "box", size=_text(shape["size_m"]))
    else:
        ET.SubElement(geometry, "cylinder", radius=_text([shape["radius_m"]]), length=_text([shape["length_m"]]))


def _add_joint(robot: ET.Element, link: Json, kind: str) -> None:
    joint = ET.SubElement(robot, "joint", name=link["joint"], type=kind)
    ET.SubElement(joint, "parent", link=link["parent"])
    ET.SubElement(joint, "child", link=link["name"])
    ET.SubElement(joint, "origin", xyz=_text(link["origin_m"]))
    if kind == "revolute":
        low, high = link["range_rad"]
        ET.SubElement(joint, "axis", xyz=" ".join("1" if link["axis"] == axis else "0" for axis in "xyz"))
        limits = {"lower": low, "upper": high, "effort": link["torque_nm"], "velocity": link["velocity_rad_s"]}
        ET.SubElement(joint, "limit", {name: _text([value]) for name, value in limits.items()})


def _text(values: list[float]) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)


if __name__ == "__main__":
    main()
