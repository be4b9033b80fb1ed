"""Whole motions over bundled scenarios: the certificate, torques against the full dynamics, what hands bear, ramps.

The equations of motion are put together here from the mass matrix, the bias and the points' own Jacobians, which
neither the controller nor the certificate does.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from experiments.execution import CASES, replay_motion
from stridelab.centroidal.force_splines import Shape
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.sequence import ContactSequence
from stridelab.reachability.store import load_proxies
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Certificate
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.mujoco_model import build_simulation

WITH_A_HAND = [("talos", "wall-step"), ("talos", "stand-up"), ("hrp2", "wall-step")]
CARRIED_OUT = [*WITH_A_HAND, ("g1", "long-stride")]


@dataclass(frozen=True, eq=False)
class Carried:
    robot: Robot
    sequence: ContactSequence
    plan: CentroidalPlan
    motion: WholeBodyMotion
    certificate: Certificate

    def value(self, check: str) -> float:
        return next(result.value for result in self.certificate.checks if result.name == check)


@cache
def carried_out(robot_name: str, name: str, shape: Shape = "cubic") -> Carried:
    robot, proxies = load_robot(robot_name), load_proxies(robot_name)
    sequence = sequence_of(CASES[robot_name][name](), effector_shapes(robot_name))
    plan = solve(replace(from_rest_to_rest(robot, sequence, proxies), shape=shape))
    assert plan.converged
    motion = WholeBodyController().run(robot, sequence, plan)
    return Carried(robot, sequence, plan, motion, certify(robot, sequence, plan, proxies, motion))


@pytest.mark.parametrize(("robot", "name"), CARRIED_OUT)
def test_a_bundled_motion_passes_every_check(robot: str, name: str) -> None:
    assert [check for check in carried_out(robot, name).certificate.checks if not check.passed] == []


@pytest.mark.parametrize(("robot", "name"), CARRIED_OUT)
def test_torques_and_forces_move_the_body_as_it_moves(robot: str, name: str) -> None:
    """``M a + h = S' tau + sum J_p' f`` to 1e-8 at every sample."""
    result = carried_out(robot, name)
    motion = result.motion
    model, frames = with_contact_frames(result.robot)
    data = model.createData()
    worst = 0.0
    for i in range(len(motion.time_s)):
        pin.computeAllTerms(model, data, motion.q[i], motion.v[i])
        gap = data.M @ motion.a[i] + data.nle
        gap[6:] -= motion.tau_nm[i]
        for effector, points in motion.points_m.items():
            here = pin.updateFramePlacement(model, data, frames[effector])
            J = pin.getFrameJacobian(model, data, frames[effector], pin.LOCAL_WORLD_ALIGNED)
            for p, f in zip(points, motion.forces_n[effector][i], strict=True):
                gap -= (J[:3] - pin.skew(here.rotation @ p) @ J[3:]).T @ f
        worst = max(worst, float(np.abs(gap).max()))
    assert worst < 1e-8
    assert result.value("dynamics_residual") < 1e-8
    assert result.value("torque_residual") < 1e-8


@pytest.mark.parametrize(("robot", "name"), WITH_A_HAND)
def test_a_hand_bears_what_is_planned_and_its_arm_can(robot: str, name: str) -> None:
    """Corrections of the angular momentum are left to the soles."""
    result = carried_out(robot, name)
    borne_n = result.motion.forces_n["right_hand"][:, 0]
    planned_n = np.array([result.plan.forces_at(float(t))["right_hand"][0] for t in result.motion.time_s])
    assert np.linalg.norm(planned_n, axis=1).max() > 1.5
    assert np.linalg.norm(borne_n - planned_n, axis=1).max() < 5.0
    assert 0.0 < result.value("hand_load_share_max") < 1.0


def test_a_hand_on_a_wall_does_not_push_the_robot_over() -> None:
    """Pressed with the 25 N of a rail, HRP-2's CoM came 36 mm off its plan."""
    played = replay_motion("hrp2", carried_out("hrp2", "wall-step").motion)
    assert played.completed
    assert played.com_error_max_m < 0.018  # 36 mm where nothing bounds what it presses
    assert played.landing_error_max_m < 0.003
    assert played.hand_contact_share is not None
    assert played.hand_contact_share > 0.95


def test_undisturbed_long_strides_stay_completed_among_bodies_that_can_touch() -> None:
    """The CoM error was 2.6 mm when only legs met only the terrain."""
    played = replay_motion("talos", carried_out("talos", "long-stride").motion)
    assert played.completed
    assert played.remarks == ()
    assert played.collided == ()
    assert played.com_error_max_m < 0.00265
    assert played.slip_max_m < 0.0016


@pytest.mark.parametrize("robot_name", ["talos", "hrp2", "g1"])
def test_contact_rectangles_are_nested(robot_name: str) -> None:
    """That of the plan inside the body's, the body's inside the simulator's."""
    robot = load_robot(robot_name)
    sequence = sequence_of(CASES[robot_name]["flat-walk"](), effector_shapes(robot_name))
    problem = from_rest_to_rest(robot, sequence, load_proxies(robot_name))
    simulated = build_simulation(robot, sequence.terrain, sequence.friction, sequence.effectors)
    margin_m = WholeBodyController().settings.contact_margin_m
    for name in sequence.effectors:
        planned, moved = (
            np.abs(p).max(axis=0)[:2] for p in (problem.points_m(name), robot.effectors[name].points_m(margin_m))
        )
        touching = simulated.model.geom_size[simulated.geom[name]][:2]
        assert np.all(planned <= moved - 0.004)
        assert np.all(moved <= touching - 0.009)


def test_continuous_plans_load_and_unload_soles_gradually() -> None:
    """The largest change of a sole's force from one sample to the next, as a share of the weight."""

    def jump(result: Carried) -> float:
        forces = np.array([f.sum(axis=1) for f in result.motion.forces_n.values()])
        return float(np.linalg.norm(np.diff(forces, axis=1), axis=2).max() / (9.81 * result.robot.mass_kg))

    stepped, ramped = (carried_out("talos", "long-stride", shape) for shape in ("constant", "cubic"))
    assert ramped.certificate.passed
    assert jump(ramped) < 0.05
    assert jump(stepped) > 0.2
    assert ramped.value("torque_ratio_max_legs_torso") < stepped.value("torque_ratio_max_legs_torso")
