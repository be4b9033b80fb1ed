"""Ranges of joints whose description states none: as of a person, until links meet."""

import re
from pathlib import Path

import numpy as np
import pytest

from stridelab.robots.proposal.propose import Proposal, propose_card, rebuild_description
from stridelab.robots.self_collision import SelfCollision
from support.robots.humanoid import ARM, LEG, Humanoid, archive

FREE_SHARE = 0.2
"""Least share of random postures within the estimated ranges that are free of collisions."""


def proposal_without_ranges(urdf: str, folder: Path, joints: str = '[^"]*') -> Proposal:
    """Proposal for a description without the ranges of ``joints``, a pattern of their names."""

    def without(joint: re.Match[str]) -> str:
        return re.sub(r' (lower|upper)="[^"]*"', "", joint[0])

    text = re.sub(rf'<joint name="{joints}".*?</joint>', without, urdf)
    (folder / "upload").write_bytes(archive({"small.urdf": text}))
    assumed = rebuild_description(folder / "upload", "small.zip", "small", folder / "robots")
    return propose_card("small", "small", folder / "robots", assumed)


def limits_of(proposal: Proposal) -> dict[str, tuple[float, float]]:
    model = proposal.robot.model
    low, high = model.lowerPositionLimit[7:], model.upperPositionLimit[7:]
    return {name: (float(low[k]), float(high[k])) for k, name in enumerate(proposal.robot.joint_names)}


@pytest.fixture(scope="module")
def without(tmp_path_factory: pytest.TempPathFactory) -> Proposal:
    return proposal_without_ranges(Humanoid().urdf(), tmp_path_factory.mktemp("without"))


def test_legs_bend_as_those_of_a_person(without: Proposal) -> None:
    """The generated humanoid states ranges, which the estimates do not know, that are about a person's."""
    limits = limits_of(without)
    for name, axis, _, (low, high), _ in LEG:
        stated = (low, high) if axis == "y" else (-high, -low)
        assert limits[f"left_{name}"] == pytest.approx((low, high), abs=0.45)
        assert limits[f"right_{name}"] == pytest.approx(stated, abs=0.45)
        assert f"limits.position_rad.left_{name}" in without.assumed
    assert not [key for key in without.assumed if key.endswith(": range")]


def test_sides_are_mirror_images(without: Proposal) -> None:
    limits = limits_of(without)
    for name, axis, *_ in (*LEG, *ARM):
        low, high = limits[f"right_{name}"]
        assert limits[f"left_{name}"] == pytest.approx((low, high) if axis == "y" else (-high, -low), abs=0.11)


def test_turned_axes_turn_the_ranges(tmp_path: Path, without: Proposal) -> None:
    urdf = re.sub(r'(<joint name="left_(?:knee|hip_roll)".*?<axis xyz=")([^"]*)', _against, Humanoid().urdf())
    limits, usual = limits_of(proposal_without_ranges(urdf, tmp_path)), limits_of(without)
    for joint in ("left_knee", "left_hip_roll"):
        low, high = usual[joint]
        assert limits[joint] == pytest.approx((-high, -low), abs=1e-6)


def _against(joint: re.Match[str]) -> str:
    return joint[1] + " ".join(str(-float(value)) for value in joint[2].split())


def test_the_body_seldom_meets_itself_within_the_ranges(without: Proposal) -> None:
    """With half a turn to either side, hardly any posture is free."""
    robot, rng = without.robot, np.random.default_rng(3)
    checker = SelfCollision(robot)
    shares = []
    for low, high in ((robot.model.lowerPositionLimit, robot.model.upperPositionLimit), (-np.pi, np.pi)):
        free = 0
        for _ in range(200):
            q = robot.q_reference.copy()
            q[7:] = rng.uniform(np.broadcast_to(low, q.shape)[7:], np.broadcast_to(high, q.shape)[7:])
            free += not checker.any_collision(q)
        shares.append(free / 200)
    assert shares[0] > FREE_SHARE > shares[1]


def test_stated_ranges_stay(tmp_path: Path) -> None:
    proposal = proposal_without_ranges(Humanoid().urdf(), tmp_path, joints="left_wrist")
    limits = limits_of(proposal)
    assert limits["right_wrist"] == (-1.5, 1.5)
    assert limits["left_knee"] == (0.0, 2.3)
    assert limits["left_wrist"] != (-1.5, 1.5)
    assert [key for key in proposal.assumed if key.startswith("limits.position_rad")] == [
        "limits.position_rad.left_wrist"
    ]
