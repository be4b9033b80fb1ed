"""A small humanoid of boxes as a URDF, with the faults that strangers' files have, and archives around it."""

import io
import struct
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

Triple = tuple[float, float, float]
LEG = (
    ("hip_yaw", "z", (0.0, 0.09, -0.08), (-1.0, 1.0), 1.0),
    ("hip_roll", "x", (0.0, 0.0, -0.02), (-0.6, 0.6), 1.0),
    ("hip_pitch", "y", (0.0, 0.0, -0.02), (-1.8, 0.8), 4.0),
    ("knee", "y", (0.0, 0.0, -0.36), (0.0, 2.3), 3.0),
    ("ankle_pitch", "y", (0.0, 0.0, -0.36), (-1.0, 0.8), 0.6),
    ("ankle_roll", "x", (0.0, 0.0, -0.02), (-0.5, 0.5), 1.0),
)
"""Joint, axis, place in its parent, range (rad) and mass of the link behind it (kg), for the left side."""
ARM = (
    ("shoulder_pitch", "y", (0.0, 0.17, 0.35), (-2.5, 1.5), 1.0),
    ("shoulder_roll", "x", (0.0, 0.05, 0.0), (-0.2, 2.2), 1.2),
    ("shoulder_yaw", "z", (0.0, 0.0, -0.12), (-1.5, 1.5), 0.8),
    ("elbow", "y", (0.0, 0.0, -0.14), (-2.2, 0.0), 0.8),
    ("wrist", "z", (0.0, 0.0, -0.20), (-1.5, 1.5), 0.4),
)
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
FOOT = "box"
HALF_SOLE_M = (0.10, 0.045)
SOLE_AHEAD_M = 0.03
SOLE_DROP_M = 0.05


@dataclass
class Humanoid:
    """Changes to the humanoid; ``R_root`` turns the axes of its root link (columns: ahead, left, up)."""

    sides: tuple[str, str] = ("left", "right")
    foot: str = FOOT
    scale: float = 1.0
    mass_scale: float = 1.0
    effort: float | None = 150.0
    velocity: float | None = 8.0
    arms: bool = True
    legs: int = 1
    toes: bool = False
    mesh_feet: str | None = None
    R_root: np.ndarray = field(default_factory=lambda: np.eye(3))

    def urdf(self) -> str:
        """The description."""
        root = ET.Element("robot", name="small")
        self._link(root, "pelvis", 8.0, (0.14, 0.2, 0.12))
        self._joint(root, "waist", "pelvis", "torso", (0.0, 0.0, 0.06), "z", (-1.0, 1.0))
        self._link(root, "torso", 12.0, (0.16, 0.26, 0.36), (0.0, 0.0, 0.2))
        for mirror, side in zip((1.0, -1.0), self.sides, strict=True):
            for pair in range(self.legs):
                name = side if pair == 0 else f"{side}_hind"
                self._limb(root, "pelvis", name, LEG, mirror, foot=self.foot, ahead=-0.4 * pair)
            if self.arms:
                self._limb(root, "torso", side, ARM, mirror, foot=None)
        if not np.array_equal(self.R_root, np.eye(3)):
            _turn(root, self.R_root)
        return ET.tostring(root, encoding="unicode")

    def mjcf(self) -> str:
        """The same robot as an MJCF file, as MuJoCo converts and saves it."""
        spec = mujoco.MjSpec.from_string(self.urdf())
        spec.body("pelvis").add_freejoint()
        spec.compile()
        return str(spec.to_xml())

    def _limb(self, root: ET.Element, trunk: str, side: str, rows, mirror: float, foot: str | None, ahead=0.0) -> None:  # type: ignore[no-untyped-def]
        parent = trunk
        for index, (name, axis, at, (low, high), mass) in enumerate(rows):
            link = f"{side}_{name}_link"
            place = (at[0] + (ahead if index == 0 else 0.0), mirror * at[1], at[2])
            limits = (low, high) if mirror > 0 or axis == "y" else (-high, -low)
            self._joint(root, f"{side}_{name}", parent, link, place, axis, limits)
            last = index == len(rows) - 1
            length = 0.08 if last else abs(rows[index + 1][2][2])
            if last and foot is not None:
                self._foot(root, link, mass, foot)
            else:
                size = (0.06, 0.06, max(0.7 * length, 0.02))
                self._link(root, link, mass, size, (0.0, 0.0, -0.5 * length))
            parent = link
        if foot is not None and self.toes:
            self._joint(root, f"{side}_toe", parent, f"{side}_toes", (0.13, 0.0, -0.04), "y", (-0.8, 0.1))
            self._link(root, f"{side}_toes", 0.2, (0.05, 0.08, 0.02))

    def _foot(self, root: ET.Element, name: str, mass: float, kind: str) -> None:
        x, y = HALF_SOLE_M
        link = self._link(root, name, mass, (2 * x, 2 * y, 0.04), (SOLE_AHEAD_M, 0.0, 0.02 - SOLE_DROP_M))
        body = link.find("collision/geometry")
        assert body is not None
        if kind != "box" or self.mesh_feet is not None:
            body.clear()
        if self.mesh_feet is not None:
            ET.SubElement(body, "mesh", filename=self.mesh_feet)
        elif kind == "sphere":
            ET.SubElement(body, "sphere", radius=str(0.03 * self.scale))
        elif kind == "wheel":
            ET.SubElement(body, "cylinder", radius=str(0.12 * self.scale), length=str(0.12 * self.scale))
            origin = link.find("collision/origin")
            assert origin is not None
            origin.set("rpy", "1.5707963 0 0")

    def _link(self, root: ET.Element, name: str, mass: float, size: Triple, at: Triple = (0.0, 0.0, 0.0)) -> ET.Element:
        link = ET.SubElement(root, "link", name=name)
        inertial = ET.SubElement(link, "inertial")
        s, m = self.scale, mass * self.mass_scale
        xyz = " ".join(str(s * v) for v in at)
        ET.SubElement(inertial, "origin", xyz=xyz, rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=str(m))
        a, b, c = ((s * edge) ** 2 for edge in size)
        moments = {"ixx": b + c, "iyy": a + c, "izz": a + b}
        values = {key: str(m * moments.get(key, 0.0) / 12) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
        ET.SubElement(inertial, "inertia", values)
        for kind in ("visual", "collision"):
            shape = ET.SubElement(link, kind)
            ET.SubElement(shape, "origin", xyz=xyz, rpy="0 0 0")
            ET.SubElement(ET.SubElement(shape, "geometry"), "box", size=" ".join(str(s * edge) for edge in size))
        return link

    def _joint(
        self, root: ET.Element, name: str, parent: str, child: str, at: Triple, axis: str, limits: tuple[float, float]
    ) -> None:
        joint = ET.SubElement(root, "joint", name=name, type="revolute")
        ET.SubElement(joint, "origin", xyz=" ".join(str(self.scale * v) for v in at), rpy="0 0 0")
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "axis", xyz=" ".join(map(str, AXES[axis])))
        stated = {"effort": self.effort, "velocity": self.velocity, "lower": limits[0], "upper": limits[1]}
        ET.SubElement(joint, "limit", {key: str(value) for key, value in stated.items() if value is not None})


def _turn(root: ET.Element, R: np.ndarray) -> None:
    """Describe what is fixed to the pelvis in turned axes."""
    from support.robots.scenario_bodies import _turn as turn_element

    link = next(each for each in root.findall("link") if each.attrib["name"] == "pelvis")
    for tag in ("inertial", "visual", "collision"):
        for element in link.findall(tag):
            turn_element(element, R.T)
    for joint in root.findall("joint"):
        parent = joint.find("parent")
        assert parent is not None
        if parent.attrib["link"] == "pelvis":
            turn_element(joint, R.T)


def archive(files: Mapping[str, bytes | str]) -> bytes:
    """A zip of ``files`` by name."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as target:
        for name, content in files.items():
            target.writestr(name, content)
    return packed.getvalue()


def box_stl(half: Triple, at: Triple = (0.0, 0.0, 0.0)) -> bytes:
    """A box as binary STL."""
    corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * half + at
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel(), 0) for face in faces)
    return bytes(80) + struct.pack("<I", len(faces)) + body


def prism_stl(outline: np.ndarray, height: float) -> bytes:
    """A convex outline ``(n, 2)``, counterclockwise, between half the height below and above 0, as binary STL."""
    n = len(outline)
    low, high = (np.column_stack([outline, np.full(n, z)]) for z in (-0.5 * height, 0.5 * height))
    corners = [(high[0], high[k], high[k + 1]) for k in range(1, n - 1)]
    corners += [(low[0], low[k + 1], low[k]) for k in range(1, n - 1)]
    for k in range(n):
        a, b = k, (k + 1) % n
        corners += [(low[a], low[b], high[b]), (low[a], high[b], high[a])]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *np.array(face).ravel(), 0) for face in corners)
    return bytes(80) + struct.pack("<I", len(corners)) + body
