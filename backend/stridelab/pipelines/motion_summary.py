"""The summary of ``plan-motion``: results of all stages as numbers, and remarks."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Final

from stridelab.centroidal.native.availability import unsupported_features
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.contacts.sequence import ContactSequence
from stridelab.pipelines.plan_problem import formulation_of, native_unused_reason, phase_durations
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import (
    CertificateCheck,
    CertificateSummary,
    CostWeights,
    PlanMotionInput,
    PlanMotionSummary,
    PlanVerification,
    ReplayCollision,
    ReplayLeftPlan,
    ReplaySummary,
    StoppedMotion,
)
from stridelab.wholebody.certificate.certificate import Certificate, Check
from stridelab.wholebody.motion import LEVELS, WholeBodyMotion, WholeBodyStopped

if TYPE_CHECKING:
    from stridelab.wholebody.replay.replay import Replay

MANY_ITERATIONS: Final = 50
"""More iterations indicate an ill-posed scenario or proxy."""


def plan_summary(
    plan: CentroidalPlan,
    given: ContactSequence,
    problem: CentroidalProblem,
    request: PlanMotionInput,
    certificate: CertificateSummary | None,
    replay: ReplaySummary | None,
    stage_times_s: Mapping[str, float],
    warnings: Sequence[Remark],
) -> PlanMotionSummary:
    """The ``PlanMotionSummary``; ``given`` is the sequence of the scenario, ``problem`` the solved problem."""
    sequence, verification = plan.sequence, plan.verification
    durations = phase_durations(given, sequence) if request.free_durations else None
    return PlanMotionSummary.from_object(
        plan,
        scenario_name=sequence.name,
        robot=sequence.robot,
        duration_s=sequence.duration_s,
        n_phases=len(sequence.phases),
        solver_because=native_unused_reason(request.solver, {plan.solver}, unsupported_features(problem)),
        weights=CostWeights(**asdict(problem.weights)),
        formulation=formulation_of(request),
        shape=problem.shape,
        measure=request.measure or DEFAULT_MEASURE,
        node_rate_hz=problem.node_rate_hz,
        kkt_error=_kkt_error(plan),
        phase_durations=durations,
        normal_force_max_n=dict(problem.bounds.normal_force_max_n),
        verification=PlanVerification(**{f.name: float(getattr(verification, f.name)) for f in fields(verification)}),
        stage_times_s=dict(stage_times_s),
        certificate=certificate,
        replay=replay,
        stopped=None,
        pace=None,
        agreement=[],
        warnings=list(warnings),
    )


def _kkt_error(plan: CentroidalPlan) -> float | None:
    """KKT error of the last attempt; None if it has no residuals."""
    last = plan.solution.attempts[-1] if plan.solution is not None else None
    return last.residuals.kkt_error if last is not None and last.residuals is not None else None


def certificate_summary(certificate: Certificate) -> CertificateSummary:
    """The certificate as a ``CertificateSummary``."""
    return CertificateSummary(passed=certificate.passed, checks=[check_summary(check) for check in certificate.checks])


def check_summary(check: Check) -> CertificateCheck:
    """One check of a certificate as a ``CertificateCheck``."""
    return CertificateCheck(**{f.name: getattr(check, f.name) for f in fields(Check)}, passed=check.passed)


def replay_summary(replay: "Replay") -> ReplaySummary:
    """The result of the replay as a ``ReplaySummary``, without the options of the request and the proof."""
    made = {"hand_in_place_shares", "collided", "remarks", "options", "proved_lost", "left_plan"}
    return ReplaySummary(
        **{name: getattr(replay, name) for name in ReplaySummary.model_fields if name not in made},
        hand_in_place_shares=dict(replay.hand_in_place_shares),
        collided=[ReplayCollision(**asdict(one)) for one in replay.collided],
        remarks=[Remark(**asdict(one)) for one in replay.remarks],
        left_plan=None if replay.left_plan is None else ReplayLeftPlan.from_object(replay.left_plan),
    )


def stopped_motion(stop: WholeBodyStopped) -> StoppedMotion:
    """Time, phase and priority level at which the whole-body controller stopped, as a ``StoppedMotion``."""
    level = LEVELS[stop.level]
    return StoppedMotion(time_s=stop.time_s, phase=stop.phase, level=stop.level, level_name=level, names=[*stop.names])


def motion_remarks(
    plan: CentroidalPlan,
    motion: WholeBodyMotion | None,
    certificate: CertificateSummary | None,
    replay: ReplaySummary | None,
) -> tuple[Remark, ...]:
    """Warnings about the plan, the motion, its certificate and its replay."""
    warnings: list[Remark] = []
    if plan.iterations > MANY_ITERATIONS:
        message = (
            f"The centroidal plan took {plan.iterations} iterations; more than {MANY_ITERATIONS} indicate an "
            "ill-posed scenario."
        )
        warnings.append(Remark(code="plan-slow-to-converge", message=message))
    if motion is not None and motion.failures and certificate is not None:
        first = motion.failures[0]
        message = (
            f"At {len(motion.failures)} of {len(motion.time_s)} samples the whole-body problem had no solution, "
            f"first at {first.time_s:.2f} s in phase {first.phase} ({first.reason})."
        )
        warnings.append(Remark(code="whole-body-gaps", message=message))
    if certificate is not None and not certificate.passed:
        listed = "; ".join(_failed_check_text(check) for check in certificate.checks if not check.passed)
        warnings.append(Remark(code="certificate-not-passed", message=f"The motion fails its certificate: {listed}."))
    if replay is not None and replay.fall_time_s is not None:
        message = f"Replayed in physics, the robot falls after {replay.fall_time_s:.1f} s."
        warnings.append(Remark(code="replay-fell", message=message))
    elif replay is not None and not replay.completed:
        message = "Replayed in physics, the motion is not completed; see the remarks of the replay."
        warnings.append(Remark(code="replay-not-completed", message=message))
    return tuple(warnings)


def _failed_check_text(check: CertificateCheck) -> str:
    wanted = "at least" if check.at_least else "at most"
    places = [f"phase {check.phase}" if check.phase is not None else "", check.effector or ""]
    where = ", ".join(place for place in places if place)
    value = f"{check.name} is {check.value:.4g} {check.unit}, {wanted} {check.limit:.4g} is required"
    return f"{value} ({where})" if where else value
