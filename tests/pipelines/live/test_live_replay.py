"""A live motion: it goes on as it would have after a rewind, is pushed, changed, and explains its fall."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from stridelab.pipelines.live import live_replay, resuming
from stridelab.pipelines.live.live_replay import BROKEN, MAX_PUSHES, LiveReplay
from stridelab.pipelines.live.resuming import PlanResuming
from stridelab.robots.robot import Robot
from stridelab.schemas.live.messages import REWIND_S, LivePush, LiveSettings, LiveSteer
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.replay import PhysicsReplay
from stridelab.wholebody.replay.resumption import NotResumed, Resumption
from stridelab.wholebody.replay.sensors import SensedState
from stridelab.wholebody.replay.stepper import ReplayStepper
from support.robots.plans import sway, talos

ENDLESS_S = 60.0


@pytest.fixture(scope="module")
def robot() -> Robot:
    return talos()


@pytest.fixture(scope="module")
def motion(robot: Robot) -> WholeBodyMotion:
    """A second of swaying on both feet, after which the robot stands."""
    plan = sway(robot, duration_s=1.0, amplitude_m=0.02, period_s=1.0)
    return WholeBodyController().run(robot, plan.sequence, plan)


@pytest.fixture(scope="module")
def shared(robot: Robot, motion: WholeBodyMotion) -> LiveReplay:
    return LiveReplay(robot, motion, {})


@pytest.fixture
def live(shared: LiveReplay) -> LiveReplay:
    """At the beginning of the motion, with nothing changed."""
    shared.apply_settings(LiveSettings())
    shared.restart()
    return shared


def push(speed_m_s: float, robot: Robot, link: str | None = None) -> LivePush:
    """A push to the left that changes the velocity of the whole robot by ``speed_m_s``."""
    return LivePush(type="push", impulse_ns=(0.0, speed_m_s * robot.mass_kg, 0.0), link=link, number=7)


def com_m(live: LiveReplay) -> np.ndarray:
    return np.array(live.frame().com_m)


def test_undisturbed_it_is_the_replay(live: LiveReplay, robot: Robot, motion: WholeBodyMotion) -> None:
    replay = PhysicsReplay().run(robot, motion.sequence, motion, lambda *_: None)
    assert live.advance(1.0, ENDLESS_S) == pytest.approx(1.0, abs=0.004)
    k = round(live.time_s * motion.rate_hz) - 1
    assert com_m(live) == pytest.approx(replay.com_m[k], abs=1e-4)
    assert live.frame().doing == "plan"


def test_time_advances_by_the_given_time_and_stops_where_the_budget_ends(live: LiveReplay) -> None:
    assert sum(live.advance(0.003, ENDLESS_S) for _ in range(100)) == pytest.approx(0.3, abs=0.004)
    behind_s = live.advance(1.0, 0.0)
    assert behind_s == pytest.approx(0.004), "one sample, however long it takes"
    assert live.advance(0.0, ENDLESS_S) == 0.0, "what was missed is not caught up"


def test_a_rewind_goes_back_and_on_as_before(live: LiveReplay, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    assert REWIND_S == 10.0
    monkeypatch.setattr(live_replay, "REWIND_S", 1.5)
    live.advance(3.2, ENDLESS_S)
    assert live.can_rewind_s == pytest.approx(2.2, abs=0.01), "saved every second"
    before, at_s = com_m(live), live.time_s
    live.push_link(push(0.3, robot))
    live.advance(0.3, ENDLESS_S)
    assert np.linalg.norm(com_m(live) - before) > 0.01
    live.rewind()
    assert live.time_s == pytest.approx(2.0, abs=0.01)
    assert live.frame().push is None
    live.advance(at_s - live.time_s, ENDLESS_S)
    assert com_m(live) == pytest.approx(before, abs=1e-6), "without the push"


def steer(ahead_m_s: float = 0.0, left_m_s: float = 0.0, turn_rad_s: float = 0.0) -> LiveSteer:
    return LiveSteer(type="steer", ahead_m_s=ahead_m_s, left_m_s=left_m_s, turn_rad_s=turn_rad_s)


def test_a_steered_robot_walks_and_stops_where_nothing_more_is_commanded(live: LiveReplay) -> None:
    live.advance(0.2, ENDLESS_S)
    live.steer(steer(ahead_m_s=0.2), hold_s=3.0)
    live.advance(2.5, ENDLESS_S)
    walking = live.frame()
    assert walking.doing == "steered"
    assert walking.velocity is not None
    assert walking.velocity[0] == pytest.approx(0.2, abs=1e-6)
    assert com_m(live)[0] > 0.15
    assert {one.effector for one in walking.footholds} == {"left_foot", "right_foot"}
    assert walking.footholds[-1].position_m[0] > com_m(live)[0] + 0.2, "the next places are ahead"
    path_m = np.array(walking.horizon_m)
    assert path_m.shape == (26, 3)
    assert path_m[0] == pytest.approx(com_m(live), abs=1e-3)
    assert path_m[-1, 0] - path_m[0, 0] == pytest.approx(0.5, abs=0.2), "2.5 s at 0.2 m/s"
    live.advance(4.5, ENDLESS_S)
    standing = live.frame()
    assert (standing.doing, live.fall) == ("steered", None)
    before = com_m(live)
    live.advance(1.0, ENDLESS_S)
    assert com_m(live) == pytest.approx(before, abs=5e-3)


def test_a_walk_ends_where_the_ground_does(live: LiveReplay, motion: WholeBodyMotion) -> None:
    (ground,) = (box for box in motion.sequence.terrain.boxes)
    edge_m = float(ground.placement.position_m[1] + 0.5 * ground.size_m[1])
    live.steer(steer(left_m_s=0.2), hold_s=ENDLESS_S)
    live.advance(2.0 + edge_m / 0.18, ENDLESS_S)
    assert live.fall is None
    assert com_m(live)[1] < edge_m - 0.05
    assert np.linalg.norm(np.array(live.frame().velocity or (1.0,))) < 1e-6


def test_a_walk_survives_a_push_and_goes_on(live: LiveReplay, robot: Robot) -> None:
    live.steer(steer(ahead_m_s=0.2), hold_s=ENDLESS_S)
    live.advance(2.0, ENDLESS_S)
    live.push_link(push(0.3, robot))
    live.advance(3.0, ENDLESS_S)
    assert live.fall is None
    x_m = com_m(live)[0]
    live.advance(2.0, ENDLESS_S)
    assert live.frame().doing == "steered"
    assert com_m(live)[0] > x_m + 0.2


def test_a_rewind_of_a_walk_goes_back_to_it(live: LiveReplay, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_replay, "REWIND_S", 1.5)
    live.steer(steer(ahead_m_s=0.2), hold_s=ENDLESS_S)
    live.advance(4.2, ENDLESS_S)
    live.rewind()
    assert live.frame().doing == "steered"
    live.advance(3.0, ENDLESS_S)
    assert live.fall is None, "it stops, because a rewind lets the stick go"


def test_a_push_moves_its_link_at_once(live: LiveReplay, robot: Robot) -> None:
    live.advance(0.2, ENDLESS_S)
    live.push_link(push(0.2, robot, "torso_2_link"))
    live.advance(0.02, ENDLESS_S)
    shown = live.frame().push
    assert shown is not None
    assert (shown.number, live.links[shown.link or 0]) == (7, "torso_2_link")
    assert shown.force_n[1] == pytest.approx(2.0 * robot.mass_kg)
    live.advance(0.2, ENDLESS_S)
    assert live.frame().push is not None
    assert live.frame().push.force_n == (0.0, 0.0, 0.0)


def test_a_push_on_nothing_and_too_many_at_once_are_refused(live: LiveReplay, robot: Robot) -> None:
    with pytest.raises(InvalidInput, match="no link 'nose'"):
        live.push_link(push(0.1, robot, "nose"))
    for _ in range(MAX_PUSHES):
        live.push_link(push(0.001, robot))
    with pytest.raises(InvalidInput) as refused:
        live.push_link(push(0.001, robot))
    assert refused.value.code == "too-many-pushes"
    live.advance(0.2, ENDLESS_S)
    live.push_link(push(0.001, robot))


def test_a_fall_is_explained_and_can_be_undone(live: LiveReplay, robot: Robot) -> None:
    live.advance(0.5, ENDLESS_S)
    live.push_link(push(2.5, robot))
    live.advance(6.0, ENDLESS_S)
    assert live.fall is not None
    assert "s after a push of" in live.fall.summary
    assert "2.50 m/s" in live.fall.summary
    assert live.fall.reasons[0].startswith("Support: at 0.5")
    assert "Steps: after" in live.fall.reasons[1]
    assert live.has_stopped
    assert live.advance(1.0, ENDLESS_S) == 0.0
    assert live.frame().doing == "fallen"
    live.rewind()
    assert live.fall is None
    assert live.frame().doing == "plan"
    assert live.advance(0.1, ENDLESS_S) == pytest.approx(0.1)


def test_steps_of_a_steered_walk_are_not_called_steps_to_stop_it(live: LiveReplay, robot: Robot) -> None:
    live.steer(steer(ahead_m_s=0.2), hold_s=3.0)
    live.advance(6.0, ENDLESS_S)
    live.push_link(push(4.0, robot))
    live.advance(4.0, ENDLESS_S)
    assert live.fall is not None
    assert re.match(r"Steps: after \d+ steps since it was steered, ", live.fall.reasons[0])
    assert not any("to stop it" in reason for reason in live.fall.reasons)


class LateWork:
    """Work beside in this process that has ended at the second look."""

    def __init__(self, work: Callable[[], Any], _niceness: int) -> None:
        self._work, self._looks = work, 0

    @staticmethod
    def is_possible() -> bool:
        return True

    @property
    def has_ended(self) -> bool:
        self._looks += 1
        return self._looks > 1

    def wait_for_result(self) -> Any:
        return self._work()

    def end_process(self) -> None:
        self._looks = -1000


def test_after_steps_the_robot_stands_and_then_goes_on_with_its_plan(
    robot: Robot, motion: WholeBodyMotion, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned_for_s: list[float] = []

    def resume(left_s: float, measured: SensedState) -> Resumption | NotResumed:
        planned_for_s.append(left_s)
        return Resumption(standing_at(measured, robot), 0.0, 1.0)

    monkeypatch.setattr(resuming, "WorkBeside", LateWork)
    live = LiveReplay(robot, motion, {}, resume)
    live.advance(0.2, ENDLESS_S)
    live.push_link(push(0.4, robot))
    live.advance(3.1, ENDLESS_S)
    stood = live.frame()
    assert (stood.doing, stood.steps > 0, stood.is_planning) == ("recovery", True, True)
    assert planned_for_s == [], "it stands while the plan is computed"
    live.advance(2.2, ENDLESS_S)
    went_on = live.frame()
    assert (went_on.doing, went_on.is_planning, live.fall) == ("plan", False, None)
    assert planned_for_s == [pytest.approx(stood.plan_time_s)]
    assert went_on.plan_time_s == pytest.approx(1.0, abs=0.3)
    assert com_m(live)[2] > 0.8


class StillStepper(ReplayStepper):
    """A stepper without a simulation, whose robot stands on one sole at ``at_m``."""

    plan_time_s = 0.7

    def __init__(self) -> None:
        self.at_m = np.zeros(3)
        self.resumed: list[Any] = []

    def measured_state(self) -> SensedState:
        zero = np.zeros(3)
        sole = {"left_foot": Placement(self.at_m.copy(), np.eye(3))}
        return SensedState(0.0, np.zeros(8), np.zeros(7), zero, zero, sole, {"left_foot": zero}, {"left_foot": zero})

    def resume_plan(self, resume: Callable[..., Any], *, limited: bool = True) -> bool:
        assert not limited
        self.resumed.append(resume(0.0, None))
        return True


@pytest.fixture
def still(monkeypatch: pytest.MonkeyPatch) -> StillStepper:
    monkeypatch.setattr(resuming, "WorkBeside", LateWork)
    return StillStepper()


def test_a_plan_that_is_not_resumed_has_a_reason_and_is_tried_once(still: StillStepper) -> None:
    planned_for_s: list[float] = []

    def resume(left_s: float, _measured: SensedState) -> NotResumed:
        planned_for_s.append(left_s)
        return NotResumed("no way")

    planning = PlanResuming(still, resume)
    states = [(planning.follow_rest(), planning.is_planning, planning.reason) for _ in range(4)]
    assert states == [(False, True, ""), (False, True, ""), (False, False, "no way"), (False, False, "no way")]
    still.at_m[0] = 0.1
    assert (planning.follow_rest(), planning.is_planning, planning.reason) == (False, True, "")
    planning.cancel_planning()
    assert (planning.is_planning, planned_for_s, still.resumed) == (False, [0.7], [])


def test_a_plan_from_where_the_robot_no_longer_stands_is_not_followed(
    still: StillStepper, motion: WholeBodyMotion
) -> None:
    planning = PlanResuming(still, lambda _left_s, _measured: Resumption(motion, 0.0, 0.0))
    planning.follow_rest()
    planning.follow_rest()
    still.at_m[1] = 0.02
    assert not planning.follow_rest()
    assert not planning.is_planning
    assert [planning.follow_rest() for _ in range(3)] == [False, False, True]
    assert [result.motion for result in still.resumed] == [motion]


def test_an_error_of_the_planning_is_a_reason(still: StillStepper) -> None:
    def resume(_left_s: float, _measured: SensedState) -> NotResumed:
        raise InvalidInput("no-steps", "There are no steps.")

    planning = PlanResuming(still, resume)
    for _ in range(3):
        planning.follow_rest()
    assert planning.reason == "There are no steps"


def test_without_a_planner_the_robot_stands_where_it_came_to_rest(still: StillStepper) -> None:
    planning = PlanResuming(still, None)
    assert not planning.follow_rest()
    assert (planning.is_planning, planning.reason) == (False, "")


def standing_at(measured: SensedState, robot: Robot) -> WholeBodyMotion:
    """A short motion that stands on the measured soles."""
    plan = sway(robot, duration_s=0.2, amplitude_m=0.0)
    (phase,) = plan.sequence.phases
    at = {name: measured.contacts[name] for name in phase.contacts}
    level = {name: Placement(np.array([*one.position_m[:2], 0.0]), upright(one.rotation)) for name, one in at.items()}
    contacts = {name: replace(contact, placement=level[name]) for name, contact in phase.contacts.items()}
    middle = np.mean([one.position_m for one in level.values()], axis=0)
    sequence = replace(plan.sequence, phases=(replace(phase, contacts=contacts),))
    moved = replace(plan, sequence=sequence, com_m=plan.com_m + middle)
    return WholeBodyController().run(robot, sequence, moved)


def upright(rotation: np.ndarray) -> np.ndarray:
    """The rotation about the vertical axis alone."""
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("settings", "sinks_mm"),
    [(LiveSettings(), 0.55), (LiveSettings(floor_time_s=0.08), 4.8)],
)
def test_a_soft_floor_gives_way(live: LiveReplay, settings: LiveSettings, sinks_mm: float) -> None:
    live.apply_settings(settings)
    live.advance(1.0, ENDLESS_S)
    sunk_m = [-place[2] for name, place in live.frame().effectors_m.items() if "foot" in name]
    assert 1e3 * float(np.mean(sunk_m)) == pytest.approx(sinks_mm, rel=0.4)


def test_payload_and_friction_reach_the_simulation_and_go_back(live: LiveReplay, robot: Robot) -> None:
    def load_n() -> float:
        return sum(force[2] for force in live.frame().forces_n.values())

    live.advance(2.0, ENDLESS_S)
    assert load_n() == pytest.approx(9.81 * robot.mass_kg, rel=0.02)
    live.apply_settings(LiveSettings(payload_kg=10.0, delay_s=0.002))
    live.advance(2.0, ENDLESS_S)
    assert load_n() == pytest.approx(9.81 * (robot.mass_kg + 10.0), rel=0.02)
    live.apply_settings(LiveSettings(friction=0.01))
    live.push_link(push(0.05, robot))
    live.advance(0.5, ENDLESS_S)
    moved_m = [abs(place[1]) - 0.085 for place in live.frame().effectors_m.values()]
    assert max(abs(value) for value in moved_m) > 0.003, "on ice, the feet slide"


def test_a_motion_that_cannot_be_computed_stops_and_says_so(live: LiveReplay, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> int:
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr(live._stepper, "advance", broken)
    live.advance(0.1, ENDLESS_S)
    assert live.fall is not None
    assert live.fall.summary == BROKEN
    assert live.has_stopped
