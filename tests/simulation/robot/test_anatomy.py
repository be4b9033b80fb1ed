"""Markers and segments of any robot on two legs of six joints: with arms or none, with any axes of the root link."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stridelab.body.joint_centres import joint_centres
from stridelab.body.segment_model import segment_frames
from stridelab.body.segment_tables import load_anthropometry
from stridelab.errors import InvalidInput
from stridelab.robots.loader import load_robot
from stridelab.robots.proposal.propose import propose_card, rebuild_description
from stridelab.robots.robot import Robot
from stridelab.simulation.human.marker_layout import LABELS
from stridelab.simulation.robot.anatomy import RobotAnatomy, require_weight
from stridelab.simulation.robot.markers import marker_places, marker_tracks, segment_table, stature_m
from support.robots.humanoid import Humanoid, archive

LANDMARK = {label: name for name, label in LABELS.items()}
TURNED = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
ROBOTS = {
    "arms": Humanoid(),
    "legs only": Humanoid(arms=False),
    "turned root": Humanoid(R_root=TURNED),
}


def robot_of(humanoid: Humanoid, folder: Path) -> Robot:
    upload = folder / "upload"
    upload.write_bytes(archive({"small.urdf": humanoid.urdf()}))
    assumed = rebuild_description(upload, "small.zip", "small", folder / "robots")
    return propose_card("small", "small", folder / "robots", assumed).robot


@pytest.fixture(scope="module", params=["talos", "hrp2", "g1", *ROBOTS])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    name = request.param
    return robot_of(ROBOTS[name], tmp_path_factory.mktemp("robot")) if name in ROBOTS else load_robot(name)


def walked_postures(robot: Robot, seed: int = 3, n: int = 20) -> np.ndarray:
    """Upright postures with legs, arms and torso about the reference as in a walk."""
    rng = np.random.default_rng(seed)
    anatomy = RobotAnatomy.of_robot(robot)
    q = np.tile(robot.q_reference, (n, 1))
    for chain in (*anatomy.leg.values(), *anatomy.arm.values()):
        for joint in chain:
            if anatomy.is_pitch(joint):
                q[:, robot.model.joints[joint].idx_q] += rng.uniform(-0.4, 0.4, n)
    return q


def test_the_table_gives_the_com_of_walked_postures(robot: Robot) -> None:
    """Exact while standing; in other postures within the lumps that are not rigid (hips of G1, 3 mm)."""
    table, body = segment_table(robot, robot.q_reference), load_anthropometry(None)
    for q, atol in ((robot.q_reference[None], 1e-9), (walked_postures(robot), 5e-3)):
        tracks = {LANDMARK[label]: track for label, track in marker_tracks(robot, q).items()}
        frames = segment_frames(tracks, joint_centres(tracks, body, {}), body)
        com_m = sum(row.mass_fraction * frames[name].point_at(row.com) for name, row in table.segments.items())
        true_m = [pin.centerOfMass(robot.model, robot.model.createData(), one).copy() for one in q]
        np.testing.assert_allclose(com_m, true_m, atol=atol)


def test_every_label_is_on_a_link_and_the_sides_are_mirror_images(robot: Robot) -> None:
    tracks = {LANDMARK[label]: track[0] for label, track in marker_tracks(robot, robot.q_reference[None]).items()}
    assert tracks.keys() == marker_places(robot).keys() <= LABELS.keys()
    for name in (name for name in tracks if name.startswith("l_")):
        np.testing.assert_allclose(tracks[name], tracks[f"r_{name[2:]}"] * [1.0, -1.0, 1.0], atol=0.02)
    assert tracks["l_heel"][0] < tracks["l_mt2"][0], "toes point ahead"
    assert tracks["l_asis"][1] > 0.0 > tracks["r_asis"][1]
    assert tracks["c7"][2] > tracks["l_asis"][2] > tracks["l_knee_lateral"][2] > tracks["l_ankle_lateral"][2] > 0.0


def test_statures_of_the_bundled_robots() -> None:
    assert stature_m(load_robot("talos")) == pytest.approx(1.75, abs=0.02)
    assert stature_m(load_robot("g1")) == pytest.approx(1.32, abs=0.03)


@pytest.mark.parametrize(
    ("humanoid", "reason"),
    [(Humanoid(mass_scale=0.3), "it weighs less than 20 kg")],
)
def test_robots_that_plates_cannot_measure_are_refused(humanoid: Humanoid, reason: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=reason) as refusal:
        require_weight(robot_of(humanoid, tmp_path))
    assert refusal.value.code == "robot-not-recordable"
