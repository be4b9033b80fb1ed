"""From a proposed card to a robot that walks: learned densities, a level walk, and what else the robot can do.

The walk is the bundled level walk of TALOS, scaled by the height of the CoM: lengths with ``s = h / h_TALOS``, times
with ``sqrt(s)``, so that both have the same Froude number; the feet are as far apart as in the reference posture. If it
is not certified or not completed, shorter and then slower steps are tried. ``capability_search`` then searches turn,
stair, pace and pushes.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
import pinocchio as pin

from stridelab.contacts.scenarios.parts import Walker
from stridelab.contacts.scenarios.robot_scenes import scaled_timing
from stridelab.contacts.scenarios.stairs import STROLLING, flat_walk
from stridelab.errors import InvalidInput
from stridelab.pipelines.commissioning.capability_search import LevelWalk, search_capabilities
from stridelab.pipelines.motion_trial import try_motion
from stridelab.pipelines.plan_motion import MotionResult
from stridelab.pipelines.progress import ProgressCallback, Stages
from stridelab.reachability.card import Measure, ReachabilityCard
from stridelab.reachability.learning.fit import learn_densities
from stridelab.reachability.store import save_card, save_cloud
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.robots import (
    CommissionLimits,
    CommissionRobotInput,
    CommissionRobotSummary,
    FirstWalk,
    LearnedMeasure,
    WalkAttempt,
)
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.recovery.walking import TALOS_COM_HEIGHT_M

REFERENCES: Final = (
    "carpentier2017thesis",
    "carpentier2018multicontact",
    "carpentier2019pinocchio",
    "todorov2012mujoco",
)
STEP_M: Final = 0.25
STEPS: Final = 6
STEPS_TRIED: Final = ((1.0, 1.0), (0.7, 1.0), (0.45, 1.0), (0.45, 0.65))
"""Length and pace of the steps that are tried, over those of TALOS' walk, scaled."""
MEASURES: Final[tuple[Measure, ...]] = ("uniform", "conditioned")
LEARN_UNIFORM, LEARN_CONDITIONED, WALK, SEARCH = "uniform", "conditioned", "walk", "search"


@dataclass(frozen=True)
class CommissionedRobot:
    """The robot, the scenario and the plan of its first walk, the scenarios of its capabilities, and the summary."""

    robot: Robot
    scenario: dict[str, Any]
    motion: MotionResult | None
    capability_scenarios: dict[str, dict[str, Any]]
    summary: CommissionRobotSummary


def commission_robot(request: CommissionRobotInput, models: Path, progress: ProgressCallback) -> CommissionedRobot:
    """Learn the densities of the robot into ``models / "reachability"``, then let it walk.

    The robot must be known to the process (``resources.add_models_folder``). A walk that is not possible is no error:
    the summary gives the reasons. Raises ``NotFound`` (``robot-not-found``), ``InvalidInput`` (``robot-card-invalid``,
    ``feet-missing``), ``NotEstimable`` (``no-free-configuration``).
    """
    stages = Stages(progress, {LEARN_UNIFORM: 3.0, LEARN_CONDITIONED: 4.0, WALK: 4.0, SEARCH: 25.0})
    robot = load_robot(request.robot)
    feet_y_m = foot_places_m(robot)
    learned: dict[str, LearnedMeasure] = {}
    folder = models / "reachability" / robot.name
    folder.mkdir(parents=True, exist_ok=True)
    for measure in MEASURES:
        with stages.run_stage(measure, "sampling postures") as tell:
            densities = learn_densities(
                robot, datetime.now(UTC).date(), None, request.samples, request.seed, measure, tell
            )
            save_card(folder / f"{measure}.json", densities.card)
            save_cloud(folder / f"{measure}.npz", densities.cloud.com_m)
            learned[measure] = _learned_measure(densities.card)
    with stages.run_stage(WALK, "planning") as tell:
        scenario, motion, walk, ratio = _first_walk(robot, feet_y_m, tell)
    with stages.run_stage(SEARCH, "turn, stair, pace and pushes") as tell:
        attempt = walk.attempts[-1]
        level = LevelWalk(
            robot.name,
            models,
            round(feet_y_m, 4),
            com_height_m(robot) / TALOS_COM_HEIGHT_M,
            Scenario.model_validate(scenario),
            attempt.step_m / attempt.step_time_s,
            motion.motion if motion is not None and walk.certified and walk.completed else None,
        )
        found = search_capabilities(level, request.search_s, tell)
    summary = CommissionRobotSummary(
        robot=robot.name,
        robot_sha256=robot.sha256,
        learned=learned,
        first_walk=walk,
        capabilities=found.capabilities,
        limits=CommissionLimits(
            mass_kg=robot.mass_kg,
            com_height_m=com_height_m(robot),
            foot_spacing_m=2.0 * feet_y_m,
            torque_ratio_max=ratio,
        ),
        seconds=stages.times_s,
    )
    return CommissionedRobot(robot, scenario, motion, found.scenarios, summary)


def com_height_m(robot: Robot) -> float:
    """Height of the CoM above the soles in the reference posture."""
    return float(pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)[2])


def foot_places_m(robot: Robot) -> float:
    """Half the distance between the soles in the reference posture.

    Raises ``InvalidInput`` (``feet-missing``) for a robot without ``left_foot`` and ``right_foot``.
    """
    if not {"left_foot", "right_foot"} <= robot.effectors.keys():
        names = ", ".join(robot.effectors)
        raise InvalidInput("feet-missing", f"A walk needs the effectors left_foot and right_foot; there is {names}.")
    model, index = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    left, right = (data.oMf[index[name]].translation for name in ("left_foot", "right_foot"))
    return 0.5 * float(np.linalg.norm((left - right)[:2]))


def scaled_walk(robot: Robot, feet_y_m: float, share: float, pace: float = 1.0) -> tuple[dict[str, Any], float, float]:
    """Scenario of the first walk with steps of ``share`` of the scaled length at ``pace``; its step length and time."""
    scale = com_height_m(robot) / TALOS_COM_HEIGHT_M
    half_m = robot.effectors["left_foot"].contact_half_size_m or (0.1, 0.05)
    step_m = round(share * scale * STEP_M, 3)
    timing = scaled_timing(STROLLING, scale / pace**2)
    walker = Walker(robot.name, round(feet_y_m, 4), half_m[0], half_m[0])
    return flat_walk(STEPS, step_m, timing, walker), step_m, timing.move_s + timing.rest_s


def _first_walk(
    robot: Robot, feet_y_m: float, progress: ProgressCallback
) -> tuple[dict[str, Any], MotionResult | None, FirstWalk, float | None]:
    """The first walk that is certified and completed, or the last one that was tried."""
    attempts: list[WalkAttempt] = []
    for k, (share, pace) in enumerate(STEPS_TRIED):
        scenario, step_m, step_time_s = scaled_walk(robot, feet_y_m, share, pace)

        def tell(fraction: float, message: str, k: int = k, step_m: float = step_m) -> None:
            progress((k + fraction) / len(STEPS_TRIED), f"steps of {step_m:g} m: {message}")

        motion, attempt = _try_walk(scenario, step_m, step_time_s, tell)
        attempts.append(attempt)
        if attempt.certified and attempt.completed:
            break
    duration_s = sum(phase["duration_s"] for phase in scenario["phases"])
    walk = FirstWalk(
        certified=attempt.certified,
        completed=attempt.completed,
        steps=STEPS,
        step_m=step_m,
        duration_s=round(duration_s, 3),
        attempts=attempts,
    )
    return scenario, motion, walk, attempt.torque_ratio_max


def _try_walk(
    scenario: dict[str, Any], step_m: float, step_time_s: float, progress: ProgressCallback
) -> tuple[MotionResult | None, WalkAttempt]:
    posed = Scenario.model_validate(scenario)
    task = PlanMotionTask(scenario=posed, input=PlanMotionInput(scenario=posed, replay=True))
    trial = try_motion(task, progress, replay_uncertified=True, resumes=False)
    replayed = trial.replayed
    attempt = WalkAttempt(
        step_m=step_m,
        step_time_s=step_time_s,
        certified=trial.certified,
        completed=trial.completed,
        com_error_max_m=None if replayed is None else replayed.com_error_max_m,
        torque_ratio_max=None if replayed is None else replayed.torque_ratio_max,
        reason=trial.reason,
    )
    return trial.result, attempt


def _learned_measure(card: ReachabilityCard) -> LearnedMeasure:
    return LearnedMeasure(
        samples=card.samples,
        tried=card.tried,
        rejected_share=card.rejected_share,
        kl_nats={name: effector.kl_nats for name, effector in card.effectors.items()},
    )
