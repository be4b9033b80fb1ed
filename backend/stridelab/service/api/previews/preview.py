"""Requests to the resident planner: solvers, previews and stance checks. Imported in the child process only."""

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from stridelab.centroidal.nlp.solvers import Limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.receding_horizon import RecedingHorizon, State
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.pipelines.plan_problem import contact_sequence_of, load_densities, native_unavailable_reason
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.loader import load_robot
from stridelab.schemas.base import FaultItem
from stridelab.schemas.previews import PlanPreview, PlanPreviewInput, PreviewMotion, PreviewPush, SolverFacts, Solvers
from stridelab.schemas.scenarios import Scenario
from stridelab.service.api.previews import stances
from stridelab.service.kinds.robots.staged import use_staged_robot

Json = dict[str, Any]

LIMITS: Final = Limits(iterations=100, cpu_s=2.0)
"""Solver limits for interactive use: a quick failure is better than a late solution."""
SHOWN_FAULTS: Final = 50
MIN_RECOVERY_S: Final = 0.2
"""Minimum time between the end of a push and the end of the motion."""


def run_in_child(question: Json, _folder: Path | None, _progress: ProgressCallback) -> Json:
    """Answer ``{"ask": "solvers"}``, ``{"ask": "preview", "input": PlanPreviewInput}`` or a request of ``stances``."""
    if question["ask"] == "solvers":
        return list_solvers().model_dump(mode="json")
    if question["ask"] == "stances":
        return stances.answer_request(question)
    return preview_plan(PlanPreviewInput.model_validate(question["input"])).model_dump(mode="json")


class OwnRobotPlanner:
    """Answers for the user's robot that was staged in the folder of the child; it is unpacked once."""

    def __init__(self) -> None:
        self._is_known = False

    def __call__(self, question: Json, folder: Path, progress: ProgressCallback) -> Json:
        """Answer as ``run_in_child``. Raises ``InvalidInput`` (``robot-card-invalid``) as well."""
        if not self._is_known:
            use_staged_robot(folder)
            self._is_known = True
        return run_in_child(question, folder, progress)


def list_solvers() -> Solvers:
    """List all solvers; those of CasADi are always available."""
    missing = native_unavailable_reason()
    facts = [SolverFacts(name="native", available=missing is None, missing=missing)]
    facts += [SolverFacts(name=name, available=True) for name in ("ipopt", "fatrop")]
    return Solvers(auto="native" if missing is None else "ipopt", solvers=facts)


def preview_plan(request: PlanPreviewInput) -> PlanPreview:
    """Compute the motion of a scenario, and the replanned motion after the push.

    Raises ``NotEstimable`` (``solver-unavailable``), ``InvalidInput`` (``push-too-late``) and the errors of
    ``load_robot`` and ``load_densities``.
    """
    missing = native_unavailable_reason()
    if missing is not None:
        sentence = f"{missing} Previews need it; a job (plan-motion) works without it."
        raise NotEstimable("solver-unavailable", sentence)
    if request.scenario is None:
        raise ValueError("the endpoint sends the scenario itself")
    started = time.process_time()
    try:
        sequence = contact_sequence_of(request.scenario)
    except InvalidInput as refusal:
        return _invalid_preview(request.scenario, refusal, time.process_time() - started)
    if request.push is not None:
        _require_time(request.push, sequence.duration_s)
    posed = from_rest_to_rest(load_robot(sequence.robot), sequence, _robot_densities(sequence.robot))
    problem = replace(posed, control=CircularCones(), node_rate_hz=request.node_rate_hz)
    plan = solve(problem, "native", LIMITS)
    recovered = None
    if request.push is not None and plan.converged:
        recovered = plan_recovery(problem, plan, request.push)
    return PlanPreview(
        solver=plan.solver,
        duration_s=sequence.duration_s,
        took_s=time.process_time() - started,
        errors=[],
        motion=_preview_motion(plan, 0.0),
        recovered=recovered,
    )


def plan_recovery(problem: CentroidalProblem, plan: CentroidalPlan, push: PreviewPush) -> PreviewMotion:
    """Plan the motion from the end of ``push`` to rest at the end of the sequence."""
    state, ends_s = state_after_push(plan, push)
    horizon = RecedingHorizon(problem=problem, horizon_s=max(problem.sequence.duration_s, 1.0), limits=LIMITS)
    return _preview_motion(solve(horizon.horizon_problem(ends_s, state), "native", LIMITS), ends_s)


def state_after_push(plan: CentroidalPlan, push: PreviewPush) -> tuple[State, float]:
    """State after a push, and its time in seconds.

    The force acts at the CoM, so the angular momentum is unchanged: m (c'' - c''_planned) = f.
    """
    if push.velocity_m_s is not None:
        planned = plan.reference_at(push.time_s)
        return State(planned.com_m, planned.com_v_m_s + np.array(push.velocity_m_s), planned.l_nms), push.time_s
    ends_s = push.time_s + push.duration_s
    planned = plan.reference_at(ends_s)
    a = np.array(push.force_n) / plan.mass_kg
    state = State(planned.com_m + a * push.duration_s**2 / 2, planned.com_v_m_s + a * push.duration_s, planned.l_nms)
    return state, ends_s


def _invalid_preview(scenario: Scenario, refusal: InvalidInput, took_s: float) -> PlanPreview:
    """Response to an invalid scenario: its faults, and an empty motion."""
    empty = PreviewMotion(
        converged=False,
        status=refusal.message,
        objective=None,
        iterations=0,
        solve_time_s=0.0,
        time_s=[],
        com_m=[],
    )
    return PlanPreview(
        solver="native",
        duration_s=math.fsum(phase.duration_s for phase in scenario.phases),
        took_s=took_s,
        errors=[FaultItem(where=fault.where, message=fault.message) for fault in refusal.faults[:SHOWN_FAULTS]],
        motion=empty,
    )


def _require_time(push: PreviewPush, duration_s: float) -> None:
    ends_s = push.time_s + (0.0 if push.force_n is None else push.duration_s)
    if ends_s > duration_s - MIN_RECOVERY_S:
        sentence = (
            f"A push must end {MIN_RECOVERY_S:g} s before the motion does, at {duration_s - MIN_RECOVERY_S:.2f} s."
        )
        raise InvalidInput("push-too-late", sentence, [Fault("push.time_s", f"ends at {ends_s:g} s")])


@lru_cache(maxsize=8)
def _robot_densities(robot: str) -> Mapping[str, Proxy]:
    return load_densities(load_robot(robot), DEFAULT_MEASURE)


def _preview_motion(plan: CentroidalPlan, starts_s: float) -> PreviewMotion:
    is_solved = bool(np.isfinite(plan.com_m).all()) and plan.converged
    return PreviewMotion(
        converged=plan.converged,
        status=plan.status,
        objective=plan.objective if is_solved else None,
        iterations=plan.iterations,
        solve_time_s=plan.solve_time_s,
        time_s=(plan.time_s + starts_s).tolist() if is_solved else [],
        com_m=[(float(x), float(y), float(z)) for x, y, z in plan.com_m] if is_solved else [],
    )
