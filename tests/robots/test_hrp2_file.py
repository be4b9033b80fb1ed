"""The bundled URDF of HRP-2, which is generated from published numbers with primitive shapes."""

import runpy
import tomllib
from pathlib import Path

import coal
import pinocchio as pin
import pytest

from stridelab.machine.models_folder import models_dir
from stridelab.robots import urdf
from stridelab.robots.card import robot_card
from stridelab.robots.data_files import data_files
from stridelab.robots.loader import load_robot
from stridelab.robots.self_collision import SelfCollision


def test_the_file_is_generated_from_the_published_numbers() -> None:
    """scripts/make_hrp2.py was run after the last change of the numbers."""
    script = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "make_hrp2.py"))
    folder = models_dir() / "robots" / "hrp2"
    numbers = tomllib.loads((folder / "numbers.toml").read_text(encoding="utf-8"))
    assert script["urdf"](numbers) == (folder / "hrp2.urdf").read_text(encoding="utf-8")


def test_the_shapes_are_primitive_and_are_what_is_shown() -> None:
    files = data_files(robot_card("hrp2"))
    ours = urdf.full_model(files.urdf)
    shapes = urdf.collision_geometry(ours, files.urdf, (files.package_dir,)).geometryObjects
    looks = urdf.visual_geometry(ours, files.urdf, (files.package_dir,)).geometryObjects
    assert {type(part.geometry) for part in shapes} <= {coal.Box, coal.Cylinder, coal.Sphere}
    assert [part.geometry for part in shapes] == [part.geometry for part in looks]
    assert {ours.frames[part.parentFrame].name for part in shapes} == {
        frame.name for frame in ours.frames if frame.type == pin.FrameType.BODY and frame.name[1:2] != "_"
    }


def test_the_reference_posture_is_free_of_collision_and_within_the_limits_of_the_card() -> None:
    """Placeholders of the source where the card says nothing, our choice where it does."""
    robot = load_robot("hrp2")
    assert not SelfCollision(robot).any_collision(robot.q_reference)
    torque_nm = dict(zip(robot.joint_names, robot.model.effortLimit[6:], strict=True))
    assert (torque_nm["RLEG_JOINT3"], torque_nm["CHEST_JOINT0"], torque_nm["RARM_JOINT0"]) == (250.0, 100.0, 60.0)
    assert robot.model.velocityLimit[6:] == pytest.approx(3.0)
    armature = dict(zip(robot.joint_names, robot.model.armature[6:], strict=True))
    assert (armature["LLEG_JOINT5"], armature["LARM_JOINT0"]) == (0.1, 0.02)
