"""Converts an MJCF file, compiled by MuJoCo, to the elements of a URDF and one mesh file per mesh.

A link is a body, shifted to the anchor of its joint, so that the joint is at the link's origin. Angles are relative to
the initial configuration of the model (``qpos0``), in which all joints of the URDF are at zero.
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
from stridelab.robots.proposal.archive import UnpackedRobot
from stridelab.robots.proposal.description import invalid
from stridelab.robots.proposal.meshes import binary_stl

IGNORED: Final = (
    "contact", "custom", "deformable", "extension", "keyframe", "option",
    "sensor", "size", "statistic", "tendon", "visual",
)  # fmt: skip
"""Sections that neither masses, joints, shapes nor torque limits depend on."""
_CLOSING: Final = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
_MESSAGE_LENGTH: Final = 300


def urdf_of_mjcf(
    root: ET.Element, upload: UnpackedRobot, folder: Path
) -> tuple[ET.Element, UnpackedRobot, dict[str, str]]:
    """URDF of an MJCF file, the upload with its meshes as files of ``folder``, and what was changed.

    Raises ``UnreadableFile`` (``robot-data-unreadable``) for a model that MuJoCo does not compile or that includes
    other files, ``InvalidInput`` (``robot-description-invalid``) for meshes that are missing, several joints of one
    body and ball joints.
    """
    model = _compile(root, upload)
    if faults := list(_joint_faults(model)):
        raise invalid(faults)
    converter = _Converter(model, folder)
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
        if model.eq_type[i] in _CLOSING
    }
    return urdf, replace(upload, meshes=converter.meshes), changed


def _compile(root: ET.Element, upload: UnpackedRobot) -> mujoco.MjModel:
    """Compile the parts of the model that a description needs; meshes come from the upload alone."""
    for section in list(root):
        if section.tag in IGNORED:
            root.remove(section)
    if root.find(".//include") is not None:
        message = "The MJCF file includes other files; compile it to one file, as MuJoCo's viewer does with Save xml."
        raise _unreadable(message, str(upload.inside))
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
            missing.append(Fault(stated[:120], "the zip has no such mesh"))
            continue
        mesh.attrib.setdefault("name", PurePosixPath(stated).stem)
        mesh.set("file", f"mesh-{k:04d}{path.suffix}")
        assets[f"mesh-{k:04d}{path.suffix}"] = path.read_bytes()
    if missing:
        raise invalid(missing)
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"), assets=assets)
        return spec.compile()
    except (ValueError, KeyError, mujoco.FatalError) as error:
        text = " ".join(str(error).split())[:_MESSAGE_LENGTH]
        raise _unreadable(f"MuJoCo does not compile the MJCF file: {text}", str(upload.inside)) from error


def _unreadable(message: str, filename: str) -> UnreadableFile:
    return UnreadableFile("robot-data-unreadable", message, [Fault(filename[:120], "cannot be read")])


def _joint_faults(model: mujoco.MjModel) -> Iterator[Fault]:
    """Joints that a URDF cannot have; those of a body on the world are its floating base."""
    for body in range(1, model.nbody):
        if model.body_parentid[body] == 0:
            continue
        where = f"body {_body_name(model, body)}"
        if model.body_jntnum[body] > 1:
            yield Fault(where, f"it has {model.body_jntnum[body]} joints; give each joint a body with a mass")
        elif model.body_jntnum[body] and model.jnt_type[model.body_jntadr[body]] == mujoco.mjtJoint.mjJNT_BALL:
            yield Fault(where, "it has a ball joint; replace it by hinges of bodies of their own")


def _body_name(model: mujoco.MjModel, body: int) -> str:
    return model.body(body).name or f"body-{body}"


class _Converter:
    """Adds the links and joints of bodies to a URDF; ``meshes`` are the files of their meshes."""

    def __init__(self, model: mujoco.MjModel, folder: Path) -> None:
        self._model, self._folder = model, folder
        self.meshes: dict[PurePosixPath, Path] = {}
        self._anchor_m = np.zeros((model.nbody, 3))
        """Origin of each link in the frame of its body."""
        for body in range(1, model.nbody):
            if model.body_jntnum[body] and model.body_parentid[body] != 0:
                self._anchor_m[body] = model.jnt_pos[model.body_jntadr[body]]

    def add_body(self, urdf: ET.Element, body: int) -> None:
        """Add the link of a body, and the joint above it unless its parent is the world."""
        model, anchor_m = self._model, self._anchor_m[body]
        link = ET.SubElement(urdf, "link", name=_body_name(model, body))
        if model.body_mass[body] > 0.0:
            inertial = ET.SubElement(link, "inertial")
            _add_origin(inertial, model.body_ipos[body] - anchor_m, model.body_iquat[body])
            ET.SubElement(inertial, "mass", value=repr(float(model.body_mass[body])))
            xx, yy, zz = (repr(float(value)) for value in model.body_inertia[body])
            ET.SubElement(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy="0", ixz="0", iyz="0")
        for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
            self._add_geom(link, geom, anchor_m)
        if model.body_parentid[body] != 0:
            self._add_joint(urdf, body)

    def _add_joint(self, urdf: ET.Element, body: int) -> None:
        model, parent = self._model, int(self._model.body_parentid[body])
        name, kind = f"{_body_name(model, body)}_fixed", "fixed"
        if model.body_jntnum[body]:
            j = int(model.body_jntadr[body])
            name = model.joint(j).name or f"{_body_name(model, body)}_joint"
            kind = "revolute" if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE else "prismatic"
        joint = ET.SubElement(urdf, "joint", name=name, type=kind)
        turned = pin.Quaternion(*_parts(model.body_quat[body])).toRotationMatrix() @ self._anchor_m[body]
        _add_origin(joint, model.body_pos[body] + turned - self._anchor_m[parent], model.body_quat[body])
        ET.SubElement(joint, "parent", link=_body_name(model, parent))
        ET.SubElement(joint, "child", link=_body_name(model, body))
        if kind == "revolute":
            ET.SubElement(joint, "axis", xyz=_text(model.jnt_axis[j]))
            lower, upper = (
                model.jnt_range[j] - model.qpos0[model.jnt_qposadr[j]] if model.jnt_limited[j] else (0.0, 0.0)
            )
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


def _add_origin(element: ET.Element, position_m: Vector3, wxyz: np.ndarray) -> None:
    rpy = pin.rpy.matrixToRpy(pin.Quaternion(*_parts(wxyz)).toRotationMatrix())
    ET.SubElement(element, "origin", xyz=_text(position_m), rpy=_text(rpy))


def _parts(wxyz: np.ndarray) -> tuple[np.float64, ...]:
    """Arguments of ``pin.Quaternion``, whose first is the real part."""
    return tuple(np.asarray(wxyz, dtype=np.float64))


def _text(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
