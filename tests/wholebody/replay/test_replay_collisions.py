"""What the replay says of motions in which the body touches what it is not planned to touch."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from experiments.execution import replay_motion, whole_body_problem
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.solver import solve
from stridelab.contacts import sequence_swings
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import (
    HRP2,
    TALOS,
    Scenario,
    Timing,
    both_feet,
    box,
    contact,
    ground,
    move_effector,
    phase,
    scenario,
)
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Box, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.store import load_proxies
from stridelab.robots.loader import load_robot
from stridelab.robots.proposal.propose import propose_card, rebuild_description
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision
from stridelab.wholebody.certificate.certificate import Certificate
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.collision_avoidance import CollisionAvoidance
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.effector_contact import OwnSurfaces
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.log import Collision, MissedCondition, Replay, TorquePeak, missed_conditions
from stridelab.wholebody.replay.mujoco_model import build_simulation
from stridelab.wholebody.replay.replay import PhysicsReplay
from stridelab.wholebody.replay.simulation import Simulation
from support.robots.humanoid import HALF_SOLE_M, Humanoid, archive, box_stl

BEAM_M = 0.20
BEAM_TOP_M = 0.10
TABLE_TOP_M = 0.75


def narrow_beam(n_steps: int = 3, step_m: float = 0.25, foot_y_m: float = 0.03) -> Scenario:
    """HRP-2 along a beam 0.20 m wide, one foot before the other: a leg that swings goes through the other one."""
    timing = Timing(1.5, 1.2, 0.3)
    x_m = {"right_foot": 0.0, "left_foot": step_m}
    y_m = {"right_foot": -foot_y_m, "left_foot": foot_y_m}
    standing = {name: contact(name, (x_m[name], y_m[name], BEAM_TOP_M)) for name in x_m}
    phases = [phase(timing.ends_s, standing)]
    for i in range(n_steps):
        name = ("right_foot", "left_foot")[i % 2]
        x_m[name] = max(x_m.values()) + step_m
        phases += move_effector(standing, contact(name, (x_m[name], y_m[name], BEAM_TOP_M)), timing)
    phases[-1]["duration_s"] = timing.ends_s
    beam = box("beam", (-0.5, 4.0), (-BEAM_M / 2, BEAM_M / 2), (0.0, BEAM_TOP_M))
    return scenario("A narrow beam", "Feet one before the other.", HRP2.robot, [ground(), beam], phases)


def both_hands_on_a_table(edge_x_m: float = 0.35, hand_x_m: float = 0.50, hand_y_m: float = 0.30) -> Scenario:
    """TALOS puts both hands on a table, its way up to them leading through the edge, then the right foot back."""
    timing = Timing(2.0, 1.6, 0.3)
    standing = both_feet(TALOS, 0.0, 0.0)
    phases = [phase(timing.ends_s, standing)]
    for name, y_m in (("left_hand", hand_y_m), ("right_hand", -hand_y_m)):
        phases += move_effector(standing, contact(name, (hand_x_m, y_m, TABLE_TOP_M)), timing)
    phases += move_effector(standing, contact("right_foot", (-0.2, -TALOS.foot_y_m, 0.0)), timing)
    phases[-1]["duration_s"] = timing.ends_s
    table = box("table", (edge_x_m, edge_x_m + 0.8), (-0.6, 0.6), (TABLE_TOP_M - 0.04, TABLE_TOP_M), friction=0.6)
    return scenario("Hands on a table", "Both hands, then a step back.", TALOS.robot, [ground(), table], phases)


FAR_BELOW = Terrain((Box("ground", Placement.from_wxyz([0.0, 0.0, -10.0]), np.array([1.0, 1.0, 1.0])),))
UNSURE_M = 5e-4
"""Two libraries may disagree about shapes that are nearer than this to just touching."""


@dataclass(frozen=True, eq=False)
class Harsh:
    certificate: Certificate
    replay: Replay

    def failed(self) -> set[str]:
        return {check.name for check in self.certificate.checks if not check.passed}

    def codes(self) -> set[str]:
        return {remark.code for remark in self.replay.remarks}

    def message(self, code: str) -> str:
        return next(remark.message for remark in self.replay.remarks if remark.code == code)


@cache
def carried_out(name: str, controller: WholeBodyController | None = None) -> Harsh:
    scenario: Scenario = {"beam": narrow_beam, "table": both_hands_on_a_table}[name]()
    robot, proxies = load_robot(scenario["robot"]), load_proxies(scenario["robot"])
    sequence = sequence_of(scenario, effector_shapes(robot.name))
    plan = solve(whole_body_problem(robot, sequence, proxies))
    motion = (controller or WholeBodyController()).run(robot, sequence, plan)
    return Harsh(certify(robot, sequence, plan, proxies, motion), replay_motion(robot.name, motion))


@pytest.mark.parametrize("name", ["talos", "hrp2", "g1"])
def test_the_simulated_body_touches_itself_where_the_certificate_says_it_does(name: str) -> None:
    """MuJoCo's contacts against the distances of coal, in random postures."""
    robot = load_robot(name)
    built = build_simulation(robot, FAR_BELOW, 0.3, ("left_foot", "right_foot"))
    geometry, results = robot.full_collision, robot.full_collision.createData()
    links = [str(robot.model.frames[part.parentFrame].name) for part in geometry.geometryObjects]
    data, rng, met = robot.model.createData(), np.random.default_rng(11), 0
    for _ in range(12):
        q = pin.integrate(robot.model, robot.q_reference, 0.5 * rng.normal(size=robot.model.nv))
        q[7:] = np.clip(q[7:], robot.model.lowerPositionLimit[7:], robot.model.upperPositionLimit[7:])
        pin.computeDistances(robot.model, data, geometry, results, q)
        deep: set[frozenset[str]] = set()
        possible: set[frozenset[str]] = set()
        for pair, result in zip(geometry.collisionPairs, results.distanceResults, strict=True):
            both = frozenset((links[pair.first], links[pair.second]))
            if result.min_distance < -UNSURE_M:
                deep.add(both)
            if result.min_distance < UNSURE_M:
                possible.add(both)
        simulation = Simulation(built, q)
        simulation.step(np.zeros(len(robot.joint_names)), np.zeros(len(robot.locked)))
        touched = {frozenset((built.link[touch.first], built.link[touch.second])) for touch in simulation.body_contacts}
        assert deep <= touched <= possible
        met += len(deep)
    assert met > 5, "the postures are wild enough to show something"


def test_a_gripper_motor_that_touches_the_thigh_is_neither_certified_nor_completed(
    talos: Robot, swaying: tuple[CentroidalPlan, WholeBodyMotion]
) -> None:
    """The motor is not among the shapes that sampling checks, and no other shape of the arm comes near the thigh."""
    plan, motion = swaying
    inwards_rad = 0.9 * np.array([-0.135, 0.063, 0.197, 0.212, -0.067, 0.203, 0.126])
    joints = [talos.joint_names.index(f"arm_right_{k}_joint") for k in range(1, 8)]
    w = 2.0 * np.pi / motion.time_s[-1]
    q, v = motion.q.copy(), motion.v.copy()
    q[:, np.array(joints) + 7] += np.outer(0.5 - 0.5 * np.cos(w * motion.time_s), inwards_rad)
    v[:, np.array(joints) + 6] += np.outer(0.5 * w * np.sin(w * motion.time_s), inwards_rad)
    touching = replace(motion, q=q, v=v)
    assert not any(SelfCollision(talos).any_collision(one) for one in q[::10])
    certificate = certify(talos, plan.sequence, plan, {}, touching)
    check = next(check for check in certificate.checks if check.name == "self_collision_pairs")
    assert not check.passed
    assert check.effector == "leg_right_3_link and gripper_right_motor_single_link"
    outcome = PhysicsReplay().run(talos, plan.sequence, touching, lambda *_: None)
    assert not outcome.completed
    assert {one.first for one in outcome.collided} | {one.second for one in outcome.collided} == {
        "leg_right_3_link", "gripper_right_motor_single_link"
    }  # fmt: skip
    assert PhysicsReplay().run(talos, plan.sequence, motion, lambda *_: None).completed


def test_a_beam_is_walked_with_the_swinging_leg_around_the_standing_one() -> None:
    outcome = carried_out("beam")
    assert outcome.failed() == set()
    assert outcome.replay.completed
    assert outcome.replay.collided == ()


def test_legs_that_cross_on_a_beam_meet_and_the_robot_falls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Straight swings that nothing keeps apart.

    A replay in which legs could not touch each other came to its end with a CoM error of 0.9 mm.
    """
    monkeypatch.setattr(sequence_swings, "passing_shift_m", lambda *_: np.zeros(3))
    careless = WholeBodyController(settings=replace(WholeBodyController().settings, avoid=None))
    outcome = carried_out("beam", careless)
    check = next(check for check in outcome.certificate.checks if check.name == "self_collision_pairs")
    assert check.value > 10
    assert outcome.replay.fell
    assert not outcome.replay.completed
    assert {"replay-fell", "replay-collided"} <= outcome.codes()
    first = outcome.replay.collided[0]
    assert first.first.startswith(("LLEG", "RLEG"))
    assert first.second.startswith(("LLEG", "RLEG"))
    assert first.first[0] != first.second[0]
    assert outcome.replay.fall_time_s is not None
    assert first.time_s < outcome.replay.fall_time_s
    assert f"after {outcome.replay.fall_time_s:.1f} s" in outcome.message("replay-fell")


def test_hands_that_hook_a_table_are_neither_certified_nor_completed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both passed: the robot stays on its feet, with 30 mm of slip and 9 times the torque.

    The hands keep to their curves here, which nothing pushes off the table's edge.
    """
    monkeypatch.setattr(CollisionAvoidance, "hand_push_m_s2", lambda *_: np.zeros(3))
    outcome = carried_out("table")
    assert outcome.failed() & {"arm_terrain_distance_min", "terrain_distance_min"}
    replay = outcome.replay
    assert not replay.fell
    assert not replay.completed
    assert {"replay-collided", "replay-slipped", "replay-torque", "replay-hand-off"} <= outcome.codes()
    assert ("left_hand", "table") in {(one.first, one.second) for one in replay.collided}
    assert replay.slip_max_m > 0.02
    assert f"{1e3 * replay.slip_max_m:.0f} mm" in outcome.message("replay-slipped")
    assert f"{replay.torque_ratio_max:.1f} times" in outcome.message("replay-torque")
    assert replay.collisions == len(replay.collided) > 0
    assert min(replay.hand_in_place_shares.values()) < 0.95


GOOD = {
    "fall_time_s": None, "collided": (), "slip_max_m": 0.02, "torque_peak": TorquePeak(1.2, "leg_left_4_joint", 1.0),
    "hand_in_place_shares": {"left_hand": 0.95},
}  # fmt: skip


@pytest.mark.parametrize(
    ("what", "value", "expected"),
    [
        ("fall_time_s", 3.25, MissedCondition("replay-fell", "The robot falls after 3.2 s.")),
        (
            "collided",
            (Collision("a", "b", 1.5, 30.2),),
            MissedCondition(
                "replay-collided", "1 pair touches without being planned to: a and b from 1.50 s, 30 N at most."
            ),
        ),
        (
            "slip_max_m",
            0.0212,
            MissedCondition("replay-slipped", "A loaded foot slips by 21 mm; at most 20 mm are allowed."),
        ),
        (
            "torque_peak",
            TorquePeak(1.31, "leg_left_4_joint", 2.345),
            MissedCondition(
                "replay-torque",
                "The torque command of the left knee reaches 1.3 times its limit at 2.35 s; 1.2 is allowed.",
            ),
        ),
        (
            "hand_in_place_shares",
            {"left_hand": 0.94, "right_hand": 1.0},
            MissedCondition("replay-hand-off", "left_hand is in place for 94% of its contact; 95% is required."),
        ),
    ],
)
def test_each_condition_that_is_missed_is_a_remark_of_its_own(
    what: str, value: object, expected: MissedCondition
) -> None:
    assert missed_conditions(**GOOD) == ()  # type: ignore[arg-type]
    assert missed_conditions(**(GOOD | {what: value})) == (expected,)  # type: ignore[arg-type]


def test_many_collisions_are_counted_and_some_named() -> None:
    many = tuple(Collision("a", f"b{k}", 0.1 * k, 1.0) for k in range(6))
    (outcome,) = missed_conditions(**(GOOD | {"collided": many}))  # type: ignore[arg-type]
    assert outcome.message.startswith("6 pairs touch")
    assert outcome.message.endswith("b3 from 0.30 s, 1 N at most; and 2 more.")


def test_an_effector_is_near_its_own_surfaces_in_the_first_and_last_eighth_of_a_swing() -> None:
    robot = load_robot("talos")
    boxes = [
        Box(name, Placement.from_wxyz([x, 0.0, -0.5]), np.array([1.0, 4.0, 1.0]))
        for name, x in (("here", 0.0), ("level", 1.0), ("there", 3.0))
    ]
    at = {"here": 0.0, "edge": 0.5, "there": 3.0}
    foot = {name: Contact("left_foot", Placement.from_wxyz([x, 0.1, 0.0]), "here", 0.5) for name, x in at.items()}
    there = Contact("left_foot", foot["there"].placement, "there", 0.5)
    phases = (
        ContactPhase(1.0, {"left_foot": foot["here"]}),
        ContactPhase(0.8, {}),
        ContactPhase(1.0, {"left_foot": there}),
        ContactPhase(1.0, {"left_foot": foot["edge"]}),
    )
    own = OwnSurfaces(ContactSequence("x", "talos", 0.5, Terrain.from_surfaces(boxes), phases), robot.effectors)
    assert own.contact_surfaces("left_foot", 0) == {"here"}
    assert own.contact_surfaces("left_foot", 1) == set()
    assert own.contact_surfaces("left_foot", 3) == {"here", "level"}, (
        "the sole stands across the edge of two level boxes"
    )
    for time_s, expected in ((1.09, {"here"}), (1.11, set()), (1.69, set()), (1.71, {"there"})):
        assert own.nearby_surfaces("left_foot", 1, time_s) == expected
    assert own.nearby_surfaces("left_foot", 0, 0.5) == set()


@pytest.mark.parametrize(("thickness_m", "meets_risers"), [(0.003, False), (0.02, True)], ids=["plate", "shoe"])
def test_feet_that_are_thin_plates_are_simulated(thickness_m: float, meets_risers: bool, tmp_path: Path) -> None:
    """Above the guard of its sole nothing is left of a plate, and coplanar points have no hull."""
    mesh = box_stl((*HALF_SOLE_M, 0.5 * thickness_m))
    urdf = Humanoid(arms=False, mesh_feet="package://thin/sole.stl").urdf()
    (tmp_path / "upload").write_bytes(archive({"thin.urdf": urdf, "sole.stl": mesh}))
    assumed = rebuild_description(tmp_path / "upload", "thin.zip", "thin", tmp_path / "robots")
    robot = propose_card("thin", "thin", tmp_path / "robots", assumed).robot
    built = build_simulation(robot, FAR_BELOW, 0.3, ("left_foot", "right_foot"))
    names = [built.model.geom(k).name for k in range(built.model.ngeom)]
    assert any(name.endswith(" above") for name in names) == meets_risers
