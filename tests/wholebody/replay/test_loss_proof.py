"""The proof that a pushed robot cannot come to rest: against simulated policies, and in falls in physics."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.disturbances import Disturbances, Push
from stridelab.wholebody.replay.log import Replay
from stridelab.wholebody.replay.loss_proof import LossPremises, is_loss_proved
from stridelab.wholebody.replay.replay import PhysicsReplay

TwoSteps = tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]
DT_S = 1e-3


def premises(reach_m: float = 0.6, swing_s: float = 0.3) -> LossPremises:
    return LossPremises(np.zeros((1, 2)), reach_m, (0.7, 0.95), 10.0, swing_s)


def comes_to_rest(
    made: LossPremises, rng: np.random.Generator, v: float, gap_m: float, end_m: float, landing_s: float
) -> bool:
    """One admissible policy: a constant height, pressures and landings up to their limits, some of them at random."""
    z, x, s, lands_s = rng.uniform(*made.height_m), 0.0, min(gap_m, end_m), landing_s
    greedy, late = rng.random() < 0.5, rng.exponential(0.1) * (rng.random() < 0.5)
    for k in range(8000):
        if k * DT_S >= lands_s + late:
            s, lands_s = max(s, min(x + made.reach_m * (1.0 if greedy else rng.uniform(0.3, 1.0)), end_m)), k * DT_S
            lands_s += made.swing_s
        p = s if greedy else s - rng.exponential(0.02)
        v += DT_S * GRAVITY_M_S2 / z * (x - p)
        x += DT_S * v
        if v <= 0.0:
            return True
        if x > max(end_m, 30.0) + 5.0 or v > 60.0:
            return False
    return False


def test_no_policy_within_the_premises_contradicts_the_proof() -> None:
    rng, proved, saved = np.random.default_rng(4), 0, 0
    for _ in range(400):
        made = premises(rng.uniform(0.3, 0.8), rng.uniform(0.15, 0.5))
        v, gap_m, landing_s = rng.uniform(0.05, 5.0), rng.uniform(-0.1, 0.2), rng.uniform(0.0, 0.4)
        end_m = gap_m + rng.choice([0.0, rng.uniform(0.0, 0.6), 50.0])
        rests = [comes_to_rest(made, rng, v, gap_m, end_m, landing_s) for _ in range(6)]
        if made.slowest_escape(v, gap_m, end_m, landing_s):
            proved += 1
            assert not any(rests), (made, v, gap_m, end_m, landing_s)
        saved += any(rests)
    assert proved > 50
    assert saved > 50


def test_nearer_ends_slower_landings_and_faster_pushes_prove_more() -> None:
    made = premises()

    def least_speed(end_m: float, landing_s: float) -> float:
        return next(v for v in np.arange(0.0, 20.0, 0.05) if made.slowest_escape(float(v), 0.05, end_m, landing_s))

    assert least_speed(0.1, 0.2) < least_speed(0.4, 0.2) < least_speed(50.0, 0.2)
    assert least_speed(50.0, 0.4) < least_speed(50.0, 0.1)
    w = np.sqrt(GRAVITY_M_S2 / np.array([0.95, 0.7]))
    assert w[0] * 0.05 < least_speed(0.05, 0.2) < w[1] * 0.05 + 0.06, "the capture point leaves the last support"
    assert not made.slowest_escape(0.0, 0.05, 0.05, 0.2)


def on_platform(sequence: ContactSequence, width_m: float) -> ContactSequence:
    ground = Box("ground", Placement.from_wxyz([0.0, 0.0, -0.5]), np.array([8.0, width_m, 1.0]))
    return replace(sequence, terrain=Terrain.from_surfaces([ground]))


def pushed(robot: Robot, sequence: ContactSequence, motion: WholeBodyMotion, speed_m_s: float) -> tuple[Replay, Push]:
    push = Push(1.0, (0.0, speed_m_s * robot.mass_kg, 0.0))
    moved = replace(motion, sequence=sequence)
    return PhysicsReplay().run(robot, sequence, moved, lambda *_: None, disturbances=Disturbances(pushes=(push,))), push


@pytest.mark.parametrize(("width_m", "speed_m_s", "proved"), [(0.5, 1.8, True), (4.0, 1.8, False), (0.5, 0.1, False)])
def test_a_fall_is_proved_where_the_ground_ends(
    talos: Robot, two_steps: TwoSteps, proxies: Mapping[str, Proxy], width_m: float, speed_m_s: float, *, proved: bool
) -> None:
    sequence = on_platform(two_steps[0], width_m)
    replay, push = pushed(talos, sequence, two_steps[2], speed_m_s)
    assert replay.fell == (speed_m_s > 1.0)
    made = LossPremises.of_sequence(talos, sequence, proxies)
    assert made is not None
    assert is_loss_proved(talos, sequence, made, replay, push.end_s) == proved
    assert not is_loss_proved(talos, sequence, made, replay, 0.5), "before the push nothing is lost"


def test_the_premises_do_not_hold_on_rails_steps_or_without_densities(
    talos: Robot, two_steps: TwoSteps, proxies: Mapping[str, Proxy]
) -> None:
    sequence = two_steps[0]
    step = Box("step", Placement.from_wxyz([3.0, 0.0, 0.0]), np.array([0.3, 1.0, 0.2]))
    rail = Rail("rail", np.array([0.0, -0.6, 0.8]), np.array([1.0, -0.6, 0.8]), 0.02)
    assert LossPremises.of_sequence(talos, sequence, proxies) is not None
    for surface in (step, rail):
        more = replace(sequence, terrain=Terrain.from_surfaces([*sequence.terrain.surfaces, surface]))
        assert LossPremises.of_sequence(talos, more, proxies) is None
    assert LossPremises.of_sequence(talos, sequence, {}) is None
    standing = replace(sequence, phases=sequence.phases[:1])
    assert LossPremises.of_sequence(talos, standing, proxies) is None
