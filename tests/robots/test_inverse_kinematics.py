"""Inverse kinematics of stances: the residual is zero within reach and reported beyond."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from stridelab.robots import inverse_kinematics
from stridelab.robots.inverse_kinematics import ComRegion, IkResult, stand, stand_in_com_region
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot

FEET = {"left_foot": Placement.from_wxyz([0.0, 0.09, 0.0]), "right_foot": Placement.from_wxyz([0.0, -0.09, 0.0])}
STAIR = {"left_foot": Placement.from_wxyz([0.0, 0.09, 0.0]), "right_foot": Placement.from_wxyz([0.3, -0.09, 0.15])}
TURN = (np.cos(0.6), 0.0, 0.0, np.sin(0.6))
TURNED = {
    "left_foot": Placement.from_wxyz([1.0 - 0.09 * np.sin(1.2), 0.09 * np.cos(1.2), 0.5], TURN),
    "right_foot": Placement.from_wxyz([1.0 + 0.09 * np.sin(1.2), -0.09 * np.cos(1.2), 0.5], TURN),
}
RAIL = {**FEET, "right_hand": Placement.from_wxyz([0.22, -0.50, 0.80], (np.cos(0.23), 0.0, -np.sin(0.23), 0.0))}


@pytest.fixture(scope="module")
def talos() -> Robot:
    return load_robot("talos")


def placed(robot: Robot, result: IkResult, effector: str) -> pin.SE3:
    """Forward kinematics of an effector's contact frame, from the link frame up."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, result.q)
    tool = robot.effectors[effector]
    link = data.oMf[robot.model.getFrameId(tool.frame)]
    return link * pin.SE3(tool.T_frame_contact.rotation, tool.T_frame_contact.position_m)


def inside_limits(robot: Robot, result: IkResult) -> bool:
    q = result.q[7:]
    return bool(np.all(q >= robot.model.lowerPositionLimit[7:]) and np.all(q <= robot.model.upperPositionLimit[7:]))


@pytest.mark.parametrize(
    ("placements", "com_m"),
    [
        (FEET, [0.0, 0.0, 0.86]),
        (STAIR, [0.15, -0.02, 0.90]),
        (TURNED, [1.0, 0.0, 1.36]),
        (RAIL, [0.0, 0.02, 0.86]),
    ],
    ids=["feet", "stair", "turned", "rail"],
)
def test_a_stance_within_reach_is_reached(talos: Robot, placements: dict[str, Placement], com_m: list[float]) -> None:
    posture = stand(talos, placements, np.array(com_m))
    assert posture.converged
    assert np.allclose(pin.centerOfMass(talos.model, talos.model.createData(), posture.q), com_m, atol=1e-6)
    for name, target in placements.items():
        here = placed(talos, posture, name)
        assert np.allclose(here.translation, target.position_m, atol=1e-6)
        if talos.effectors[name].kind == "surface":
            assert np.allclose(here.rotation, target.rotation, atol=1e-6)
    assert inside_limits(talos, posture)


def test_the_body_turns_with_its_feet(talos: Robot) -> None:
    straight, turned = stand(talos, FEET, np.array([0.0, 0.0, 0.86])), stand(talos, TURNED, np.array([1.0, 0.0, 1.36]))
    assert np.allclose(turned.q[7:], straight.q[7:], atol=1e-5)


def test_unconstrained_joints_stay_in_the_reference_posture(talos: Robot) -> None:
    com = pin.centerOfMass(talos.model, talos.model.createData(), talos.q_reference)
    data = talos.model.createData()
    pin.framesForwardKinematics(talos.model, data, talos.q_reference)
    feet = {}
    for name in FEET:
        here = data.oMf[talos.model.getFrameId(talos.effectors[name].frame)]
        feet[name] = Placement(here.translation.copy(), here.rotation.copy())
    posture = stand(talos, feet, com)
    assert np.allclose(posture.q, talos.q_reference, atol=1e-6)


@pytest.mark.parametrize(
    ("placements", "com_m", "worst_m"),
    [
        (FEET, [0.0, 0.0, 1.30], 0.1),
        ({**FEET, "right_hand": Placement.from_wxyz([1.5, -0.5, 0.8])}, [0.0, 0.0, 0.86], 0.3),
    ],
    ids=["too high", "out of the arm's reach"],
)
def test_a_stance_out_of_reach_is_reported(
    talos: Robot, placements: dict[str, Placement], com_m: list[float], worst_m: float
) -> None:
    posture = stand(talos, placements, np.array(com_m))
    assert not posture.converged
    assert posture.error_m > worst_m / 2
    assert inside_limits(talos, posture)
    data = talos.model.createData()
    errors = {name: placed(talos, posture, name).translation - target.position_m for name, target in placements.items()}
    errors["centre of mass"] = pin.centerOfMass(talos.model, data, posture.q) - np.array(com_m)
    away = {name: float(np.linalg.norm(e)) for name, e in errors.items()}
    assert posture.error_m == pytest.approx(max(away.values()), abs=1e-9)
    assert posture.worst == max(away, key=lambda name: away[name])


def test_the_initial_posture_can_be_given(talos: Robot) -> None:
    start = talos.q_reference.copy()
    arm = 7 + talos.joint_names.index("arm_left_4_joint")
    start[arm] = -1.5
    posture = stand(talos, FEET, np.array([0.0, 0.0, 0.86]), start)
    assert posture.converged
    assert posture.q[arm] == pytest.approx(-1.5, abs=0.05)


def test_an_unknown_effector_is_refused(talos: Robot) -> None:
    with pytest.raises(InvalidInput) as refused:
        stand(talos, {"tail": Placement.identity()}, np.zeros(3))
    assert refused.value.code == "effector-unknown"


@pytest.mark.parametrize("placements", [FEET, STAIR, RAIL], ids=["feet", "stair", "rail"])
def test_the_quick_search_ends_at_the_same_posture(talos: Robot, placements: dict[str, Placement]) -> None:
    com_m = np.mean([placements[name].position_m for name in FEET], axis=0) + np.array([0.0, 0.0, 0.84])
    thorough, quick = (stand(talos, placements, com_m, is_quick=quick) for quick in (False, True))
    assert quick.converged
    assert max(quick.error_m, quick.error_rad) < 1e-5
    assert np.abs(quick.q - thorough.q).max() < 0.02


def test_a_stance_out_of_reach_is_out_of_reach_of_the_quick_search(talos: Robot) -> None:
    far = {**FEET, "right_foot": Placement.from_wxyz([1.5, -0.09, 0.0])}
    thorough, quick = (stand(talos, far, np.array([0.75, 0.0, 0.84]), is_quick=quick) for quick in (False, True))
    assert not quick.converged
    assert quick.error_m == pytest.approx(thorough.error_m, rel=0.1)


@pytest.mark.parametrize(("stride_m", "converges", "most_steps"), [(0.8, True, 25), (1.4, False, 60)])
def test_a_search_between_stretched_legs_ends_soon(
    talos: Robot, stride_m: float, converges: bool, most_steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Near straight knees steps that go forth and back are halved; out of reach, the error soon falls no further."""
    steps: list[float] = []
    problem = inverse_kinematics._Problem
    bounded_step = problem.bounded_step

    def count(*arguments: Any) -> np.ndarray:
        dq = bounded_step(*arguments)
        steps.append(float(np.abs(dq).max()))
        return dq

    monkeypatch.setattr(problem, "bounded_step", count)
    apart = {**FEET, "left_foot": Placement.from_wxyz([stride_m, 0.09, 0.0])}
    corners_m = np.array([[-0.1, -0.15], [stride_m + 0.1, -0.15], [stride_m + 0.1, 0.15], [-0.1, 0.15]])
    posture = stand_in_com_region(
        talos, apart, ComRegion.over_polygon(corners_m), np.array([stride_m / 2.0, 0.0, 0.85])
    )
    assert posture.converged is converges
    assert len(steps) < most_steps
