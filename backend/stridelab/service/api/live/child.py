"""The child process of a live session: plans the motion, then simulates it piece by piece.

A task is ``{"plan": ...}`` first, then ``{"commands": [...], "advance_s", "budget_s"}``; its answer has the frame as
JSON text, so that the web server passes it on unread.
"""

import math
from pathlib import Path
from typing import Any, Final

from stridelab.errors import InvalidInput
from stridelab.pipelines.commissioning.commission_robot import foot_places_m, scaled_walk
from stridelab.pipelines.live.live_replay import LiveReplay
from stridelab.pipelines.plan_motion import plan_motion, plan_scenario_motion, stage_shares
from stridelab.pipelines.plan_problem import load_densities
from stridelab.pipelines.progress import ProgressCallback, Stages
from stridelab.pipelines.replays.resume_plan import PlanResumer
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.loader import load_robot
from stridelab.schemas.live.messages import LIVE_COMMAND, LivePush, LiveRobot, LiveSet, LiveSteer
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Scenario
from stridelab.service.filenames import STAGED_ROBOT
from stridelab.service.kinds.robots.staged import use_staged_robot
from stridelab.wholebody.recovery.leg_geometry import LegGeometry

MESSAGE_LENGTH: Final = 300
FLOOR_M: Final = 90.0
"""Edges of the ground of a level walk, on which the robot can be steered."""
WALK_SHARE: Final = 0.7
"""Step length of the level walk of a robot, as a share of the scaled walk of TALOS."""


class LiveSimulation:
    """One session. Raises the errors of ``plan_motion``, and ``InvalidInput`` of a command that does not fit."""

    def __init__(self) -> None:
        self._replay: LiveReplay | None = None

    def __call__(self, task: dict[str, Any], folder: Path | None, progress: ProgressCallback) -> dict[str, Any]:
        """Answer ``task``."""
        if "plan" in task:
            return self._plan(task["plan"], folder, progress)
        if self._replay is None:
            raise AssertionError("a session is planned first")
        return self._advance(self._replay, task)

    def _plan(self, asked: dict[str, Any], folder: Path | None, progress: ProgressCallback) -> dict[str, Any]:
        if folder is not None and (folder / STAGED_ROBOT).is_file():
            use_staged_robot(folder)
        if asked["scenario"] is None:
            robot = load_robot(asked["robot"])
            walk = scaled_walk(robot, foot_places_m(robot), WALK_SHARE)[0]
            for box in walk["terrain"]:
                box["size_m"][:2] = [FLOOR_M, FLOOR_M]
            scenario = Scenario.model_validate(walk)
        else:
            scenario = Scenario.model_validate(asked["scenario"])
        request = PlanMotionInput(scenario=scenario)
        result = plan_motion(PlanMotionTask(scenario=scenario, input=request), Stages(progress, stage_shares(request)))
        if result.stopped is not None:
            raise result.stopped
        if result.motion is None or result.certificate is None:
            raise AssertionError("a plan with a whole body that did not stop has a certificate")
        progress(1.0, "building the simulation")
        resume = PlanResumer(result.motion.sequence, plan_scenario_motion)
        self._replay = LiveReplay(result.robot, result.motion, load_densities(result.robot, DEFAULT_MEASURE), resume)
        legs = LegGeometry.of_robot(result.robot)
        if legs is not None and asked["velocity"] is not None:
            ahead_m_s, left_m_s, turn_rad_s = asked["velocity"]
            command = LiveSteer(type="steer", ahead_m_s=ahead_m_s, left_m_s=left_m_s, turn_rad_s=turn_rad_s)
            self._replay.steer(command, hold_s=math.inf)
        soles = {name: one.contact_half_size_m for name, one in result.robot.effectors.items()}
        about = LiveRobot(
            links=list(self._replay.links),
            effectors=list(result.motion.sequence.effectors),
            mass_kg=result.robot.mass_kg,
            duration_s=result.motion.sequence.duration_s,
            certified=result.certificate.passed,
            soles_m={name: half_m for name, half_m in soles.items() if half_m is not None},
            may_steer=legs is not None,
        )
        return {"robot": about.model_dump(mode="json"), "frame": self._replay.frame().model_dump_json()}

    def _advance(self, replay: LiveReplay, task: dict[str, Any]) -> dict[str, Any]:
        refusals = []
        for k, document in enumerate(task["commands"]):
            try:
                self._obey(replay, document)
            except InvalidInput as refusal:
                refusals.append({"command": k, "code": refusal.code, "message": refusal.message[:MESSAGE_LENGTH]})
        before = replay.fall
        advanced_s = replay.advance(task["advance_s"], task["budget_s"])
        fall = replay.fall
        return {
            "frame": replay.frame().model_dump_json(),
            "advanced_s": advanced_s,
            "fall": None if fall is None or fall is before else fall.model_dump_json(),
            "fallen": fall is not None,
            "stopped": replay.has_stopped,
            "can_rewind_s": replay.can_rewind_s,
            "settings": replay.settings.model_dump(mode="json"),
            "refusals": refusals,
        }

    def _obey(self, replay: LiveReplay, document: dict[str, Any]) -> None:
        command = LIVE_COMMAND.validate_python(document)
        if isinstance(command, LivePush):
            if replay.fall is None:
                replay.push_link(command)
        elif isinstance(command, LiveSteer):
            if replay.fall is None:
                replay.steer(command)
        elif isinstance(command, LiveSet):
            replay.apply_settings(command.applied_to(replay.settings))
        elif command.type == "rewind":
            replay.rewind()
        elif command.type == "restart":
            replay.restart()
