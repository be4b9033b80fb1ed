"""From a scenario to a certified whole-body motion, and its replay (chapter 4).

    Scenario -> ContactSequence -> CentroidalPlan -> WholeBodyMotion -> Certificate; MotionResult -> Replay

Every stage has its share of the progress bar and its time in the summary, and every failure names its stage.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.boundary_conditions import PathBounds
from stridelab.centroidal.hand_force_limits import hand_bounds_n
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import SolverChoice, solve
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Series
from stridelab.pipelines.motion_summary import (
    certificate_summary,
    check_summary,
    motion_remarks,
    plan_summary,
    replay_summary,
    stopped_motion,
)
from stridelab.pipelines.plan_centroidal import Change, force_jump_remarks, solve_centroidal
from stridelab.pipelines.plan_problem import (
    control_of,
    free_durations,
    load_densities,
    require_durations,
    require_solver,
    validate_scenario,
)
from stridelab.pipelines.progress import ProgressCallback, Stages
from stridelab.pipelines.replays.options import disturbances_of, observer_of, require_pushes
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.card import robot_card
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import (
    PLAN_STAGES,
    AgreementPass,
    CertificateCheck,
    CertificateSummary,
    PlanMotionInput,
    PlanMotionSummary,
    PlanMotionTask,
    ReplayOptions,
)
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.boundary_postures import require_boundary_postures
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.leg_stretch import lower_for_legs
from stridelab.wholebody.momentum_consistency import Pass, agree
from stridelab.wholebody.motion import WholeBodyMotion, WholeBodyStopped
from stridelab.wholebody.shoe_check import require_room_for_shoes

if TYPE_CHECKING:
    from stridelab.wholebody.replay.replay import Replay

CHECK, REACHABILITY, CENTROIDAL, WHOLE_BODY, CERTIFICATE, REPLAY, EXPORT = PLAN_STAGES

REFERENCES: Final = ("carpentier2017thesis", "carpentier2018multicontact", "carpentier2019pinocchio")
SOLVER_REFERENCES: Final = {"ipopt": "wachter2006ipopt", "fatrop": "vanroye2023fatrop"}


@dataclass(frozen=True)
class MotionResult:
    """Results of the stages until the certificate; ``given`` is the sequence of the scenario.

    With ``stopped`` the whole body cannot follow the plan, and ``motion`` ends there.
    """

    request: PlanMotionInput
    robot: Robot
    given: ContactSequence
    problem: CentroidalProblem
    plan: CentroidalPlan
    motion: WholeBodyMotion | None
    certificate: CertificateSummary | None
    passes: tuple[Pass, ...]
    stopped: WholeBodyStopped | None
    remarks: Sequence[Remark]

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the used methods."""
        return _citation_keys(self.plan, self.request)

    def summary(self, replay: "Replay | None", stages: Stages) -> PlanMotionSummary:
        """The summary of the contract, with the times of ``stages``."""
        options = self.request.replay if isinstance(self.request.replay, ReplayOptions) else None
        replayed = None
        if replay is not None:
            more = {"options": options, "proved_lost": self._proved_lost(replay, options)}
            replayed = replay_summary(replay).model_copy(update=more)
        warnings = (
            *self.remarks,
            *force_jump_remarks(self.problem, self.request),
            *motion_remarks(self.plan, self.motion, self.certificate, replayed),
        )
        result = plan_summary(
            self.plan, self.given, self.problem, self.request, self.certificate, replayed, stages.times_s, warnings
        )
        update: dict[str, object] = {"agreement": [AgreementPass(**asdict(one)) for one in self.passes]}
        if self.stopped is not None:
            update["stopped"] = stopped_motion(self.stopped)
        return result.model_copy(update=update)

    def _proved_lost(self, replay: "Replay", options: ReplayOptions | None) -> bool | None:
        """Whether a fall after the last push before it is proved to be inevitable; None without a fall or a push."""
        from stridelab.wholebody.replay.loss_proof import LossPremises, is_loss_proved

        pushes = disturbances_of(options).pushes if options is not None else ()
        ends_s = [push.end_s for push in pushes if replay.fall_time_s is not None and push.end_s < replay.fall_time_s]
        if not ends_s:
            return None
        premises = LossPremises.of_sequence(self.robot, self.plan.sequence, self.problem.proxies)
        return premises is not None and is_loss_proved(self.robot, self.plan.sequence, premises, replay, max(ends_s))


class PlanWatcher:
    """Receives the parts of a plan as they are computed; this one ignores them."""

    def on_plan(self, robot: Robot, sequence: ContactSequence) -> None:
        """The centroidal plan over ``sequence`` is solved."""

    def allocate_zeros(self, shape: tuple[int, ...]) -> np.ndarray:
        """Zeros for an array of a motion of the whole body."""
        return np.zeros(shape)

    def on_pass(self, robot: Robot, motion: WholeBodyMotion) -> None:
        """``motion`` of the whole body begins, and is filled as it is computed; a later one replaces it."""

    def on_samples(self, time_s: Series, q: Float[np.ndarray, "k nq"]) -> None:
        """Samples of that motion: times (s) and postures."""

    def on_motion(self, robot: Robot, motion: WholeBodyMotion) -> None:
        """The motion to its end, before its certificate."""

    def on_check(self, check: CertificateCheck) -> None:
        """One check of the certificate."""

    def on_certificate(self, certificate: CertificateSummary) -> None:
        """The certificate, after its last check."""

    def on_replay_samples(self, time_s: Series, q: Float[np.ndarray, "k nq"]) -> None:
        """Samples of the replay: times (s) and postures."""


IGNORED: Final = PlanWatcher()
"""A watcher that ignores everything."""


def plan_motion(
    task: PlanMotionTask, stages: Stages, change: Change | None = None, watcher: PlanWatcher = IGNORED
) -> MotionResult:
    """Plan the motion of ``task.scenario`` and check it; ``stages`` has the shares of ``stage_shares``.

    ``change`` is for cost terms that the request does not have, such as a reference of the CoM. ``watcher`` receives
    the parts as they are computed.

    Raises ``NotEstimable`` for unavailable features (``...-unavailable``) before any computation. Later errors name
    their stage in the last fault: ``InvalidInput`` (``scenario-invalid``, ``replay-invalid``), ``NotFound``
    (``robot-not-found``), ``Unavailable`` (``reachability-of-another-robot``), ``NotEstimable`` (``plan-time-limit``,
    ``plan-not-converged``, ``stance-unreachable``) and other errors of the stages. A whole-body controller that cannot
    follow the plan is not raised but ``stopped``.
    """
    request = task.input
    require_solver(request.solver)
    require_durations(request)
    with stages.run_stage(CHECK, "looking at the scenario"):
        sequence, noted = validate_scenario(task.scenario)
        robot = load_robot(sequence.robot)
        require_pushes(request.replay, sequence.robot, sequence.duration_s)
        if request.whole_body:
            require_room_for_shoes(robot, sequence)
    with stages.run_stage(REACHABILITY, "reading the learned densities"):
        proxies = load_densities(robot, request.measure or DEFAULT_MEASURE)
    with stages.run_stage(CENTROIDAL, f"solving for {sequence.duration_s:.1f} s") as tell:
        posed, control = from_rest_to_rest(robot, sequence, proxies), control_of(request)
        problem = replace(
            posed,
            control=control,
            bounds=PathBounds(None, hand_bounds_n(robot, sequence) if control.has_point_forces else {}),
            node_rate_hz=request.node_rate_hz,
            durations=free_durations(request, sequence),
        )
        problem, plan = solve_centroidal(problem, request, tell, change)
        if request.whole_body:
            problem, plan = lower_for_legs(robot, problem, plan, partial(solve, solver=_solver_again(plan)))
            require_boundary_postures(robot, plan)
        given, sequence = sequence, plan.sequence

    watcher.on_plan(robot, sequence)

    def solve_for_legs(changed: CentroidalProblem) -> CentroidalPlan:
        again = solve(changed)
        return lower_for_legs(robot, changed, again, solve)[1] if again.converged else again

    def follow_plan(
        robot: Robot, sequence: ContactSequence, plan: CentroidalPlan, progress: ProgressCallback | None
    ) -> WholeBodyMotion:
        begin = partial(watcher.on_pass, robot)
        return WholeBodyController().run(
            robot, sequence, plan, progress, watcher.on_samples, begin, watcher.allocate_zeros
        )

    motion, certificate, stopped = None, None, None
    passes: tuple[Pass, ...] = ()
    if request.whole_body:
        try:
            with stages.run_stage(WHOLE_BODY, f"0.0 of {sequence.duration_s:.1f} s") as tell:
                clock = motion_progress(tell, sequence.duration_s)
                agreed = agree(robot, problem, plan, solve_for_legs, follow_plan, clock)
                plan, motion, passes = agreed.plan, agreed.motion, agreed.passes
        except WholeBodyStopped as stop:
            motion, stopped = stop.motion, stop
    if motion is not None and stopped is None:
        watcher.on_motion(robot, motion)
        with stages.run_stage(CERTIFICATE, "checking the motion"):
            watch = lambda check: watcher.on_check(check_summary(check))  # noqa: E731
            certificate = certificate_summary(certify(robot, sequence, plan, proxies, motion, watch))
            watcher.on_certificate(certificate)
    return MotionResult(request, robot, given, problem, plan, motion, certificate, passes, stopped, noted)


def plan_scenario_motion(scenario: Scenario) -> WholeBodyMotion:
    """The motion of ``scenario`` with the defaults of ``plan-motion``.

    Raises as ``plan_motion``, and ``WholeBodyStopped`` for a body that cannot follow the plan.
    """
    request = PlanMotionInput(scenario=scenario)
    stages = Stages(lambda _fraction, _message: None, stage_shares(request))
    result = plan_motion(PlanMotionTask(scenario=scenario, input=request), stages)
    if result.stopped is not None:
        raise result.stopped
    if result.motion is None:
        raise AssertionError("a plan with a whole body that did not stop has a motion")
    return result.motion


def replay_motion(
    request: PlanMotionInput,
    robot: Robot,
    motion: WholeBodyMotion,
    progress: ProgressCallback,
    watcher: PlanWatcher = IGNORED,
    *,
    resumes: bool = True,
) -> "Replay":
    """Replay ``motion`` of ``robot`` in a physics simulation, with the disturbances of the request.

    A plan that is left for a recovery is resumed (``resume_plan``) if it ``resumes``.
    """
    # imported lazily: the simulator is needed for a replay only
    from stridelab.pipelines.replays.resume_plan import PlanResumer
    from stridelab.wholebody.replay.replay import PhysicsReplay

    sequence, asked = motion.sequence, request.replay
    options = asked if isinstance(asked, ReplayOptions) else ReplayOptions()
    clock = motion_progress(progress, sequence.duration_s)
    observe, disturbed = observer_of(options, robot), disturbances_of(options)
    resume = PlanResumer(sequence, plan_scenario_motion) if resumes else None
    physics = PhysicsReplay(expected_delay_s=options.expected_delay_s, soft_gains=options.gains == "soft")
    watch = watcher.on_replay_samples
    return physics.run(robot, sequence, motion, clock, observe, disturbed, watch=watch, resume=resume)


def stage_shares(request: PlanMotionInput) -> dict[str, float]:
    """Stages of this request and their shares of the progress bar: about their seconds for 30 s of motion."""
    shares = {CHECK: 0.3, REACHABILITY: 0.1, CENTROIDAL: 2.0}
    if request.whole_body:
        shares |= {WHOLE_BODY: 4.0, CERTIFICATE: 2.0}
    shares |= {REPLAY: 6.0} if request.replay else {}
    return shares | {EXPORT: 4.0 if request.whole_body else 0.3}


def motion_progress(progress: ProgressCallback, duration_s: float) -> ProgressCallback:
    """Progress callback of a stage over the motion: reports the percentage and the time of the motion."""

    def report_time(fraction: float, _message: str) -> None:
        progress(fraction, f"{100 * fraction:.0f} %, {fraction * duration_s:.1f} of {duration_s:.1f} s")

    return report_time


def _solver_again(plan: CentroidalPlan) -> SolverChoice:
    """The solver that found a plan, for problems that differ little: no other one is tried."""
    return "native" if plan.solver == "native" else "fatrop" if plan.solver == "fatrop" else "ipopt"


def _citation_keys(plan: CentroidalPlan, request: PlanMotionInput) -> tuple[str, ...]:
    """Citation keys of the used methods."""
    robot, solver = robot_card(plan.sequence.robot).references, SOLVER_REFERENCES.get(plan.solver)
    keys = [*REFERENCES, *robot, "andersson2019casadi", *([solver] if solver else [])]
    if request.whole_body:
        keys += ["escande2014hierarchical", "arnstrom2022daqp"]
    if request.replay:
        keys += ["todorov2012mujoco", "englsberger2015dcm"]
    return tuple(keys)
