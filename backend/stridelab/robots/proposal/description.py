"""Reads a stranger's URDF into a plain one: known elements and checked numbers only, meshes with generated names.

What a rigid-body library would reject with a crash or a bare message is refused here by name: document types and
entities, cycles, several roots, numbers that are not finite, lengths in millimetres.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.parsers import expat

from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.robots.inertias import completed_inertia
from stridelab.robots.proposal.joint_tree import joint_end, name_and_tree_faults, rename_joints, simplify_names
from stridelab.robots.proposal.massless_links import fix_massless_ends, remove_world, share_masses

MAX_BYTES: Final = 8_000_000
MAX_ELEMENTS: Final = 60_000
MAX_DEPTH: Final = 40
MAX_SHAPES: Final = 1_000
"""Shapes of all links, drawn and touching ones each; what is proposed takes a minute for as many."""
MAX_OFFSET_M: Final = 20.0
"""Longest distance between two joints; larger ones are usually millimetres."""
MAX_ROTOR_KG_M2: Final = 10.0
"""Largest reflected rotor inertia (``armature``, from MJCF) that is taken over."""
UNLIMITED: Final = 1e6
"""Limits (N m, rad/s) from this size on are those of a joint without a limit; infinity is one."""
UNLIMITED_RAD: Final = 720.0
"""Ranges from this size on are those of a joint without a range: they exceed two turns in degrees, too."""
MARKER_KG: Final = 0.01
MARKER_M: Final = 0.03
"""Mass and size up to which a link of solids is a mark, not a part of the body."""
MESHES: Final = (".stl", ".obj", ".dae")
DEFAULT_RANGE_RAD: Final = math.pi
SLIDES: Final = "prismatic, fixed here"
"""What is assumed of a joint that slides."""
TURNING: Final = ("revolute", "continuous")
Mesh = Callable[[str, Sequence[float], bool], str | None]
"""``mesh(filename, scale, is_collision)``: name of the converted mesh, None to leave it out."""


@dataclass(frozen=True)
class PlainDescription:
    """A checked URDF; ``assumed`` maps what it lacked, such as ``joint x: range``, to what was assumed."""

    root: ET.Element
    assumed: dict[str, str]


def read_xml(path: Path, filename: str, max_bytes: int = MAX_BYTES) -> ET.Element:
    """Parse the description without document type and entities.

    Raises ``UnreadableFile``: ``robot-data-unreadable``, ``robot-description-too-large``.
    """
    content = path.read_bytes()
    if len(content) > max_bytes:
        raise _unreadable("robot-description-too-large", f"The description exceeds {max_bytes / 1e6:g} MB.", filename)
    depth = elements = 0

    def start_element(_name: str, _attributes: object) -> None:
        nonlocal depth, elements
        depth, elements = depth + 1, elements + 1
        if depth > MAX_DEPTH or elements > MAX_ELEMENTS:
            raise _unreadable("robot-description-too-large", "The description has too many elements.", filename)

    def end_element(_name: str) -> None:
        nonlocal depth
        depth -= 1

    def refuse_doctype(*_: object) -> None:
        raise _unreadable("robot-data-unreadable", "The description declares a document type or entities.", filename)

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start_element, end_element
    parser.StartDoctypeDeclHandler = refuse_doctype
    try:
        parser.Parse(content, True)
        return ET.fromstring(content)  # noqa: S314 (no document type, so no entities)
    except (expat.ExpatError, ET.ParseError, ValueError, LookupError) as error:
        message = f"The description is not valid XML: {error}."
        raise _unreadable("robot-data-unreadable", message, filename) from error


def plain_description(root: ET.Element, filename: str, mesh: Mesh) -> PlainDescription:
    """Check a URDF and rebuild it from its known elements.

    Raises ``InvalidInput`` (``robot-description-invalid``) with one fault per place, ``UnreadableFile``
    (``robot-data-unreadable``) for a document that is no URDF.
    """
    if root.tag != "robot":
        kind = "an SDF file" if root.tag == "sdf" else f"a document <{root.tag[:40]}>"
        message = f"The description is {kind}; convert it to URDF, whose document is <robot>, or to MJCF."
        raise _unreadable("robot-data-unreadable", message, filename)
    if is_unexpanded(root):
        message = "The description is a xacro file that is not expanded: xacro robot.urdf.xacro > robot.urdf."
        raise _unreadable("robot-data-unreadable", message, filename)
    links, joints = root.findall("link"), root.findall("joint")
    simplified = simplify_names(links, joints)
    if faults := [*name_and_tree_faults(links, joints), *_shape_faults(links)]:
        raise invalid(faults)
    reader = _Reader(mesh)
    assumed = simplified | rename_joints(joints, {link.attrib["name"] for link in links})
    plain = ET.Element("robot", name="robot")
    for link in links:
        plain.append(reader.link(link, assumed))
    for joint in joints:
        plain.append(reader.joint(joint, assumed))
    if reader.faults:
        raise invalid(reader.faults)
    fix_massless_ends(plain, assumed)
    remove_world(plain, assumed)
    share_masses(plain, assumed)
    return PlainDescription(plain, assumed)


def _shape_faults(links: Sequence[ET.Element]) -> Iterator[Fault]:
    for kind in ("collision", "visual"):
        number = sum(len(link.findall(kind)) for link in links)
        if number > MAX_SHAPES:
            yield Fault(kind, f"there are {number}; at most {MAX_SHAPES} are accepted")


def is_unexpanded(root: ET.Element) -> bool:
    """Whether a document holds elements (``xacro:macro``) or expressions (``${width}``) of xacro."""
    elements = list(root.iter())
    return any("/xacro}" in element.tag for element in elements) or any(
        "${" in value for element in elements for value in element.attrib.values()
    )


def invalid(faults: Sequence[Fault]) -> InvalidInput:
    """The error for a description with ``faults``."""
    places = "; ".join(f"{fault.where}: {fault.message}" for fault in faults[:5])
    return InvalidInput("robot-description-invalid", f"The description is invalid. {places}", faults[:50])


def _unreadable(code: str, message: str, filename: str) -> UnreadableFile:
    return UnreadableFile(code, message, [Fault(filename[:120], "cannot be read")])


class _Reader:
    """Rebuilds links and joints; collects the faults of their numbers."""

    def __init__(self, mesh: Mesh) -> None:
        self.faults: list[Fault] = []
        self._mesh = mesh

    def link(self, element: ET.Element, assumed: dict[str, str]) -> ET.Element:
        name = element.attrib["name"]
        where = f"link {name}"
        link = ET.Element("link", name=name)
        if (inertial := element.find("inertial")) is not None:
            plain = ET.SubElement(link, "inertial")
            self._origin(plain, inertial, where)
            (mass,) = self._numbers(inertial.find("mass"), "value", 1, where, "mass", None)
            ET.SubElement(plain, "mass", value=repr(mass))
            keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            inertia = inertial.find("inertia")
            values = {key: self._numbers(inertia, key, 1, where, key, None)[0] for key in keys}
            if (completed := completed_inertia(mass, values)) is not None:
                values, assumed[f"{where}: inertia"] = completed
            ET.SubElement(plain, "inertia", {key: repr(value) for key, value in values.items()})
        for kind in ("visual", "collision"):
            for shape in element.findall(kind):
                if _is_point(shape):
                    assumed[f"{where}: {kind}"] = "without the spheres of radius 0, which only mark points"
                else:
                    self._shape(link, shape, kind, where)
        if link.find("collision") is None:
            if is_mark(link):
                assumed[f"{where}: collision"] = "none, since it is only a mark in the display"
                return link
            for shape in element.findall("visual"):  # what is drawn is also what touches
                mesh = shape.find("geometry/mesh")
                if mesh is not None and not mesh.get("filename", "").lower().endswith(MESHES):
                    assumed[f"{where}: collision"] = f"not its drawn mesh, which is none of {', '.join(MESHES)}"
                else:
                    self._shape(link, shape, "collision", where)
        return link

    def joint(self, element: ET.Element, assumed: dict[str, str]) -> ET.Element:
        name, kind = element.attrib["name"], element.get("type", "")
        where = f"joint {name}"
        plain = ET.Element("joint", name=name, type=kind)
        self._origin(plain, element, where)
        for which in ("parent", "child"):
            ET.SubElement(plain, which, link=joint_end(element, which))
        if kind in ("fixed", "prismatic", "floating", "planar"):
            if kind == "floating" and joint_end(element, "parent") == "world":
                return plain
            if kind != "fixed":
                plain.set("type", "fixed")
                assumed[f"{where}: type"] = SLIDES if kind == "prismatic" else f"{kind}, fixed here"
            return plain
        if kind not in TURNING:
            self.faults.append(Fault(where, f"its type {kind[:40]!r} is unknown"))
            return plain
        axis = self._numbers(element.find("axis"), "xyz", 3, where, "axis", (1.0, 0.0, 0.0))
        length = math.hypot(*axis)
        if length < 1e-6:
            self.faults.append(Fault(where, "its axis has the length 0"))
            return plain
        ET.SubElement(plain, "axis", xyz=_text([value / length for value in axis]))
        (rotor,) = self._numbers(element.find("dynamics"), "armature", 1, where, "armature", (0.0,))
        if 0.0 < rotor < MAX_ROTOR_KG_M2:
            ET.SubElement(plain, "dynamics", damping="0", armature=repr(rotor))
        coupled = element.find("mimic")
        if coupled is not None:
            with_joint = coupled.get("joint", "")[:100] or "another"
            assumed[f"{where}: mimic"] = f"not coupled to {with_joint}: it has a motor of its own here"
        self._limit(plain, element, where, assumed)
        return plain

    def _limit(self, plain: ET.Element, element: ET.Element, where: str, assumed: dict[str, str]) -> None:
        """Range, torque and speed; those that are missing are 0, a missing range is half a turn to either side."""
        stated = element.find("limit")
        values = {key: self._limit_value(stated, key, where) for key in ("lower", "upper", "effort", "velocity")}
        if max(abs(values["lower"]), abs(values["upper"])) >= UNLIMITED_RAD:
            values |= {"lower": 0.0, "upper": 0.0}
        turns = plain.get("type") == "continuous"
        if turns and 0.0 < values["upper"] - values["lower"] < 2.0 * math.pi:
            assumed[f"{where}: type"] = "continuous, with the range that is stated"
        elif turns or (values["lower"] == 0.0 and values["upper"] == 0.0):
            values |= {"lower": -DEFAULT_RANGE_RAD, "upper": DEFAULT_RANGE_RAD}
            assumed[f"{where}: range"] = "half a turn to either side"
        plain.set("type", "revolute")
        if values["lower"] >= values["upper"]:
            self.faults.append(Fault(where, f"its range is empty: {values['lower']:g} to {values['upper']:g} rad"))
        elif max(abs(values["lower"]), abs(values["upper"])) > 4.0 * math.pi:
            message = f"its range {values['lower']:g} to {values['upper']:g} exceeds two turns; the unit must be rad"
            self.faults.append(Fault(where, message))
        if values["effort"] < 0.0 or values["velocity"] < 0.0:
            self.faults.append(Fault(where, "its effort and velocity limits must not be negative"))
        ET.SubElement(plain, "limit", {key: repr(value) for key, value in values.items()})

    def _limit_value(self, stated: ET.Element | None, key: str, where: str) -> float:
        """A limit; 0 if it is missing or so large that it states none."""
        try:
            if stated is not None and abs(float(stated.get(key, "0"))) >= UNLIMITED:
                return 0.0
        except ValueError:
            pass  # reported below
        return self._numbers(stated, key, 1, where, f"limit {key}", (0.0,))[0]

    def _shape(self, link: ET.Element, shape: ET.Element, kind: str, where: str) -> None:
        geometry = shape.find("geometry")
        form = None if geometry is None else next(iter(geometry), None)
        if form is None:
            return
        plain = ET.Element(kind)
        self._origin(plain, shape, where)
        body = ET.SubElement(plain, "geometry")
        sizes = {"box": (("size", 3),), "sphere": (("radius", 1),), "cylinder": (("radius", 1), ("length", 1))}
        if form.tag == "mesh":
            scale = self._numbers(form, "scale", 3, where, "mesh scale", (1.0, 1.0, 1.0))
            if min(map(abs, scale)) < 1e-9:
                self.faults.append(Fault(where, "the scale of a mesh is 0"))
                return
            name = self._mesh(form.get("filename", ""), scale, kind == "collision")
            if name is None:
                return
            ET.SubElement(body, "mesh", filename=name)
        elif form.tag in sizes:
            numbers = {key: self._numbers(form, key, n, where, f"{form.tag} {key}", None) for key, n in sizes[form.tag]}
            if min(min(values) for values in numbers.values()) <= 0.0:
                self.faults.append(Fault(where, f"its {form.tag} has a size that is not positive"))
                return
            ET.SubElement(body, form.tag, {key: _text(values) for key, values in numbers.items()})
        else:
            self.faults.append(Fault(where, f"its geometry <{form.tag[:40]}> is unknown"))
            return
        color = shape.find("material/color")
        if kind == "visual" and color is not None:
            rgba = self._numbers(color, "rgba", 4, where, "color", None)
            rgba = tuple(min(max(value / (255.0 if max(rgba) > 1.0 else 1.0), 0.0), 1.0) for value in rgba)
            ET.SubElement(ET.SubElement(plain, "material", name=f"m{len(link)}"), "color", rgba=_text(rgba))
        link.append(plain)

    def _origin(self, plain: ET.Element, element: ET.Element, where: str) -> None:
        origin = element.find("origin")
        xyz = self._numbers(origin, "xyz", 3, where, "origin xyz", (0.0, 0.0, 0.0))
        rpy = self._numbers(origin, "rpy", 3, where, "origin rpy", (0.0, 0.0, 0.0))
        if math.hypot(*xyz) > MAX_OFFSET_M:
            message = f"its origin is {math.hypot(*xyz):g} m away; lengths must be in metres, not millimetres"
            self.faults.append(Fault(where, message))
        ET.SubElement(plain, "origin", xyz=_text(xyz), rpy=_text(rpy))

    def _numbers(
        self,
        element: ET.Element | None,
        key: str,
        count: int,
        where: str,
        what: str,
        default: tuple[float, ...] | None,
    ) -> tuple[float, ...]:
        text = None if element is None else element.get(key)
        if text is None:
            if default is None:
                self.faults.append(Fault(where, f"it has no {what}"))
            return default or (1.0,) * count
        try:
            values = tuple(float(part) for part in text.split())
        except ValueError:
            values = ()
        if len(values) != count or not all(math.isfinite(value) and abs(value) < 1e9 for value in values):
            self.faults.append(Fault(where, f"{what} is {text[:60]!r}, which is not {count} finite numbers"))
            return default or (1.0,) * count
        return values


def is_mark(link: ET.Element) -> bool:
    """Whether a plain link is a mark of a place, such as a corner of a sole: next to no mass, and small solids."""
    mass = link.find("inertial/mass")
    if mass is not None and float(mass.attrib["value"]) > MARKER_KG:
        return False
    forms = [form for geometry in link.findall("*/geometry") for form in geometry]
    texts = [form.get(key, "") for form in forms for key in ("size", "radius", "length")]
    sizes_m = [float(size) for text in texts for size in text.split()]
    return bool(sizes_m) and all(form.tag != "mesh" for form in forms) and max(sizes_m) <= MARKER_M


def _is_point(shape: ET.Element) -> bool:
    """Whether a shape is a sphere of radius 0, as some descriptions state the contact points of a foot."""
    sphere = shape.find("geometry/sphere")
    try:
        return sphere is not None and float(sphere.get("radius", "")) == 0.0
    except ValueError:
        return False  # reported by its reader


def _text(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
