"""Pressure under the soles: ankle torques, the edges of a sole, the load that both share, the tilt of a narrow one."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import Stairs, climb
from stridelab.pipelines.plan_motion import plan_motion, replay_motion, stage_shares
from stridelab.pipelines.progress import Stages
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.replay.dcm_feedback import CapturePointFeedback, Sole, ankle_torques_nm, ankles_of
from stridelab.wholebody.replay.replay import PhysicsReplay

FEET = ("left_foot", "right_foot")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("talos")


def test_ankle_torques_move_the_centre_of_pressure_where_the_command_says(robot: Robot) -> None:
    """A sole pressed with f at d ahead is in balance under the ankle torques that the stabiliser adds for d."""
    ankles = ankles_of(robot)
    assert set(ankles) == set(FEET)
    for d in ([0.03, 0.0, 0.0], [0.0, 0.02, 0.0], [0.02, -0.01, 0.0]):
        tau = ankle_torques_nm(ankles["left_foot"], np.array(d[:2]), 900.0)
        data = robot.model.createData()
        q = robot.q_reference
        frame = robot.model.getFrameId(robot.effectors["left_foot"].frame)
        J = pin.computeFrameJacobian(robot.model, data, q, frame, pin.LOCAL)
        moment = np.cross(d, [0.0, 0.0, 900.0])
        balance = -(J[3:].T @ moment)[6:]
        assert np.allclose(tau, balance[list(ankles["left_foot"].joints)], atol=1e-6)


HALF_M = {"left_foot": (0.10, 0.06), "right_foot": (0.10, 0.06)}


def soles(load_left_n: float, load_right_n: float, pressure_y_m: float = 0.0) -> dict[str, Sole]:
    pressure = np.array([0.0, pressure_y_m])
    return {
        "left_foot": Sole(np.array([0.0, 0.1, 0.0]), np.eye(3), load_left_n, pressure),
        "right_foot": Sole(np.array([0.0, -0.1, 0.0]), np.eye(3), load_right_n, pressure),
    }


def test_the_tilt_of_a_narrow_sole_hardly_moves_the_centre_of_pressure() -> None:
    shares = {}
    for name in ("talos", "g1"):
        robot = load_robot(name)
        stiffness, _ = PhysicsReplay().joint_gains(robot, 0.001)
        half_m = (robot.effectors["left_foot"].contact_half_size_m or (0.0, 0.0))[1]
        pitch, roll = robot.effectors["left_foot"].ankle or ("", "")
        k = {joint: float(stiffness[robot.joint_names.index(joint)]) for joint in (pitch, roll)}
        # one edge 1 mm lower than the middle: the sole turns by 1 mm / b, and k times this moves the pressure
        shares[name] = k[roll] * (1e-3 / half_m) / (robot.mass_kg * 9.81) / half_m
        if name == "talos":
            assert k[roll] == k[pitch]
        else:
            assert k[roll] < 0.3 * k[pitch]
    assert shares["talos"] == pytest.approx(0.188, abs=1e-3)
    assert shares["g1"] == pytest.approx(0.2)


def test_the_pressure_stays_inside_the_sole_wherever_it_was_planned() -> None:
    capture = CapturePointFeedback(edge_m=0.005)
    for planned_m in (0.0, 0.03, -0.05):
        for y in (5.0, -5.0):
            shifts, _, missed_m = capture.distribute_shift(np.array([9.0, y]), soles(900.0, 1.0, planned_m), HALF_M)
            assert missed_m[0] > 8.0
            assert missed_m[1] * y > 0.0
            assert planned_m + shifts["left_foot"][1] == pytest.approx(np.sign(y) * 0.055)
            assert shifts["left_foot"][0] == pytest.approx(0.095)


def test_what_two_soles_cannot_do_is_done_by_shifting_load() -> None:
    """Pressure and load together move the common centre of pressure by the requested distance."""
    capture, both = CapturePointFeedback(), soles(400.0, 500.0)
    for y in (0.02, 0.075, -0.08):
        shifts, gained, missed_m = capture.distribute_shift(np.array([0.0, y]), both, HALF_M)
        assert gained["left_foot"] == pytest.approx(-gained["right_foot"])
        assert missed_m == pytest.approx([0.0, 0.0], abs=5e-4)
        own = sum(sole.load_n * shifts[name][1] for name, sole in both.items()) / 900.0
        assert own + gained["left_foot"] * 0.2 / 900.0 == pytest.approx(y, abs=5e-4)
    gained = capture.distribute_shift(np.array([0.0, 9.0]), both, HALF_M)[1]
    assert gained["right_foot"] == pytest.approx(45.0 - 500.0), "a twentieth of the weight stays on either sole"


def test_the_integral_does_not_grow_towards_what_the_soles_miss() -> None:
    capture, one_foot = CapturePointFeedback(edge_m=0.005), soles(900.0, 1.0, 0.03)
    del one_foot["right_foot"]
    missed_m = capture.distribute_shift(np.array([0.0, 0.06]), one_foot, HALF_M)[2]
    assert missed_m == pytest.approx([0.0, 0.035])
    assert capture.integrable_m(np.array([0.01, 0.02]), missed_m) == pytest.approx([0.01, 0.0])
    assert capture.integrable_m(np.array([0.01, -0.02]), missed_m) == pytest.approx([0.01, -0.02]), "back towards zero"
    assert capture.integrable_m(np.array([0.01, 0.02]), np.zeros(2)) == pytest.approx([0.01, 0.02])


def test_errors_do_not_grow_from_step_to_step_on_a_flight_of_five() -> None:
    """With an integral that grew all along, 2, 7, 10 and 22 mm, until a step of the recovery met a riser."""
    stairs = Stairs(5, 0.174, 0.285, toe_gap_m=0.06)
    scenario = Scenario.model_validate(climb(stairs, Timing(1.5, 0.98, 0.2), "alternate"))
    request = PlanMotionInput(scenario=scenario, replay=True)
    planned = plan_motion(
        PlanMotionTask(scenario=scenario, input=request), Stages(lambda *_: None, stage_shares(request))
    )
    assert planned.motion is not None
    replay = replay_motion(request, planned.robot, planned.motion, lambda *_: None)
    assert replay.completed, replay.remarks
    assert replay.left_plan is None
    assert replay.com_error_max_m < 0.03
