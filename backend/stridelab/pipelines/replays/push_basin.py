"""Pushes of a motion in physics: at random times, in random directions, and what becomes of the robot.

Scenario -> WholeBodyMotion -> n replays with one push each -> survived | proved-lost | unexplained
"""

import math
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import binomtest

from stridelab.contacts.sequence import ContactSequence
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.machine.parallel import map_in_order, worthwhile_processes
from stridelab.pipelines.plan_motion import EXPORT, plan_motion, plan_scenario_motion, stage_shares
from stridelab.pipelines.progress import ProgressCallback, Stages
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.loader import load_robot
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.receding import PushBasinSummary, PushBasinTask, PushOutcome
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.motion import WholeBodyMotion

if TYPE_CHECKING:
    from stridelab.wholebody.replay.disturbances import Push
    from stridelab.wholebody.replay.loss_proof import LossPremises

PUSHES: Final = "pushes"
"""Stage of the replays; the others are those of ``plan-motion``."""
SHARE_PER_PUSH: Final = 4.0
"""Share of the progress bar of one replay: about its seconds."""
REPLAYS_PER_S: Final = 0.3


@dataclass(frozen=True)
class PushResult:
    """Outcome of one push; times in s of the replay, ``direction_rad`` from the world's x axis.

    ``arrived`` if the robot ends on the contacts with which the plan ends. ``reason`` says why the outcome is not
    better: the remarks of the replay, or the fall and its proof.
    """

    time_s: float
    direction_rad: float
    phase: int
    outcome: PushOutcome
    arrived: bool
    completed: bool
    reason: str
    fall_time_s: float
    com_error_max_m: float
    slip_max_m: float
    torque_ratio_max: float


@dataclass(frozen=True)
class PushBasin:
    """All pushes in their order, and the summary of the contract."""

    pushes: tuple[PushResult, ...]
    summary: PushBasinSummary
    citation_keys: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PushTrials:
    """What a process needs to replay any of the pushes; ``premises`` None where no fall can be proved."""

    robot: str
    motion: WholeBodyMotion
    pushes: "tuple[Push, ...]"
    premises: "LossPremises | None"

    def replay_push(self, k: int) -> PushResult:
        """Replay the motion with push ``k``, or without any for -1."""
        from stridelab.pipelines.replays.resume_plan import PlanResumer
        from stridelab.wholebody.replay.disturbances import Disturbances
        from stridelab.wholebody.replay.loss_proof import is_loss_proved
        from stridelab.wholebody.replay.replay import PhysicsReplay

        robot, sequence = load_robot(self.robot), self.motion.sequence
        pushes = self.pushes[k : k + 1] if k >= 0 else ()
        replay = PhysicsReplay().run(
            robot,
            sequence,
            self.motion,
            _ignore_progress,
            disturbances=Disturbances(pushes=pushes),
            resume=PlanResumer(sequence, plan_scenario_motion),
        )
        time_s, x, y = (pushes[0].time_s, *pushes[0].impulse_ns[:2]) if pushes else (0.0, 0.0, 0.0)
        outcome: PushOutcome = "survived"
        reason = "; ".join(remark.message for remark in replay.remarks)
        if replay.fall_time_s is not None:
            is_proved = (
                self.premises is not None
                and bool(pushes)
                and is_loss_proved(robot, sequence, self.premises, replay, pushes[0].end_s)
            )
            outcome = "proved-lost" if is_proved else "unexplained"
            reason = f"falls {replay.fall_time_s - time_s:.2f} s after the push; " + (
                "no motion within the premises of the proof comes to rest"
                if is_proved
                else "not proved that no motion would have saved it"
            )
        return PushResult(
            time_s=time_s,
            direction_rad=math.atan2(y, x),
            phase=sequence.phase_at(time_s),
            outcome=outcome,
            arrived=replay.arrived,
            completed=replay.completed,
            reason=reason,
            fall_time_s=math.nan if replay.fall_time_s is None else replay.fall_time_s,
            com_error_max_m=replay.com_error_max_m,
            slip_max_m=replay.foot_slip_max_m,
            torque_ratio_max=replay.torque_ratio_max,
        )


def push_basin(task: PushBasinTask, progress: ProgressCallback, processes: int | None = None) -> PushBasin:
    """Replay the motion of ``task.scenario`` with every push, in ``processes`` processes (default: all cores).

    Raises as ``plan_motion`` does, what stopped the whole body, and ``NotEstimable`` (``replay-fell``) for a motion
    in which the robot falls without a push.
    """
    request, began_s = task.input, time.monotonic()
    scenario = task.scenario if request.robot is None else task.scenario.model_copy(update={"robot": request.robot})
    plan = PlanMotionInput(scenario=scenario)
    shares = {stage: share for stage, share in stage_shares(plan).items() if stage != EXPORT}
    stages = Stages(progress, shares | {PUSHES: SHARE_PER_PUSH * request.n})
    made = plan_motion(PlanMotionTask(scenario=scenario, input=plan), stages)
    if made.stopped is not None or made.motion is None or made.certificate is None:
        raise made.stopped or InvalidInput("scenario-invalid", "The scenario has no motion of the whole body.")
    impulse_ns = request.speed_m_s * made.robot.mass_kg
    pushes = draw_pushes(request.n, made.motion.time_s[-1], impulse_ns, request.seed)
    trials = PushTrials(
        made.robot.name, made.motion, pushes, _premises(made.robot.name, made.plan.sequence, made.problem.proxies)
    )
    at_once = processes or worthwhile_processes(int((request.n + 1) / REPLAYS_PER_S))
    results: list[PushResult] = []
    replays = map_in_order(partial(_replay_piece, trials), request.n + 1, at_once)
    with stages.run_stage(PUSHES, f"0 of {request.n}") as tell, closing(replays):
        _require_upright(next(replays))  # the first replay has no push
        for k, result in enumerate(replays, start=1):
            results.append(result)
            survived = sum(one.outcome == "survived" for one in results)
            tell(k / request.n, f"{k} of {request.n}, {survived} survived")
    counts = Counter(result.outcome for result in results)
    interval = binomtest(counts["survived"], request.n).proportion_ci(method="wilson")
    summary = PushBasinSummary(
        scenario_name=scenario.name,
        robot=made.robot.name,
        duration_s=float(made.motion.time_s[-1]),
        speed_m_s=request.speed_m_s,
        impulse_ns=impulse_ns,
        n=request.n,
        seed=request.seed,
        survived=counts["survived"],
        proved_lost=counts["proved-lost"],
        unexplained=counts["unexplained"],
        arrived=sum(result.arrived for result in results),
        completed=sum(result.completed for result in results),
        survived_ci95=(float(interval.low), float(interval.high)),
        provable=trials.premises is not None,
        certified=made.certificate.passed,
        wall_time_s=time.monotonic() - began_s,
        processes=min(at_once, request.n + 1),
        warnings=[*made.remarks, *_remarks(scenario, trials, certified=made.certificate.passed)],
    )
    keys = (*made.citation_keys, "todorov2012mujoco", "englsberger2015dcm", "koolen2012capturability")
    return PushBasin(tuple(results), summary, keys)


def draw_pushes(n: int, duration_s: float, impulse_ns: float, seed: int) -> "tuple[Push, ...]":
    """Pushes on the trunk at times uniform over the motion, in horizontal directions uniform over the circle."""
    from stridelab.wholebody.replay.disturbances import Push

    draws = np.random.default_rng(seed).uniform(size=(n, 2))
    angles = 2.0 * np.pi * draws[:, 1]
    return tuple(
        Push(float(u * duration_s), (float(impulse_ns * np.cos(a)), float(impulse_ns * np.sin(a)), 0.0))
        for u, a in zip(draws[:, 0], angles, strict=True)
    )


def _replay_piece(trials: PushTrials, piece: int) -> PushResult:
    return trials.replay_push(piece - 1)


def _premises(robot: str, sequence: ContactSequence, proxies: Mapping[str, Proxy]) -> "LossPremises | None":
    from stridelab.wholebody.replay.loss_proof import LossPremises

    return LossPremises.of_sequence(load_robot(robot), sequence, proxies)


def _require_upright(undisturbed: PushResult) -> None:
    if undisturbed.outcome != "survived":
        message = f"Without a push, the robot falls after {undisturbed.fall_time_s:.1f} s."
        raise NotEstimable("replay-fell", message)


def _remarks(scenario: Scenario, trials: PushTrials, *, certified: bool) -> list[Remark]:
    remarks = []
    if not certified:
        message = f"The motion of {scenario.name} fails its certificate; plan it for the reasons."
        remarks.append(Remark(code="certificate-not-passed", message=message))
    if trials.premises is None:
        message = "No fall can be proved here: hands touch, or the surfaces are not level and at one height."
        remarks.append(Remark(code="loss-not-provable", message=message))
    return remarks


def _ignore_progress(_fraction: float, _message: str) -> None:
    """The progress counts replays."""
