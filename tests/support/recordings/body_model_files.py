"""Small OpenSim models with a centre of mass in closed form, in the dialects of OpenSim 3 and 4, and their trials."""

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Points, Series

RATE_HZ = 100.0
IDENTITY = "<LinearFunction><coefficients>1 0</coefficients></LinearFunction>"


@dataclass(frozen=True)
class Link:
    """A body and the joint above it: ``kind`` is a class of joints, ``axes`` the inner XML of a CustomJoint."""

    body: str
    kind: str
    parent: str
    place_m: tuple[float, float, float]
    mass_kg: float
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    coordinates: tuple[str, ...] = ()
    axes: str = ""
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


def transform_axes(*axes: tuple[str, str, str], wrapped: bool = False) -> str:
    """SpatialTransform of six (coordinates, axis, function); ``wrapped`` is the dialect of OpenSim 2 and 3."""
    parts = []
    for coordinates, axis, function in axes:
        inner = f"<function>{function}</function>" if wrapped else function
        parts.append(
            f"<TransformAxis><coordinates>{coordinates}</coordinates><axis>{axis}</axis>{inner}</TransformAxis>"
        )
    return f"<SpatialTransform>{''.join(parts)}</SpatialTransform>"


def free_axes(names: Sequence[str], *, wrapped: bool = False) -> str:
    """Tilt, list and rotation about z, x, y, then translations."""
    axes = ("0 0 1", "1 0 0", "0 1 0", "1 0 0", "0 1 0", "0 0 1")
    return transform_axes(*((n, a, IDENTITY) for n, a in zip(names, axes, strict=True)), wrapped=wrapped)


def model_text(links: Sequence[Link], *, version: int = 4, constraints: str = "", extra: str = "") -> str:
    """An .osim file of version 3 or 4."""
    bodies, joints = [], []
    for link in links:
        coordinates = "".join(
            f'<Coordinate name="{name}"><default_value>0</default_value></Coordinate>' for name in link.coordinates
        )
        mass = f"<mass>{link.mass_kg}</mass><mass_center>{_text(link.com_m)}</mass_center>"
        place, turn, origin = _text(link.place_m), _text(link.turn_rad), _text(link.origin_m)
        if version == 3:
            joint = (
                f'<Joint><{link.kind} name="j_{link.body}"><parent_body>{link.parent}</parent_body>'
                f"<location_in_parent>{place}</location_in_parent>"
                f"<orientation_in_parent>{turn}</orientation_in_parent><location>{origin}</location>"
                f"<orientation>{turn}</orientation>"
                f"<CoordinateSet><objects>{coordinates}</objects></CoordinateSet>{link.axes}</{link.kind}></Joint>"
            )
            bodies.append(f'<Body name="{link.body}">{mass}{joint}</Body>')
            continue
        bodies.append(f'<Body name="{link.body}">{mass}</Body>')
        parent = "/ground" if link.parent == "ground" else f"/bodyset/{link.parent}"
        joints.append(
            f'<{link.kind} name="j_{link.body}"><socket_parent_frame>{link.parent}_offset</socket_parent_frame>'
            f"<socket_child_frame>{link.body}_offset</socket_child_frame><coordinates>{coordinates}</coordinates>"
            f'<frames><PhysicalOffsetFrame name="{link.parent}_offset"><socket_parent>{parent}</socket_parent>'
            f"<translation>{place}</translation><orientation>{turn}</orientation></PhysicalOffsetFrame>"
            f'<PhysicalOffsetFrame name="{link.body}_offset"><socket_parent>/bodyset/{link.body}</socket_parent>'
            f"<translation>{origin}</translation><orientation>{turn}</orientation></PhysicalOffsetFrame></frames>"
            f"{link.axes}</{link.kind}>"
        )
    joint_set = f"<JointSet><objects>{''.join(joints)}</objects></JointSet>" if joints else ""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<OpenSimDocument Version="{version}0000"><Model name="small">'
        f"<gravity>0 -9.80665 0</gravity><BodySet><objects>{''.join(bodies)}</objects></BodySet>{joint_set}"
        f"<ConstraintSet><objects>{constraints}</objects></ConstraintSet>{extra}</Model></OpenSimDocument>\n"
    )


def _text(numbers: Sequence[float]) -> str:
    return " ".join(f"{number:.17g}" for number in numbers)


def storage_text(columns: Mapping[str, Series], *, header: str = "Coordinates\ninDegrees=no\n") -> str:
    """A MOT or STO file; the first column is the time."""
    table = np.column_stack(list(columns.values()))
    rows = "\n".join("\t".join(f"{x:.12g}" for x in row) for row in table)
    return f"{header}nRows={len(table)}\nnColumns={len(columns)}\nendheader\n" + "\t".join(columns) + f"\n{rows}\n"


def write_zip(path: Path, members: Mapping[str, str]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(name, text)
    return path


PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz")
MASS_KG = 70.0
_TORSO_KG, _TORSO_M, _LUMBAR_M = 32.0, 0.3, np.array([-0.1, 1.03, 0.0])
_HZ, _SWAY_RAD = 0.9, 0.12


def human_links(*, wrapped: bool = False) -> list[Link]:
    """A standing human of 70 kg whose trunk rocks about the lumbar joint; y up, forwards along x."""
    links = [
        Link(
            "pelvis",
            "CustomJoint",
            "ground",
            (0, 0, 0),
            11.0,
            (-0.07, 0.0, 0.0),
            PELVIS,
            free_axes(PELVIS, wrapped=wrapped),
        ),
        Link("torso", "PinJoint", "pelvis", (-0.1, 0.08, 0), _TORSO_KG, (0, _TORSO_M, 0), ("lumbar_extension",)),
    ]
    for side, out in (("r", 1.0), ("l", -1.0)):
        links += [
            Link(
                f"femur_{side}",
                "BallJoint",
                "pelvis",
                (-0.07, -0.05, 0.09 * out),
                8.5,
                (0, -0.17, 0),
                tuple(f"hip_{k}_{side}" for k in "abc"),
            ),
            Link(
                f"tibia_{side}", "PinJoint", f"femur_{side}", (0, -0.40, 0), 3.5, (0, -0.19, 0), (f"knee_angle_{side}",)
            ),
            Link(f"talus_{side}", "PinJoint", f"tibia_{side}", (0, -0.42, 0), 0.1, (0, 0, 0), (f"ankle_angle_{side}",)),
            Link(f"calcn_{side}", "WeldJoint", f"talus_{side}", (-0.05, -0.04, 0), 1.2, (0.1, 0.03, 0)),
            Link(f"toes_{side}", "WeldJoint", f"calcn_{side}", (0.18, 0, 0), 0.2, (0.03, 0, 0)),
        ]
    return links


def rocking_com_m(time_s: Series) -> Points:
    """Centre of mass of the rocking human in closed form, y up: legs and pelvis rest, the trunk is a pendulum."""
    angle = _angle_rad(time_s)
    hip, torso = np.array([-0.07, 0.9, 0.0]), np.column_stack([-np.sin(angle), np.cos(angle), 0 * angle])
    leg = 8.5 * np.array([0, -0.17, 0]) + 3.5 * np.array([0, -0.59, 0]) + 0.1 * np.array([0, -0.82, 0])
    leg += 1.2 * np.array([0.05, -0.83, 0]) + 0.2 * np.array([0.16, -0.86, 0])
    still = 11.0 * np.array([-0.07, 0.95, 0.0]) + 2.0 * (13.5 * hip + leg)
    return np.asarray((still + _TORSO_KG * (_LUMBAR_M + _TORSO_M * torso)) / MASS_KG)


def _angle_rad(time_s: Series) -> Series:
    return np.asarray(_SWAY_RAD * np.sin(2.0 * np.pi * _HZ * time_s) - 0.05)


def rocking_angles(time_s: Series) -> dict[str, Series]:
    """Columns of the joint angles in radians; coordinates that rest are zero, the pelvis is 0.95 m high."""
    names = [name for link in human_links() for name in link.coordinates]
    columns = {"time": time_s} | {name: np.zeros_like(time_s) for name in names}
    return columns | {"pelvis_ty": np.full_like(time_s, 0.95), "lumbar_extension": _angle_rad(time_s)}


def rocking_forces(time_s: Series, prefix: str = "ground_force") -> dict[str, Series]:
    """Columns of one contact that carries the whole body: f = m (a - g), through the centre of mass."""
    step = 1e-4
    before, com, after = (rocking_com_m(time_s + d) for d in (-step, 0.0, step))
    force = MASS_KG * ((after - 2.0 * com + before) / step**2 + np.array([0.0, GRAVITY_M_S2, 0.0]))
    cop = com - force * (com[:, 1] / force[:, 1])[:, None]
    columns = {"time": time_s}
    for kind, track in (("v", force), ("p", cop)):
        columns |= {f"{prefix}_{kind}{axis}": track[:, i] for i, axis in enumerate("xyz")}
    return columns


def rocking_members(seconds: float = 4.0, *, force_rate_hz: float = 500.0) -> dict[str, str]:
    """Model, joint angles and forces of a trial by file name."""
    time_s, force_s = np.arange(0.0, seconds, 1.0 / RATE_HZ), np.arange(0.0, seconds, 1.0 / force_rate_hz)
    return {
        "subject.osim": model_text(human_links()),
        "rocking_ik.mot": storage_text(rocking_angles(time_s)),
        "rocking_grf.mot": storage_text(rocking_forces(force_s), header="grf\n"),
    }
