"""Centroidal stage of ``plan-motion``: solves with piecewise constant forces first, then with force splines."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from stridelab.centroidal.force_splines import Shape
from stridelab.centroidal.infeasibility.diagnosis import diagnose
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.errors import Fault, NotEstimable
from stridelab.pipelines.plan_problem import iteration_callback, limits_of, require_time, solver_of
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import PlanMotionInput

Change = Callable[[CentroidalProblem], CentroidalProblem]
"""Changes a problem before it is solved."""
FIRST_SOLVE_SHARE: Final = 0.3
"""Share of the progress taken by the first of two solves."""


def force_shape(request: PlanMotionInput) -> Shape:
    """Force interpolation between nodes: as requested, else cubic if the whole body has to track the forces."""
    if request.shape is not None:
        return request.shape
    splines = request.whole_body and request.formulation != "wrench" and request.solver != "fatrop"
    return "cubic" if splines else "constant"


def solve_centroidal(
    problem: CentroidalProblem, request: PlanMotionInput, tell: ProgressCallback, change: Change | None = None
) -> tuple[CentroidalProblem, CentroidalPlan]:
    """Solve the centroidal problem; returns the solved problem and its plan.

    Splines are solved after constant forces and use the durations of that solution. If the spline problem does not
    converge and splines were not requested, the constant forces are returned. ``change`` applies to the problem whose
    solution is returned; it depends on the grid of its shape. Raises ``NotEstimable``
    (``plan-time-limit``, ``plan-not-converged``).
    """
    if force_shape(request) == "constant":
        problem = problem if change is None else change(problem)
        return problem, _require_converged(problem, request, _solve_request(problem, request, tell))
    plan = _require_converged(
        problem, request, _solve_request(problem, request, _progress_part(tell, 0.0, FIRST_SOLVE_SHARE))
    )
    smooth = replace(problem, sequence=plan.sequence, durations=None, shape="cubic")
    smooth = smooth if change is None else change(smooth)
    spline_plan = _solve_request(smooth, request, _progress_part(tell, FIRST_SOLVE_SHARE, 1.0))
    if spline_plan.converged or request.shape is not None:
        return smooth, _require_converged(smooth, request, spline_plan)
    return problem, plan


def force_jump_remarks(problem: CentroidalProblem, request: PlanMotionInput) -> tuple[Remark, ...]:
    """A remark if force splines were attempted and the plan has piecewise constant forces."""
    if force_shape(request) == problem.shape:
        return ()
    message = "The problem with continuous forces did not converge: the planned forces jump from node to node."
    return (Remark(code="forces-jump", message=message),)


def _progress_part(tell: ProgressCallback, begin: float, end: float) -> ProgressCallback:
    return lambda fraction, message: tell(begin + (end - begin) * fraction, message)


def _solve_request(problem: CentroidalProblem, request: PlanMotionInput, tell: ProgressCallback) -> CentroidalPlan:
    return solve(problem, solver_of(request), limits_of(request), on_iteration=iteration_callback(tell))


def _require_converged(problem: CentroidalProblem, request: PlanMotionInput, plan: CentroidalPlan) -> CentroidalPlan:
    if plan.converged:
        return plan
    require_time(request, plan)
    diagnosis = diagnose(problem, plan)
    raise NotEstimable(
        "plan-not-converged",
        f"The centroidal plan of {problem.sequence.name!r} did not converge: {plan.status} after {plan.iterations} "
        f"iterations. {diagnosis.sentence}",
        [
            *(Fault(finding.location, finding.description) for finding in diagnosis.findings),
            Fault("solver", f"{plan.solver}: {plan.status}"),
        ],
    )
