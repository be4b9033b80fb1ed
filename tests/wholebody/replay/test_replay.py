"""Physics as the judge: free fall, standing, falling, slipping, and what the log says of each."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.disturbances import Disturbances, Push, SensorNoise
from stridelab.wholebody.replay.mujoco_model import build_simulation
from stridelab.wholebody.replay.replay import PhysicsReplay, Replay
from stridelab.wholebody.replay.replay_control import YIELD_RAD, DelayPredictor
from stridelab.wholebody.replay.sensors import JointReadings, SensedState, SimulatedSensors
from stridelab.wholebody.replay.simulation import Simulation

RATE_HZ = 250.0
FEET = ("left_foot", "right_foot")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("talos")


def ground(slope_rad: float = 0.0) -> Terrain:
    turn = Placement.from_wxyz([0.0, 0.0, 0.0], [np.cos(slope_rad / 2), 0.0, np.sin(slope_rad / 2), 0.0])
    return Terrain((Box("ground", turn @ Placement.from_wxyz([0.0, 0.0, -0.5]), np.array([4.0, 4.0, 1.0])),))


def sole(robot: Robot, name: str, q: np.ndarray) -> Placement:
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    frame = data.oMf[robot.model.getFrameId(robot.effectors[name].frame)]
    return Placement(frame.translation.copy(), frame.rotation.copy()) @ robot.effectors[name].T_frame_contact


def standing_still(robot: Robot, duration_s: float, friction: float = 0.7) -> WholeBodyMotion:
    """The reference posture with the torques of statics, the weight shared by both soles."""
    q, n = robot.q_reference, round(duration_s * RATE_HZ) + 1
    model, data = robot.model, robot.model.createData()
    feet = {name: Contact(name, sole(robot, name, q), "ground", friction) for name in FEET}
    sequence = ContactSequence("stand", "talos", friction, ground(), (ContactPhase(duration_s, feet),))
    tau = pin.computeGeneralizedGravity(model, data, q).copy()
    com_m = pin.centerOfMass(model, data, q).copy()
    share = (com_m[1] - feet["right_foot"].placement.position_m[1]) / 0.17
    for name, part in (("left_foot", share), ("right_foot", 1 - share)):
        J = pin.computeFrameJacobian(model, data, q, model.getFrameId(robot.effectors[name].frame), pin.LOCAL)
        pressed = feet[name].placement.inverse().act(com_m[None])[0]
        f_z = part * robot.mass_kg * GRAVITY_M_S2
        tau -= J.T @ [0.0, 0.0, f_z, 0.0, -pressed[0] * f_z, 0.0]
    still = np.zeros((n, model.nv))
    return WholeBodyMotion(
        sequence=sequence, rate_hz=RATE_HZ, time_s=np.arange(n) / RATE_HZ, q=np.tile(q, (n, 1)), v=still, a=still,
        tau_nm=np.tile(tau[6:], (n, 1)), forces_n={}, points_m={}, com_m=np.tile(com_m, (n, 1)),
        com_v_m_s=np.zeros((n, 3)), l_nms=np.zeros((n, 3)), com_reference_m=np.tile(com_m, (n, 1)),
        com_v_reference_m_s=np.zeros((n, 3)), l_reference_nms=np.zeros((n, 3)), failures=(), solve_time_s=0.0,
    )  # fmt: skip


def quiet(_fraction: float, _message: str) -> None:
    pass


def played(robot: Robot, motion: WholeBodyMotion, physics: PhysicsReplay | None = None) -> Replay:
    return (physics or PhysicsReplay()).run(robot, motion.sequence, motion, quiet)


def test_the_simulated_robot_is_the_robot(robot: Robot) -> None:
    rail = Rail("rail", np.array([0.0, -0.6, 0.8]), np.array([1.0, -0.6, 0.8]), 0.02)
    built = build_simulation(robot, Terrain((*ground().boxes, rail)), 0.3, (*FEET, "right_hand"))
    rng = np.random.default_rng(3)
    for _ in range(5):
        q = pin.integrate(robot.model, robot.q_reference, 0.2 * rng.normal(size=robot.model.nv))
        simulation = Simulation(built, q)
        data = robot.model.createData()
        assert simulation.mass_kg == pytest.approx(robot.mass_kg, abs=1e-6)
        assert np.allclose(simulation.com_state()[0], pin.centerOfMass(robot.model, data, q), atol=1e-6)
        for name in (*FEET, "right_hand"):
            expected, result = sole(robot, name, q), simulation.contact_placement(name)
            assert np.allclose(result.position_m, expected.position_m, atol=1e-6)
            assert np.allclose(result.rotation, expected.rotation, atol=1e-6)
        again, v = simulation.coordinates()
        assert np.allclose(again, q, atol=1e-12)
        assert not v.any()


def test_without_contact_the_robot_falls_as_everything_does(robot: Robot) -> None:
    built = build_simulation(robot, ground(), 0.3, FEET)
    q = robot.q_reference.copy()
    q[2] += 2.0
    simulation = Simulation(built, q)
    start_m, _ = simulation.com_state()
    for _ in range(300):
        simulation.step(np.zeros(len(robot.joint_names)), np.zeros(len(robot.locked)))
    simulation.refresh_derived()
    com_m, com_v_m_s = simulation.com_state()
    # implicit steps of 1 ms fall g t dt / 2 farther than the parabola
    assert com_m[2] - start_m[2] == pytest.approx(-0.5 * GRAVITY_M_S2 * 0.3**2, abs=2e-3)
    assert com_v_m_s[2] == pytest.approx(-GRAVITY_M_S2 * 0.3, rel=1e-6)
    assert np.allclose(com_m[:2], start_m[:2], atol=1e-6)
    assert all(np.linalg.norm(force) == 0.0 for force in simulation.forces_n().values())


def test_standing_still_stands_still_and_carries_the_weight(robot: Robot) -> None:
    result = played(robot, standing_still(robot, 1.5))
    assert result.completed
    assert result.fall_time_s is None
    assert result.com_error_max_m < 0.005
    assert result.foot_slip_max_m < 0.002
    assert result.landing_error_max_m < 0.002
    assert result.hand_force_mean_n is None
    weight = robot.mass_kg * GRAVITY_M_S2
    carried = sum(force[-1] for force in result.forces_n.values())
    assert carried[2] == pytest.approx(weight, rel=0.01)
    assert result.time_s[-1] == pytest.approx(1.5 + 1.0), "the last posture is held for a second"
    assert result.q.shape == (len(result.time_s), robot.model.nq)


def test_a_robot_without_torques_falls_and_the_replay_says_when(robot: Robot) -> None:
    motion = standing_still(robot, 3.0)
    limp = PhysicsReplay(stiffness=0.0, damping=0.0, stabiliser=None)
    result = played(robot, replace(motion, tau_nm=np.zeros_like(motion.tau_nm)), limp)
    assert not result.completed
    assert result.fall_time_s is not None
    assert 0.1 < result.fall_time_s < 1.5
    assert result.com_error_max_m >= 0.25
    assert len(result.time_s) < len(motion.time_s)


def test_feet_slip_on_a_slope_steeper_than_the_friction_cone(robot: Robot) -> None:
    motion = standing_still(robot, 1.0)
    slope = 0.04
    tilt = Placement.from_wxyz([0.0, 0.0, 0.0], [np.cos(slope / 2), 0.0, np.sin(slope / 2), 0.0])
    q = motion.q.copy()
    q[:, :3] = tilt.act(q[:, :3])
    base = tilt @ Placement.from_wxyz([0.0, 0.0, 0.0], [q[0, 6], *q[0, 3:6]])
    w, x, y, z = base.wxyz
    q[:, 3:7] = [x, y, z, w]
    leaning = replace(motion, q=q, com_reference_m=tilt.act(motion.com_reference_m))
    slips = {}
    for mu in (0.01, 0.5):
        phases = tuple(
            replace(p, contacts={n: replace(c, placement=tilt @ c.placement) for n, c in p.contacts.items()})
            for p in motion.sequence.phases
        )
        sequence = replace(motion.sequence, friction=mu, terrain=ground(slope), phases=phases)
        slips[mu] = PhysicsReplay().run(robot, sequence, replace(leaning, sequence=sequence), quiet).foot_slip_max_m
    # g (sin a - mu cos a) t^2 / 2 is 0.15 m after one second, and another one follows
    assert slips[0.01] > 0.1
    assert slips[0.5] < 0.01


def test_the_stabiliser_acts_on_the_estimated_state(robot: Robot) -> None:
    def blind(seen: SensedState) -> SensedState:
        """A state estimate that is wrong by 4 cm to the left."""
        return replace(seen, com_m=seen.com_m + np.array([0.0, 0.04, 0.0]))

    motion = standing_still(robot, 1.0)
    physics = PhysicsReplay()
    true = physics.run(robot, motion.sequence, motion, quiet)
    wrong = physics.run(robot, motion.sequence, motion, quiet, observe=blind)
    assert wrong.com_m[-1, 1] < true.com_m[-1, 1] - 0.002, "a robot that estimates itself too far left leans right"


def test_joints_that_move_one_light_body_are_damped_without_overshooting(robot: Robot) -> None:
    """Hips and waist of a light pelvis without rotors: one step of the joint control reverses no motion in full."""
    model = robot.model.copy()
    model.armature = np.full(model.nv, 1e-3) * (np.arange(model.nv) >= 6)
    model.inertias[1] = pin.Inertia(0.3, model.inertias[1].lever, 0.02 * model.inertias[1].inertia)
    light, dt_s = replace(robot, model=model), 0.001
    kp, kd = PhysicsReplay().joint_gains(light, dt_s)
    data = model.createData()
    pin.crba(model, data, robot.q_reference)
    M = np.triu(data.M) + np.triu(data.M, 1).T
    per_torque = np.linalg.inv(M)[6:, 6:]
    # e' <- e' - dt W (K e + D e'), e <- e + dt e'
    slowed = np.eye(len(kp)) - dt_s * per_torque * kd
    pulled = -dt_s * per_torque * kp
    step = np.block([[np.eye(len(kp)) + dt_s * pulled, dt_s * slowed], [pulled, slowed]])
    assert np.abs(np.linalg.eigvals(step)).max() < 1.0
    alone = 1.0 / np.diag(per_torque) / dt_s
    assert (kd <= alone * (1.0 + 1e-9)).all()
    arms = np.array([robot.group[joint] == "arm" for joint in robot.joint_names])
    usual = 10.0 * np.sqrt(kp[arms] / kp[arms].max())  # as much less damping as softer joints need
    assert (kd[arms] > 0.7 * np.minimum(alone[arms], usual)).all(), "the arms do not move the pelvis"


@pytest.mark.parametrize("name", ["talos", "hrp2", "g1"])
def test_the_stiffness_of_an_arm_fits_its_motors(name: str) -> None:
    """TALOS' forearm reached its 3 N m at half a degree while its hand was held by a rail and its foot swung."""
    robot = load_robot(name)
    kp, kd = PhysicsReplay().joint_gains(robot, 0.001)
    arms = np.array([robot.group[joint] == "arm" for joint in robot.joint_names])
    reached_rad = robot.model.effortLimit[6:][arms] / kp[arms]
    assert reached_rad.min() >= YIELD_RAD - 1e-12
    assert (kp[arms] == kp[arms].max()).sum() >= arms.sum() - 6, "only the joints below the elbows of TALOS yield"
    damped = kd[arms] ** 2 / kp[arms]
    assert (damped < 1.01 * damped.max()).all()


def test_a_push_and_a_load_are_survived_and_noticed(robot: Robot) -> None:
    motion = standing_still(robot, 1.5)
    calm = played(robot, motion)
    for disturbed in (
        Disturbances(pushes=(Push(0.3, (0.0, 15.0, 0.0)),)),
        Disturbances(trunk_mass_kg=5.0),
        Disturbances(delay_s=0.008, sensor_noise=SensorNoise(), torque_noise=0.05),
    ):
        result = PhysicsReplay().run(robot, motion.sequence, motion, quiet, disturbances=disturbed)
        assert result.completed
        assert result.com_error_max_m > calm.com_error_max_m + 1e-5, disturbed


@pytest.mark.parametrize("delay_ms", [0, 1, 4, 5, 7, 8, 48, 50])
def test_sensors_are_exactly_as_late_as_the_option_says(robot: Robot, delay_ms: int) -> None:
    """What is seen of a body that falls freely is where it was ``delay_ms`` before."""
    q = robot.q_reference.copy()
    q[2] += 2.0
    simulation = Simulation(build_simulation(robot, ground(), 0.3, FEET), q)
    sensors = SimulatedSensors(simulation, Disturbances(delay_s=1e-3 * delay_ms), substeps=4)
    heights_m, none = [simulation.com_state()[0][2]], (np.zeros(len(robot.joint_names)), np.zeros(len(robot.locked)))
    for k in range(20):
        seen = sensors.read_state(4e-3 * k)
        age = min(delay_ms, 4 * k)
        assert seen.time_s == pytest.approx(1e-3 * (4 * k - age), abs=1e-12)
        assert seen.com_m[2] == pytest.approx(heights_m[4 * k - age], abs=1e-12)
        for j in range(1, 5):
            simulation.step(*none)
            sensors.after_step(j, 1e-3 * (4 * k + j))
            simulation.refresh_derived()
            heights_m.append(simulation.com_state()[0][2])


@pytest.mark.parametrize("delay_ms", [0, 1, 3, 10])
def test_joint_readings_are_exactly_as_late_as_stated(robot: Robot, delay_ms: int) -> None:
    simulation = Simulation(build_simulation(robot, ground(), 0.3, FEET), robot.q_reference)
    joints = JointReadings(simulation, 1e-3 * delay_ms)
    angles, rates = [], []
    for k in range(20):
        angles.append(simulation.joints_rad)
        rates.append(simulation.joint_rates_rad_s)
        q_read, v_read = joints.read_joints()
        np.testing.assert_array_equal(q_read, angles[max(0, k - delay_ms)])
        np.testing.assert_array_equal(v_read, rates[max(0, k - delay_ms)])
        simulation.step(np.full(len(robot.joint_names), 20.0), np.zeros(len(robot.locked)))
    assert (angles[-1] != angles[0]).all()


def test_a_late_joint_loop_falls_where_a_late_stabiliser_stands(
    robot: Robot, two_steps: tuple[ContactSequence, object, WholeBodyMotion]
) -> None:
    """The damping stops a joint within one step of the simulator: 4 ms late, it drives the joint instead."""
    sequence, _, motion = two_steps

    def replayed(physics: PhysicsReplay, disturbed: Disturbances) -> Replay:
        return physics.run(robot, sequence, motion, quiet, disturbances=disturbed)

    both = Disturbances(delay_s=0.004, joint_delay_s=0.004)
    assert replayed(PhysicsReplay(recovery=None), Disturbances(joint_delay_s=0.004)).fell
    assert replayed(PhysicsReplay(), Disturbances(delay_s=0.004)).completed
    assert replayed(PhysicsReplay(stiffness=900.0, damping=30.0), both).completed
    six = Disturbances(delay_s=0.006, joint_delay_s=0.006)
    late = replayed(PhysicsReplay(recovery=None, expected_delay_s=0.006), six)
    assert late.completed, "a control that allows for 6 ms"
    ten = Disturbances(delay_s=0.010, joint_delay_s=0.010)
    assert replayed(PhysicsReplay(recovery=None, soft_gains=True, expected_delay_s=0.010), ten).completed
    assert replayed(PhysicsReplay(recovery=None), ten).fell


@pytest.mark.parametrize("delay_ms", [2, 6, 10])
def test_an_expected_delay_is_predicted_exactly_for_a_joint_without_disturbance(delay_ms: int) -> None:
    """The feedback of late readings is that of readings without delay, once the predictor has a past."""
    dt_s, inertia, kp, kd = 1e-3, 0.2, np.array([400.0]), np.array([15.0])
    present = DelayPredictor(kp, kd, np.array([inertia]), 0.0, dt_s)
    predictor = DelayPredictor(kp, kd, np.array([inertia]), 1e-3 * delay_ms, dt_s)
    q, v, still = np.array([0.0]), np.array([0.0]), np.array([0.0])
    past = [(q, v)] * (delay_ms + 1)
    for k in range(300):
        q_command, v_command = np.array([0.1 if k > 20 else 0.0]), still
        past = [*past[1:], (q, v)]
        tau = predictor.feedback_nm(q_command, v_command, *past[0])
        if k < 20 or k > 20 + delay_ms:
            assert tau == pytest.approx(present.feedback_nm(q_command, v_command, q, v), abs=1e-9)
        v = v + tau * dt_s / inertia
        q = q + v * dt_s
    assert q == pytest.approx(0.1, abs=2e-3)


def test_a_push_gives_off_its_impulse() -> None:
    push = Push(1.0, (3.0, -20.0, 0.0), duration_s=0.2)
    force = np.array([push.force_n(t) for t in np.arange(0.0, 2.0, 0.001)])
    assert np.allclose(force.sum(axis=0) * 0.001, [3.0, -20.0, 0.0])
    assert not push.force_n(0.99).any()


@pytest.mark.parametrize("link", [None, "gripper_left_base_link"])
def test_pushes_act_on_their_link_and_add_up(robot: Robot, link: str | None) -> None:
    """Of a robot that falls freely: its momentum is that of both pushes, and only a pushed hand moves far."""
    q = robot.q_reference.copy()
    q[2] += 2.0
    built = build_simulation(robot, ground(), 0.3, (*FEET, "left_hand"))
    simulation, body = Simulation(built, q), built.body_of(link)
    pushes = [Push(0.0, (3.0, 6.0, 0.0), 0.05, link), Push(0.0, (3.0, 0.0, 0.0), 0.05, link)]
    start_m = simulation.contact_placement("left_hand").position_m
    for k in range(50):
        simulation.apply_forces([(body, push.force_n(1e-3 * k)) for push in pushes])
        simulation.step(np.zeros(len(robot.joint_names)), np.zeros(len(robot.locked)))
    simulation.refresh_derived()
    assert simulation.com_state()[1][:2] * robot.mass_kg == pytest.approx([6.0, 6.0], rel=5e-3)
    moved_m = np.linalg.norm((simulation.contact_placement("left_hand").position_m - start_m)[:2])
    assert (moved_m > 0.02) == (link is not None)


def test_a_push_at_a_joint_turns_its_link_as_its_lever_says(robot: Robot) -> None:
    """The force at the origin of the body: its moment about the robot's CoM is the rate of the angular momentum."""
    q = robot.q_reference.copy()
    q[2] += 2.0
    built = build_simulation(robot, ground(), 0.3, FEET)
    body, force_n = built.body_of("arm_left_4_link"), np.array([30.0, 0.0, 0.0])
    momenta = []
    for at_joint in (False, True):
        simulation = Simulation(built, q)
        data, com_m = simulation._data, simulation.com_state()[0]
        point_m = data.xpos[body] if at_joint else data.xipos[body]
        expected_nms = 0.001 * np.cross(point_m - com_m, force_n)
        simulation.apply_forces([(body, force_n)], [at_joint])
        simulation.step(np.zeros(len(robot.joint_names)), np.zeros(len(robot.locked)))
        simulation.refresh_derived()
        mujoco.mj_subtreeVel(built.model, data)
        assert data.subtree_angmom[1] == pytest.approx(expected_nms, abs=3e-5)
        momenta.append(expected_nms)
    assert np.linalg.norm(momenta[1] - momenta[0]) > 5e-4, "the two points differ"


def test_a_push_on_a_link_that_does_not_exist_is_refused(robot: Robot) -> None:
    motion = standing_still(robot, 0.1)
    with pytest.raises(InvalidInput, match="left_sole_link") as refusal:
        PhysicsReplay().run(
            robot,
            motion.sequence,
            motion,
            quiet,
            disturbances=Disturbances(pushes=(Push(0.0, (1.0, 0.0, 0.0), link="nose"),)),
        )
    assert refusal.value.code == "link-not-found"


def test_a_foot_that_lands_on_higher_ground_is_lived_with(
    robot: Robot, two_steps: tuple[ContactSequence, object, WholeBodyMotion]
) -> None:
    sequence, _, motion = two_steps
    place = sequence.phases[-1].contacts["left_foot"].placement.position_m
    ahead = Placement.from_wxyz([place[0] + 0.1, 0.0, -0.001])
    tread = Box("tread", ahead, np.array([0.36, 1.0, 0.02]))  # 9 mm high, from just before the first toes
    onto = replace(sequence, terrain=Terrain.from_surfaces([*sequence.terrain.surfaces, tread]))
    result = PhysicsReplay().run(robot, onto, motion, quiet)
    assert result.completed
    assert result.com_error_max_m < 0.02
    assert 0.007 < result.landing_error_max_m < 0.03


@pytest.mark.parametrize(
    ("field", "value"), [("friction", 0.0), ("torque_noise", -0.1), ("delay_s", -1.0), ("joint_delay_s", -1.0)]
)
def test_what_cannot_be_is_refused(field: str, value: float) -> None:
    with pytest.raises(InvalidInput) as refusal:
        Disturbances(**{field: value})
    assert refusal.value.code == "disturbance-out-of-range"
    assert [fault.where for fault in refusal.value.faults] == [field]


def test_a_rate_that_does_not_fit_the_steps_is_refused(robot: Robot) -> None:
    motion = standing_still(robot, 0.1)
    with pytest.raises(InvalidInput) as refusal:
        played(robot, replace(motion, rate_hz=300.0))
    assert refusal.value.code == "replay-rate"
