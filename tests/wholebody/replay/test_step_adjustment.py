"""What the soles can still undo, and what is done where they cannot: the plan waits, hurries, or steps aside."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.contacts.sequence import ContactSequence
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import MotionArrival, WholeBodyMotion
from stridelab.wholebody.replay.capturability import Capturability
from stridelab.wholebody.replay.dcm_feedback import ankles_of, pendulum_rate
from stridelab.wholebody.replay.disturbances import Disturbances, Push
from stridelab.wholebody.replay.replay import PhysicsReplay
from stridelab.wholebody.replay.sensors import as_sensed
from stridelab.wholebody.replay.stabiliser import Stabiliser, swing_progress
from stridelab.wholebody.replay.step_adjustment import AdaptiveClock, Stepping
from stridelab.wholebody.replay.stepper import ReplayStepper

LEFT, BACKWARDS = 1, 2
NEVER = Stepping(least_m=9.0)


def capturable(robot: Robot, motion: WholeBodyMotion, inside_m: float = 0.0) -> Capturability:
    return Capturability.of_motion(
        motion, {name: ankle.half_size_m for name, ankle in ankles_of(robot).items()}, inside_m
    )


def test_who_stands_can_undo_what_is_between_pressure_and_edge(
    talos: Robot, swaying: tuple[CentroidalPlan, WholeBodyMotion]
) -> None:
    """Soles at y = +-0.09 of 0.20 x 0.12 m: at the end of the motion C is the distance itself."""
    can = capturable(talos, swaying[1])
    x, y = can.pressure_m[-1]
    assert can.reach_m[-1] == pytest.approx([0.10 - x, 0.15 - y, 0.10 + x, 0.15 + y])
    assert np.allclose(can.edge_m[:, LEFT], 0.15)
    assert np.allclose(can.edge_m[:, BACKWARDS], 0.10)
    assert np.allclose(sum(can.weight.values()), 1.0), "all the weight is on the soles"
    assert capturable(talos, swaying[1], 0.02).reach_m[-1, LEFT] == pytest.approx(0.13 - y)


def test_what_can_be_undone_obeys_its_equation(
    talos: Robot, two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]
) -> None:
    """``C' = w (C - d)``, by differences."""
    motion = two_steps[2]
    can = capturable(talos, motion)
    w = float(can.rate_per_s[0])
    assert w == pytest.approx(pendulum_rate(float(motion.com_reference_m[0, 2])))
    d = can.edge_m - np.einsum("nij,nj->ni", can.directions, can.pressure_m)
    grown = np.diff(can.reach_m, axis=0) * motion.rate_hz
    assert np.allclose(grown, (can.rate_per_s[:, None] * (can.reach_m - d))[:-1], atol=0.03)


def paced(
    robot: Robot, motion: WholeBodyMotion, at: int, aside_m: float, times: int = 1, stepping: Stepping | None = None
) -> AdaptiveClock:
    """A clock that received ``times`` a capture point ``aside_m`` left of the planned one."""
    can = capturable(robot, motion)
    pace = AdaptiveClock(stepping or Stepping(), can, motion.rate_hz)
    pace.sample = float(at)
    share = swing_progress(motion.sequence, motion.time_s)
    places = {name: np.array([0.0, y, 0.0]) for name, y in (("left_foot", 0.09), ("right_foot", -0.09))}
    for _ in range(times):
        i = pace.sample_index
        swung = {name: float(share[name][i]) for name in places}
        pace.update_rate(can.capture_m[i] + np.array([0.0, aside_m]), places, swung)
        pace.advance()
    return pace


def test_an_undisturbed_plan_keeps_time_and_places(
    talos: Robot, two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]
) -> None:
    motion = two_steps[2]
    pace = paced(talos, motion, 0, 0.01, times=len(motion.time_s) - 1)
    assert pace.sample == len(motion.time_s) - 1
    assert not any(off.any() for off in pace.off_m.values())


def test_a_plan_waits_on_two_soles_for_a_robot_that_the_next_sole_could_not_hold_but_not_for_ever(
    talos: Robot, two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]
) -> None:
    motion = two_steps[2]
    can = capturable(talos, motion)
    lifts = int(np.argmin(can.in_contact["right_foot"] & can.in_contact["left_foot"]))
    assert paced(talos, motion, lifts - 5, -0.12, times=30).rate == 0.0
    long = paced(talos, motion, lifts - 5, -0.12, times=40, stepping=Stepping(most_lost_s=0.1))
    assert long.rate > 0.0
    assert long.sample > lifts - 5


@pytest.mark.parametrize("foot", ["left_foot", "right_foot"])
def test_a_foot_in_the_air_comes_down_sooner_or_farther_out_on_its_own_side_only(
    talos: Robot, two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion], foot: str
) -> None:
    motion, outwards = two_steps[2], 1.0 if foot == "left_foot" else -1.0
    can = capturable(talos, motion)
    (air,) = np.nonzero(can.in_contact[foot] == 0)
    middle = int(air[len(air) // 2])
    pushed = paced(talos, motion, middle, outwards * 0.10)
    assert pushed.rate != 1.0 or outwards * pushed.off_m[foot][1] > 0.02
    assert outwards * pushed.off_m[foot][1] <= Stepping().most_step_m
    crossing = paced(talos, motion, middle, -outwards * 0.15)
    assert crossing.rate == 1.0
    assert not crossing.off_m[foot].any()


@pytest.mark.parametrize("foot", ["left_foot", "right_foot"])
def test_who_has_waited_long_enough_still_hurries_but_neither_waits_nor_goes_back(
    talos: Robot, two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion], foot: str
) -> None:
    motion, outwards = two_steps[2], 1.0 if foot == "left_foot" else -1.0
    (air,) = np.nonzero(capturable(talos, motion).in_contact[foot] == 0)

    def rates(stepping: Stepping) -> list[float]:
        at = (int(air[k]) for k in range(10, len(air) - 10, 20))
        return [paced(talos, motion, i, outwards * 0.10, times=8, stepping=stepping).rate for i in at]

    fresh, late = rates(Stepping()), rates(Stepping(most_lost_s=-1.0))
    assert min(fresh) < 0.0, "some feet go back"
    assert min(late) >= 1.0
    assert max(late) > 1.5


def test_who_is_not_pushed_does_not_notice(
    talos: Robot, two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]
) -> None:
    sequence, _, motion = two_steps
    result = [
        PhysicsReplay(stabiliser=Stabiliser(stepping=stepping)).run(
            talos, sequence, motion, lambda _fraction, _message: None
        )
        for stepping in (Stepping(), NEVER)
    ]
    assert np.array_equal(result[0].q, result[1].q)


def test_a_push_just_before_a_foot_lifts_is_survived_by_waiting_and_not_without(
    talos: Robot, two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]
) -> None:
    sequence, _, motion = two_steps
    lifts_s = float(motion.time_s[int(np.argmin(capturable(talos, motion).in_contact["right_foot"]))])
    pushed = Disturbances(pushes=(Push(lifts_s - 0.12, (0.0, -25.0, 0.0)),))
    result = [
        PhysicsReplay(stabiliser=Stabiliser(stepping=stepping), recovery=None).run(
            talos, sequence, motion, lambda _fraction, _message: None, disturbances=pushed
        )
        for stepping in (Stepping(), NEVER)
    ]
    assert [one.completed for one in result] == [True, False]
    assert result[0].time_s[-1] > motion.time_s[-1] + 1.0, "it took longer than planned"


def test_the_reach_of_a_motion_that_arrives_is_a_lower_bound(
    talos: Robot, two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]
) -> None:
    """What lies ahead adds to the reach; everything else of a sample depends on that sample alone."""
    motion = two_steps[2]
    half = {name: ankle.half_size_m for name, ankle in ankles_of(talos).items()}
    whole = Capturability.of_motion(motion, half, 0.0)
    part = Capturability.of_motion(motion, half, 0.0, first=100, known=500)
    known = slice(100, 500)
    assert (whole.is_exact, part.is_exact) == (True, False)
    assert np.all(part.reach_m[known] <= whole.reach_m[known])
    assert np.all(part.reach_m[490:500] < 0.5 * whole.reach_m[490:500])
    np.testing.assert_allclose(part.reach_m[100:125], whole.reach_m[100:125], atol=0.002)
    for name in ("directions", "capture_m", "capture_edge_m", "edge_m", "pressure_m", "rate_per_s"):
        np.testing.assert_allclose(getattr(part, name)[known], getattr(whole, name)[known], atol=1e-12, err_msg=name)


@pytest.mark.parametrize(("aside_m", "waits"), [(0.0, False), (0.03, False), (0.2, True)])
def test_a_clock_waits_for_the_whole_motion_where_its_reach_may_be_exceeded(
    talos: Robot,
    two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion],
    aside_m: float,
    waits: bool,
) -> None:
    motion = two_steps[2]
    half = {name: ankle.half_size_m for name, ankle in ankles_of(talos).items()}
    whole, waited = Capturability.of_motion(motion, half, 0.0), []

    def complete() -> Capturability:
        waited.append(1)
        return whole

    part = Capturability.of_motion(motion, half, 0.0, first=0, known=400)
    known, unknown = (AdaptiveClock(Stepping(), one, motion.rate_hz, complete) for one in (whole, part))
    places = {name: np.array([0.0, y, 0.0]) for name, y in (("left_foot", 0.09), ("right_foot", -0.09))}
    for clock in (known, unknown):
        clock.update_rate(whole.capture_m[0] + np.array([0.0, aside_m]), places, dict.fromkeys(places, 1.0))
    assert bool(waited) == waits
    assert unknown.excess_m == known.excess_m
    assert unknown.rate == known.rate
    assert (known.excess_m > 0.0) == waits


def test_a_motion_that_arrives_is_replayed_alike_in_every_bit(
    talos: Robot, two_steps: tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]
) -> None:
    """Samples arrive 25 at a time; a push, whose outcome depends on all that lies ahead, waits for the rest."""
    sequence, _, motion = two_steps
    growing = ("q", "v", "a", "tau_nm", "com_m", "com_v_m_s", "l_nms")
    references = ("com_reference_m", "com_v_reference_m_s", "l_reference_nms")
    filled = {name: np.zeros_like(getattr(motion, name)) for name in (*growing, *references)}
    forces_n = {name: np.zeros_like(force) for name, force in motion.forces_n.items()}

    def receive() -> int:
        new = slice(arrival.arrived, arrival.arrived + 25)
        for name, values in filled.items():
            values[new] = getattr(motion, name)[new]
        for name, values in forces_n.items():
            values[new] = motion.forces_n[name][new]
        return min(new.stop, arrival.total)

    arrival = MotionArrival(len(motion.time_s), 0, receive)
    arrival.wait_for_samples(1)
    arriving = replace(motion, **filled, forces_n=forces_n, arrival=arrival)
    pushed = Disturbances(pushes=(Push(0.3, (0.0, 60.0, 0.0)),))
    one, other = (
        ReplayStepper(PhysicsReplay(), talos, sequence, each, as_sensed, pushed) for each in (motion, arriving)
    )
    for _ in range(75):
        one.advance()
        other.advance()
    assert not arrival.is_complete
    for _ in range(75):
        one.advance()
        other.advance()
    assert arrival.is_complete
    np.testing.assert_array_equal(other.log.samples_from(0)[1], one.log.samples_from(0)[1])
