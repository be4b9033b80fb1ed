"""Converts an MJCF file, compiled by MuJoCo, to the elements of a URDF and one mesh file per mesh.

A link is a body, shifted to the anchor of its joint, so that the joint is at the link's origin. Angles are relative to
the initial configuration of the model (``qpos0``), in which all joints of the URDF are at zero. A body with several
joints becomes a chain of links: all but the last are small spheres of a share of the body's mass, at the anchor of the
joint below, where they do not change the CoM in any configuration if the second joint and the following ones share
their anchor.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Final

import mujoco
import numpy as np
import pinocchio as pin

from stridelab.conventions import Vector3
from stridelab.errors import Fault, UnreadableFile
from stridelab.robots.inertias import WATER_KG_M3
from stridelab.robots.proposal.archive import UnpackedRobot
from stridelab.robots.proposal.closed_loops import CLOSING, rods_of
from stridelab.robots.proposal.description import MAX_BYTES, MAX_DEPTH, invalid, read_xml
from stridelab.robots.proposal.meshes import binary_stl

IGNORED: Final = (
    "contact", "custom", "deformable", "extension", "keyframe", "option",
    "sensor", "size", "statistic", "tendon", "visual",
)  # fmt: skip
"""Sections that neither masses, joints, shapes nor torque limits depend on."""
REFUSED: Final = {
    **dict.fromkeys(("composite", "flexcomp", "replicate"), "it multiplies bodies; write them out"),
    **dict.fromkeys(("attach", "model"), "it reads another model; write its bodies out"),
}
"""Elements that MuJoCo expands: nested ones take all memory; models are read from any path on the disk."""
_MESSAGE_LENGTH: Final = 300
_MAX_INCLUDED: Final = 64
_MOST_JOINTS: Final = 3
"""Joints of one body, each with a link of its own; the bodies of people's and animals' models have up to three."""
SPHERE_SHARES: Final = (1e-2, 3e-3, 1e-3)
"""Shares of a body's mass that are tried for each further link; the rest must remain a physical body."""


def urdf_of_mjcf(
    root: ET.Element, upload: UnpackedRobot, folder: Path
) -> tuple[ET.Element, UnpackedRobot, dict[str, str]]:
    """URDF of an MJCF file, the upload with its meshes as files of ``folder``, and what was changed.

    Included files are taken from the upload alone. Raises ``UnreadableFile`` (``robot-data-unreadable``) for a model
    that MuJoCo does not compile or an included file that is missing or included twice,
    (``robot-description-too-large``) for too many or too deep elements with these files, ``InvalidInput``
    (``robot-description-invalid``) for meshes that are missing, ball joints but those of rods in closed
    loops, and more than three joints of one body.
    """
    insert_included(root, upload)
    if faults := [Fault(f"<{tag}>", why) for tag, why in REFUSED.items() if next(root.iter(tag), None) is not None]:
        raise invalid(faults)
    model = _compile(root, upload)
    rods = rods_of(model)
    if faults := list(_joint_faults(model, rods)):
        raise invalid(faults)
    converter = _Converter(model, rods, folder)
    urdf = ET.Element("robot", name="robot")
    roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    robot = max(roots, key=lambda body: float(model.body_subtreemass[body]), default=0)
    for body in range(1, model.nbody):
        if model.body_rootid[body] == robot:
            converter.add_body(urdf, body)
    changed = {
        f"body {_body_name(model, body)}": "not a part of the robot, left out" for body in roots if body != robot
    }
    changed |= {
        f"equality {model.equality(i).name or i}": "a closed loop, opened here"
        for i in range(model.neq)
        if model.eq_type[i] in CLOSING
    }
    changed |= {f"body {_body_name(model, body)}": "only closes a loop, fixed here" for body in sorted(rods)}
    return urdf, replace(upload, meshes=converter.meshes), changed | converter.changed


def insert_included(root: ET.Element, upload: UnpackedRobot, left_out: list[str] | None = None) -> None:
    """Replace every ``include`` by the elements of its file, which must be in the upload and is included once.

    With ``left_out``, files that are missing are left out and their names added to it. Raises ``UnreadableFile``
    (``robot-data-unreadable``, ``robot-description-too-large``).
    """
    included: set[Path] = {upload.description}
    left_bytes = MAX_BYTES - upload.description.stat().st_size
    while (parent := next((one for one in root.iter() if one.find("include") is not None), None)) is not None:
        include = parent.find("include")
        if include is None:
            raise AssertionError("the parent of an include has one")
        stated = include.get("file", "")
        path = upload.find_part(stated)
        if path is None and left_out is not None:
            left_out.append(stated)
            parent.remove(include)
            continue
        if path is None or path in included or len(included) > _MAX_INCLUDED:
            reason = "which is not in the zip" if path is None else "a second time, or too many files"
            raise _unreadable_error(f"The MJCF file includes {stated[:120]!r}, {reason}.", str(upload.inside))
        included.add(path)
        left_bytes -= path.stat().st_size
        if left_bytes < 0:
            message = f"The description and the files that it includes exceed {MAX_BYTES / 1e6:g} MB."
            raise _unreadable_error(message, str(upload.inside), "robot-description-too-large")
        at = list(parent).index(include)
        parent.remove(include)
        for k, element in enumerate(read_xml(path, stated)):
            parent.insert(at + k, element)
    if len(included) > 1 and _depth_of(root) > MAX_DEPTH:
        message = "The description is nested too deeply with the files that it includes."
        raise _unreadable_error(message, str(upload.inside), "robot-description-too-large")


def _depth_of(root: ET.Element) -> int:
    """Levels of elements."""
    depth, level = 0, [root]
    while level:
        depth, level = depth + 1, [child for element in level for child in element]
    return depth


def _compile(root: ET.Element, upload: UnpackedRobot) -> mujoco.MjModel:
    """Compile the parts of the model that a description needs; meshes come from the upload alone."""
    for section in list(root):
        if section.tag in IGNORED:
            root.remove(section)
    for parent in root.iter():
        for child in [one for one in parent if one.tag in ("texture", "material", "hfield", "skin", "plugin", "light")]:
            parent.remove(child)
        parent.attrib.pop("material", None)
    for compiler in root.iter("compiler"):
        for name in ("meshdir", "assetdir", "texturedir"):
            compiler.attrib.pop(name, None)
    assets, missing = {}, []
    for k, mesh in enumerate(root.iter("mesh")):
        stated = mesh.get("file")
        if stated is None:
            continue
        path = upload.find_mesh(stated)
        if path is None:
            missing.append(stated)
            continue
        mesh.attrib.setdefault("name", PurePosixPath(stated).stem)
        mesh.set("file", f"mesh-{k:04d}{path.suffix}")
        assets[f"mesh-{k:04d}{path.suffix}"] = path.read_bytes()
    if missing:
        raise invalid(upload.missing_mesh_faults(missing))
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"), assets=assets)
        return spec.compile()
    except (ValueError, KeyError, mujoco.FatalError) as error:
        text = " ".join(str(error).split())[:_MESSAGE_LENGTH]
        raise _unreadable_error(f"MuJoCo does not compile the MJCF file: {text}", str(upload.inside)) from error


def _unreadable_error(message: str, filename: str, code: str = "robot-data-unreadable") -> UnreadableFile:
    return UnreadableFile(code, message, [Fault(filename[:120], "cannot be read")])


def _joint_faults(model: mujoco.MjModel, rods: frozenset[int]) -> Iterator[Fault]:
    """Joints that a URDF cannot have; those of a body on the world are its floating base."""
    for body in range(1, model.nbody):
        if model.body_parentid[body] == 0:
            continue
        where = f"body {_body_name(model, body)}"
        joints = _joints_of(model, body, rods)
        if any(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_BALL for j in joints):
            yield Fault(where, "it has a ball joint; replace it by hinges")
        elif len(joints) > _MOST_JOINTS:
            yield Fault(where, f"it has {len(joints)} joints, more than {_MOST_JOINTS}; give them bodies with a mass")
        elif len(joints) > 1 and _split_inertia(model, body, joints) is None:
            yield Fault(where, f"it has {len(joints)} joints and no mass to divide; give each joint a body with a mass")


def _joints_of(model: mujoco.MjModel, body: int, rods: frozenset[int]) -> range:
    """Joints between a body and its parent, in order; none for ``rods`` and for a base, which floats."""
    first = int(model.body_jntadr[body])
    is_fixed = model.body_parentid[body] == 0 or body in rods
    return range(0) if is_fixed else range(first, first + int(model.body_jntnum[body]))


def _body_inertia(model: mujoco.MjModel, body: int) -> pin.Inertia:
    """Inertia of a body in its frame."""
    R = pin.Quaternion(*_parts(model.body_iquat[body])).toRotationMatrix()
    moments = R @ np.diag(model.body_inertia[body]) @ R.T
    return pin.Inertia(float(model.body_mass[body]), np.array(model.body_ipos[body]), moments)


def _is_physical(body: pin.Inertia) -> bool:
    """Whether the mass and the moments are those of a body."""
    moments = np.linalg.eigvalsh(body.inertia)
    return bool(body.mass > 0.0 and moments[0] > 0.0 and moments[0] + moments[1] >= moments[2] * (1.0 - 1e-9))


def _split_inertia(model: mujoco.MjModel, body: int, joints: range) -> list[pin.Inertia] | None:
    """Inertias of the links of a body's joints, which sum to that of the body; None if no share leaves a body.

    Those of all but the last joint are spheres of water at the anchor of the next joint.
    """
    whole = _body_inertia(model, body)
    if len(joints) < 2:
        return [whole]
    for share in SPHERE_SHARES if whole.mass > 0.0 else ():
        mass_kg = share * whole.mass
        radius_m = (3.0 * mass_kg / (4.0 * np.pi * WATER_KG_M3)) ** (1.0 / 3.0)
        moments = pin.Inertia.FromSphere(mass_kg, radius_m).inertia
        spheres = [pin.Inertia(mass_kg, np.array(model.jnt_pos[j]), moments) for j in joints[1:]]
        rest = whole
        for sphere in spheres:
            rest = rest - sphere
        if _is_physical(rest):
            return [*spheres, rest]
    return None


def _body_name(model: mujoco.MjModel, body: int) -> str:
    return model.body(body).name or f"body-{body}"


class _Converter:
    """Adds the links and joints of bodies to a URDF; ``meshes`` are the files of their meshes."""

    def __init__(self, model: mujoco.MjModel, rods: frozenset[int], folder: Path) -> None:
        self._model, self._rods, self._folder = model, rods, folder
        self.meshes: dict[PurePosixPath, Path] = {}
        self.changed: dict[str, str] = {}
        self._anchor_m = np.zeros((model.nbody, 3))
        """Origin of each link in the frame of its body: the anchor of its last joint."""
        for body in range(1, model.nbody):
            if joints := _joints_of(model, body, rods):
                self._anchor_m[body] = model.jnt_pos[joints[-1]]

    def add_body(self, urdf: ET.Element, body: int) -> None:
        """Add the links of a body, and the joints above them unless its parent is the world."""
        model, anchor_m = self._model, self._anchor_m[body]
        joints = _joints_of(model, body, self._rods)
        *spheres, own = _split_inertia(model, body, joints) or [_body_inertia(model, body)]
        links = [f"{_body_name(model, body)}_below_{self._joint_name(j)}" for j in joints[:-1]]
        for name, sphere, j in zip(links, spheres, joints, strict=False):
            _add_inertial(ET.SubElement(urdf, "link", name=name), sphere, model.jnt_pos[j])
            percent = 100.0 * sphere.mass / float(model.body_mass[body])
            self.changed[f"body {_body_name(model, body)}"] = (
                f"it has {len(joints)} joints; each got a link, all but the last with {percent:.2g} % of its mass"
            )
        link = ET.SubElement(urdf, "link", name=_body_name(model, body))
        if own.mass > 0.0:
            _add_inertial(link, own, anchor_m)
        for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
            self._add_geom(link, geom, anchor_m)
        if model.body_parentid[body] != 0:
            self._add_joints(urdf, body, [*links, _body_name(model, body)])

    def _joint_name(self, j: int) -> str:
        model, body = self._model, int(self._model.jnt_bodyid[j])
        number = f"_{j - model.body_jntadr[body] + 1}" if model.body_jntnum[body] > 1 else ""
        return model.joint(j).name or f"{_body_name(model, body)}_joint{number}"

    def _add_joints(self, urdf: ET.Element, body: int, links: list[str]) -> None:
        """Add the joints from the parent of a body to ``links`` in turn; a fixed one for a body without joints."""
        model, parent = self._model, int(self._model.body_parentid[body])
        joints = _joints_of(model, body, self._rods)
        above, R = _body_name(model, parent), pin.Quaternion(*_parts(model.body_quat[body])).toRotationMatrix()
        first_m = model.jnt_pos[joints[0]] if joints else np.zeros(3)
        origin_m, wxyz = model.body_pos[body] + R @ first_m - self._anchor_m[parent], model.body_quat[body]
        if not joints:
            fixed = ET.SubElement(urdf, "joint", name=f"{links[-1]}_fixed", type="fixed")
            _add_place(fixed, above, links[-1], origin_m, wxyz)
        for j, link in zip(joints, links, strict=False):
            kind = "revolute" if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE else "prismatic"
            joint = ET.SubElement(urdf, "joint", name=self._joint_name(j), type=kind)
            _add_place(joint, above, link, origin_m, wxyz)
            if kind == "revolute":
                self._add_limits(joint, j)
            if j + 1 in joints:
                above, origin_m, wxyz = link, model.jnt_pos[j + 1] - model.jnt_pos[j], np.array([1.0, 0.0, 0.0, 0.0])

    def _add_limits(self, joint: ET.Element, j: int) -> None:
        """Add the axis, the limits and the rotor inertia of a hinge."""
        model = self._model
        ET.SubElement(joint, "axis", xyz=_text(model.jnt_axis[j]))
        lower, upper = model.jnt_range[j] - model.qpos0[model.jnt_qposadr[j]] if model.jnt_limited[j] else (0.0, 0.0)
        limits = {"lower": lower, "upper": upper, "effort": self._torque_nm(j), "velocity": 0.0}
        ET.SubElement(joint, "limit", {key: repr(float(value)) for key, value in limits.items()})
        ET.SubElement(joint, "dynamics", damping="0", armature=repr(float(model.dof_armature[model.jnt_dofadr[j]])))

    def _torque_nm(self, j: int) -> float:
        """Largest torque of the joint's actuators; 0 if none states a limit."""
        model = self._model
        if model.jnt_actfrclimited[j]:
            return float(np.abs(model.jnt_actfrcrange[j]).max())
        limits_nm = [0.0]
        for i in range(model.nu):
            if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT or model.actuator_trnid[i, 0] != j:
                continue
            gear = abs(model.actuator_gear[i, 0])
            if model.actuator_forcelimited[i]:
                limits_nm.append(gear * float(np.abs(model.actuator_forcerange[i]).max()))
            elif model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE and model.actuator_ctrllimited[i]:
                gain = abs(model.actuator_gainprm[i, 0])
                limits_nm.append(gear * gain * float(np.abs(model.actuator_ctrlrange[i]).max()))
        return max(limits_nm)

    def _add_geom(self, link: ET.Element, geom: int, anchor_m: Vector3) -> None:
        """Add a geom: one that nothing can touch is for display only."""
        model, kinds = self._model, mujoco.mjtGeom
        is_collision = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        position_m, wxyz = model.geom_pos[geom] - anchor_m, model.geom_quat[geom]
        kind, size = kinds(int(model.geom_type[geom])), [float(value) for value in model.geom_size[geom]]
        shapes: list[tuple[str, dict[str, str], Vector3]] = []
        if kind == kinds.mjGEOM_MESH:
            shapes.append(("mesh", {"filename": self._mesh_file(int(model.geom_dataid[geom]))}, np.zeros(3)))
        elif kind == kinds.mjGEOM_BOX:
            shapes.append(("box", {"size": _text(2.0 * model.geom_size[geom])}, np.zeros(3)))
        elif kind == kinds.mjGEOM_SPHERE:
            shapes.append(("sphere", {"radius": repr(size[0])}, np.zeros(3)))
        elif kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
            shapes.append(("cylinder", {"radius": repr(size[0]), "length": repr(2.0 * size[1])}, np.zeros(3)))
            if kind == kinds.mjGEOM_CAPSULE:
                shapes += [("sphere", {"radius": repr(size[0])}, np.array([0.0, 0.0, z])) for z in (-size[1], size[1])]
        elif kind == kinds.mjGEOM_ELLIPSOID:
            shapes.append(("mesh", {"filename": self._ellipsoid_file(geom)}, np.zeros(3)))
        rotation = pin.Quaternion(*_parts(wxyz)).toRotationMatrix()
        for form, attributes, offset_m in shapes:
            for role in ("visual", "collision") if is_collision else ("visual",):
                element = ET.SubElement(link, role)
                _add_origin(element, position_m + rotation @ offset_m, wxyz)
                ET.SubElement(ET.SubElement(element, "geometry"), form, attributes)
                if role == "visual":
                    material = ET.SubElement(element, "material", name=f"m{geom}")
                    ET.SubElement(material, "color", rgba=_text(model.geom_rgba[geom]))

    def _mesh_file(self, mesh: int) -> str:
        model = self._model
        at, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertices_m = model.mesh_vert[at : at + model.mesh_vertnum[mesh]]
        faces = model.mesh_face[face : face + model.mesh_facenum[mesh]]
        return self._write_mesh(f"mesh-of-model-{mesh:04d}.stl", vertices_m, faces)

    def _ellipsoid_file(self, geom: int) -> str:
        """A sphere of 16 by 8 facets, stretched to the radii of the ellipsoid."""
        turn, rise = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, np.pi, 9), indexing="ij")
        sphere = np.stack([np.sin(rise) * np.cos(turn), np.sin(rise) * np.sin(turn), np.cos(rise)], axis=-1)
        at = np.arange(16)[:, None] * 9 + np.arange(8)[None]
        faces = np.stack([at, at + 1, at + 10, at, at + 10, at + 9], axis=-1).reshape(-1, 3)
        return self._write_mesh(f"ellipsoid-{geom:04d}.stl", sphere.reshape(-1, 3) * self._model.geom_size[geom], faces)

    def _write_mesh(self, name: str, vertices_m: np.ndarray, faces: np.ndarray) -> str:
        path = self._folder / name
        if not path.exists():
            path.write_bytes(binary_stl(np.asarray(vertices_m, float), np.asarray(faces)))
            self.meshes[PurePosixPath(name)] = path
        return name


def _add_place(joint: ET.Element, parent: str, child: str, position_m: Vector3, wxyz: np.ndarray) -> None:
    _add_origin(joint, position_m, wxyz)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)


def _add_inertial(link: ET.Element, body: pin.Inertia, origin_m: Vector3) -> None:
    """Add an inertia, given in the frame of the body, to a link whose origin is at ``origin_m``."""
    inertial = ET.SubElement(link, "inertial")
    _add_origin(inertial, body.lever - origin_m, np.array([1.0, 0.0, 0.0, 0.0]))
    ET.SubElement(inertial, "mass", value=repr(float(body.mass)))
    rows = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {key: repr(float(body.inertia[at])) for key, at in rows.items()})


def _add_origin(element: ET.Element, position_m: Vector3, wxyz: np.ndarray) -> None:
    rpy = pin.rpy.matrixToRpy(pin.Quaternion(*_parts(wxyz)).toRotationMatrix())
    ET.SubElement(element, "origin", xyz=_text(position_m), rpy=_text(rpy))


def _parts(wxyz: np.ndarray) -> tuple[np.float64, ...]:
    """Arguments of ``pin.Quaternion``, whose first is the real part."""
    return tuple(np.asarray(wxyz, dtype=np.float64))


def _text(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
