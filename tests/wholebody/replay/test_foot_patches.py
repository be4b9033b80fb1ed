"""Feet that are flat beyond their contact rectangle stand on it too, and meet risers as before."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Box, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.robots.proposal.propose import propose_card, rebuild_description
from stridelab.robots.robot import Robot
from stridelab.wholebody.replay.log import ReplayLog
from stridelab.wholebody.replay.mujoco_model import build_simulation
from stridelab.wholebody.replay.simulation import GeomContact, Simulation
from support.robots.humanoid import HALF_SOLE_M, Humanoid, archive, prism_stl

SOLES = ("left_foot", "right_foot")
POINTED = np.array([[-1.0, -1.0], [0.7, -1.0], [1.35, -0.3], [1.35, 0.3], [0.7, 1.0], [-1.0, 1.0]]) * HALF_SOLE_M
"""Outline of a shoe with a pointed toe."""
SUNK_M = 0.006


@pytest.fixture(scope="module")
def pointed(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    folder: Path = tmp_path_factory.mktemp("pointed")
    urdf = Humanoid(arms=False, mesh_feet="package://small/sole.stl").urdf()
    (folder / "upload").write_bytes(archive({"small.urdf": urdf, "sole.stl": prism_stl(POINTED, 0.04)}))
    assumed = rebuild_description(folder / "upload", "small.zip", "small", folder / "robots")
    return propose_card("small", "small", folder / "robots", assumed).robot


def terrain(*boxes: tuple[str, float, float]) -> Terrain:
    """Boxes by name, the x at which they begin, and their height."""
    return Terrain(
        tuple(
            Box(name, Placement.from_wxyz([x_m + 1.0, 0.0, top_m - 0.05]), np.array([2.0, 2.0, 0.1]))
            for name, x_m, top_m in boxes
        )
    )


def contacts_of(robot: Robot, ground: Terrain, sunk_m: float) -> tuple[list[GeomContact], Simulation]:
    """Contacts of the body with the terrain in the reference posture, lowered by ``sunk_m``."""
    built = build_simulation(robot, ground, 0.5, SOLES)
    q = robot.q_reference.copy()
    q[2] -= sunk_m
    simulation = Simulation(built, q)
    simulation.step(np.zeros(len(robot.joint_names)), np.zeros(len(robot.locked)))
    return [one for one in simulation.body_contacts if {one.first, one.second} & built.surface.keys()], simulation


def toe_x_m(robot: Robot) -> float:
    """The foremost point of the left foot in the reference posture."""
    data = robot.model.createData()
    results = robot.collision.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.collision, results, robot.q_reference)
    shapes = robot.collision.geometryObjects
    feet = [k for k, one in enumerate(shapes) if "left_ankle_roll" in one.name]
    return max(float(results.oMg[k].act(p)[0]) for k in feet for p in shapes[k].geometry.points())


def test_the_flat_patch_beside_the_rectangle_is_a_part_of_the_sole(pointed: Robot) -> None:
    half = pointed.effectors["left_foot"].contact_half_size_m
    assert half is not None
    assert half[0] < 1.1 * HALF_SOLE_M[0], "the rectangle leaves the toe out"
    touching, simulation = contacts_of(pointed, terrain(("ground", -1.0, 0.0)), SUNK_M)
    assert touching
    assert {one.sole for one in touching} == set(SOLES)
    log = ReplayLog(pointed, standing(pointed, "ground", 0.0))
    log.record_step(simulation, 0.001)
    assert not log.collided


def test_a_sole_on_a_surface_that_is_not_its_own_collides(pointed: Robot) -> None:
    touching, simulation = contacts_of(pointed, terrain(("ground", -1.0, 0.0)), SUNK_M)
    assert touching
    log = ReplayLog(pointed, standing(pointed, "pit", -1.0))
    log.record_step(simulation, 0.001)
    assert {one.first for one in log.collided} == {"ground"}


def test_a_toe_against_a_riser_is_no_part_of_the_sole(pointed: Robot) -> None:
    ground = terrain(("ground", -1.0, 0.0), ("step", toe_x_m(pointed) - 0.003, 0.03))
    touching, simulation = contacts_of(pointed, ground, 0.0)
    step = [one for one in touching if "step" in {simulation.built.surface.get(geom) for geom in one[:2]}]
    assert step
    assert {one.sole for one in step} == {""}


def standing(robot: Robot, surface: str, top_m: float) -> ContactSequence:
    """Both feet on ``surface`` for a second."""
    places = {name: Placement.from_wxyz([0.0, y_m, top_m]) for name, y_m in zip(SOLES, (0.1, -0.1), strict=True)}
    placed = {name: Contact(name, place, surface, 0.5) for name, place in places.items()}
    ground = terrain(("ground", -1.0, 0.0), ("pit", -1.0, -1.0))
    return ContactSequence("standing", robot.name, 0.5, ground, (ContactPhase(1.0, placed),))
