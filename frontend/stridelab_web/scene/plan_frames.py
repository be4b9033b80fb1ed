"""A plan as frames: links, forces with their cones, centre of mass, angular momentum, and intervals of contact.

The friction cone of a contact is ``|f_t| <= mu f_n`` about the normal of its surface.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.schemas.scenarios import Scenario
from stridelab_web.parquet import Columns, xyz_columns
from stridelab_web.scene.body_frames import PERSON, body_sticks
from stridelab_web.scene.contacts import PlacedContact, contact_node, effector_side, placed_contacts, side_nodes
from stridelab_web.scene.density_nodes import reach_places, repeated_nodes
from stridelab_web.scene.frames import (
    ARROW_M_PER_N,
    Arrow,
    Body,
    Copy,
    Frames,
    Point,
    Sheet,
    Span,
    Stick,
    Track,
    resample_track,
)
from stridelab_web.scene.shadows import ground_below_m, shadow_points, sole_places_m

POSE, FORCE = 7, 6
COM = "/com/plan"
ROBOT, GHOST, MEASURED = "/robot/", "/ghost/", "/measured/"
"""Groups of nodes: the robot as planned, and as it moved in physics, with the measured forces."""
PALE: Final = ((70, 110, 200), 0.4)
"""Colour and opacity of the replay's robot, which has the meshes of the planned one."""
MOMENTUM: Final = "/momentum/"
MOMENTUM_M_PER_NMS: Final = 0.1
"""Length of the arrow of the angular momentum; it is a few newton metre seconds in walking."""


@dataclass(frozen=True)
class Motion:
    """``poses.json`` with its two arrays: ``poses`` ``(frames, links, 7)``, ``forces`` ``(frames, effectors, 6)``.

    ``ghost`` and ``measured`` are the same of the replay in physics, NaN once the robot has fallen.
    """

    time_s: np.ndarray
    links: tuple[str, ...]
    effectors: tuple[str, ...]
    poses: np.ndarray
    forces: np.ndarray
    ghost: np.ndarray | None = None
    measured: np.ndarray | None = None


def read_motion(about: bytes, poses: bytes, forces: bytes, *replayed: bytes) -> Motion:
    """The motion of ``poses.json``, ``poses.f32`` and ``forces.f32``; ``replayed`` are the arrays of its replay.

    Raises ``ValueError`` if the size of an array contradicts the description.
    """
    description = json.loads(about)
    time_s = np.array(description["time_s"], dtype=float)
    links, effectors = tuple(description["links"]), tuple(description["forces"]["effectors"])
    shapes = [(len(time_s), len(links), POSE), (len(time_s), len(effectors), FORCE)] * 2
    arrays = [
        np.frombuffer(content, "<f4").reshape(shape)
        for content, shape in zip((poses, forces, *replayed), shapes, strict=False)
    ]
    return Motion(time_s, links, effectors, *arrays)


def plan_frames(
    scenario: Scenario,
    centroidal: Columns,
    motion: Motion | None,
    followed: Columns | None = None,
    person: Columns | None = None,
) -> Frames:
    """Frames of a plan; without a whole-body motion those of the centroidal plan alone, at its nodes.

    ``followed`` is the table of that motion, whose angular momentum is shown in place of the planned one.
    ``person`` is the table of the person whose walk is imitated. A cone has its tip at the point of application of its
    force, so that it needs no columns of its own.
    """
    time_s = centroidal["time_s"] if motion is None else motion.time_s
    sheet = Sheet()
    momentum = momentum_nms(centroidal if followed is None else followed, time_s)
    com_at = sheet.add_block(com_m(centroidal, time_s))
    bodies: list[Body] = []
    arrows: list[Arrow] = []
    at_of: dict[str, int] = {}
    if momentum is not None:
        sheet.add_block(MOMENTUM_M_PER_NMS / ARROW_M_PER_N * momentum)
        arrows.append(Arrow(f"{MOMENTUM}com_shaft", f"{MOMENTUM}com_head", com_at, "angular momentum about the CoM"))
    shadows: list[Point] = []
    if motion is not None:
        soles_m = sole_places_m(scenario, motion.poses)
        shadows = shadow_points(
            sheet, ROBOT, soles_m, {foot: ground_below_m(scenario, m) for foot, m in soles_m.items()}
        )
        for k, link in enumerate(motion.links):
            bodies.append(Body(f"{ROBOT}{link}", sheet.add_block(motion.poses[:, k])))
        forces = {effector: motion.forces[:, k] for k, effector in enumerate(motion.effectors)}
        if motion.ghost is not None and motion.measured is not None:
            bodies += [
                Body(f"{GHOST}{link}", sheet.add_block(motion.ghost[:, k])) for k, link in enumerate(motion.links)
            ]
            for k, effector in enumerate(motion.effectors):
                name, at = f"{MEASURED}{effector}", sheet.add_block(motion.measured[:, k])
                arrows.append(Arrow(f"{name}_shaft", f"{name}_head", at, f"force on {effector} in the replay"))
    else:
        forces = centroidal_forces(scenario, centroidal)
    for effector, force in forces.items():
        name = f"/forces/{effector}"
        at_of[effector] = sheet.add_block(force)
        arrows.append(Arrow(f"{name}_shaft", f"{name}_head", at_of[effector], f"force on {effector}"))
    person_com, limbs = person_nodes(person, time_s, sheet)
    ends_s = np.cumsum([phase.duration_s for phase in scenario.phases])
    placed = placed_contacts(scenario)
    loaded = [cone for cone in friction_cones(scenario, centroidal) if cone.touch.effector in at_of]
    coned = [(cone.name, cone.touch) for cone in loaded]
    ghosts = [body.name for body in bodies if body.name.startswith(GHOST)]
    return Frames(
        time_s,
        sheet.to_array(len(time_s)),
        points=(
            Point(COM, com_at, "centre of mass"),
            *person_com,
            *(Point(name, at_of[touch.effector], f"friction cone of {touch.effector}") for name, touch in coned),
            *shadows,
        ),
        bodies=tuple(bodies),
        sticks=limbs,
        arrows=tuple(arrows),
        spans=(
            *(Span(f"{contact_node(touch)}/touching", touch.start_s, touch.end_s) for touch in placed),
            *(Span(name, touch.start_s, touch.end_s) for name, touch in coned),
            *(Span(place.name, place.start_s, place.end_s) for place in reach_places(scenario)),
        ),
        tracks=(Track("/paths/com", com_at),),
        still=(*side_nodes(placed).values(), *(contact_node(touch) for touch in placed)),
        copies=(
            *(Copy(name, f"{ROBOT}{name.removeprefix(GHOST)}", PALE) for name in ghosts),
            *(Copy(name, of) for name, of in (*repeated_cones(loaded), *repeated_nodes(reach_places(scenario)))),
        ),
        phase_starts_s=(0.0, *(float(end) for end in ends_s[:-1])),
    )


def person_nodes(
    person: Columns | None, time_s: np.ndarray, sheet: Sheet
) -> tuple[tuple[Point, ...], tuple[Stick, ...]]:
    """CoM and limbs of the person at ``time_s``, in new blocks of ``sheet``; NaN outside the recording."""
    if person is None:
        return (), ()
    own_s = person["time_s"]
    shown = {name: resample_track(time_s, own_s, column[:, None])[:, 0] for name, column in person.items()}
    com_m = xyz_columns(shown, "com_", "_m")
    label = "centre of mass of the person, scaled"
    com = () if com_m is None else (Point(f"{PERSON}com", sheet.add_block(com_m), label),)
    return com, body_sticks(shown, sheet, PERSON, "")


def momentum_nms(columns: Columns, time_s: np.ndarray) -> np.ndarray | None:
    """Angular momentum about the CoM ``(n, 3)`` at ``time_s``, linear between rows; None where the table has none."""
    rows = xyz_columns(columns, "l_", "_nms")
    return None if rows is None else resample_track(time_s, columns["time_s"], rows)


def com_m(centroidal: Columns, time_s: np.ndarray) -> np.ndarray:
    """Centre of mass ``(n, 3)`` at ``time_s``: from each node with its velocity and acceleration to the next one.

    Exact for constant accelerations between nodes; the remaining constant jerk is that of smooth forces.
    """
    nodes_s = centroidal["time_s"]
    position, velocity = xyz_columns(centroidal, "com_", "_m"), xyz_columns(centroidal, "com_v", "_m_s")
    acceleration = xyz_columns(centroidal, "com_a", "_m_s2")
    if position is None or velocity is None or acceleration is None:
        raise ValueError("the plan's table lacks the centre of mass")
    h = np.diff(nodes_s)[:, None]
    ahead = position[:-1] + velocity[:-1] * h + acceleration[:-1] * h**2 / 2
    jerk = np.concatenate([6.0 * (position[1:] - ahead) / h**3, np.zeros((1, 3))])
    k = np.clip(np.searchsorted(nodes_s, time_s, side="right") - 1, 0, len(nodes_s) - 1)
    dt = np.clip(time_s - nodes_s[k], 0.0, None)[:, None]
    return np.asarray(position[k] + velocity[k] * dt + acceleration[k] * dt**2 / 2 + jerk[k] * dt**3 / 6)


def centroidal_forces(scenario: Scenario, centroidal: Columns) -> dict[str, np.ndarray]:
    """Point of application and force ``(nodes, 6)`` per effector, NaN without contact.

    Without a whole body the point of application in a patch is unknown: forces are drawn from its centre.
    """
    placed = placed_contacts(scenario)
    phase = centroidal["phase"].astype(int)
    by_effector: dict[str, np.ndarray] = {}
    for effector in dict.fromkeys(touch.effector for touch in placed):
        points: list[np.ndarray] = []
        while (force := xyz_columns(centroidal, f"f_{effector}_{len(points)}_", "_n")) is not None:
            points.append(force)
        rows = np.full((len(phase), FORCE), np.nan)
        for touch in placed:
            during = (touch.first_phase <= phase) & (phase <= touch.last_phase)
            if touch.effector == effector and points:
                rows[during, :3] = touch.contact.position_m
                rows[during, 3:] = np.sum(points, axis=0)[during]
        by_effector[effector] = rows
    return by_effector


GROUP: Final = "/cones/"


@dataclass(frozen=True)
class Cone:
    """A contact and the friction coefficient of its surface."""

    touch: PlacedContact
    friction: float

    @property
    def name(self) -> str:
        """Its node in a scene."""
        return f"{GROUP}{self.touch.number}"


def friction_cones(scenario: Scenario, centroidal: Columns) -> tuple[Cone, ...]:
    """Cones of the contacts whose friction is in the plan's table; empty for plans of older versions."""
    phase = centroidal["phase"].astype(int)
    known = []
    for touch in placed_contacts(scenario):
        friction = centroidal.get(f"friction_{touch.effector}")
        during = (touch.first_phase <= phase) & (phase <= touch.last_phase)
        if friction is not None and friction[during].max(initial=0.0) > 0.0:
            known.append(Cone(touch, float(friction[during].max())))
    return tuple(known)


def repeated_cones(shown_cones: Iterable[Cone]) -> list[tuple[str, str]]:
    """Pairs of node names: a cone, and the first one of the same width and colour."""
    first: dict[tuple[float, str], str] = {}
    named = [
        (cone.name, first.setdefault((cone.friction, effector_side(cone.touch.effector)), cone.name))
        for cone in shown_cones
    ]
    return [(name, of) for name, of in named if name != of]
