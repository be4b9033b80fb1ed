"""From a problem to a plan: transcribe, solve, convert the solution, verify it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Literal

import numpy as np

from stridelab.centroidal.boundary_conditions import Terminal
from stridelab.centroidal.cost_terms import cost_terms
from stridelab.centroidal.force_splines import INNER, control_points
from stridelab.centroidal.free_variables import move_contacts
from stridelab.centroidal.native.availability import native_can_solve
from stridelab.centroidal.native.solve import solve_native
from stridelab.centroidal.nlp.callbacks import IterationCallback
from stridelab.centroidal.nlp.kkt import Attempt, NativePoint, Point, Solution, kkt_residuals
from stridelab.centroidal.nlp.solvers import DEFAULT_LIMITS, Limits, SolverName, SolverRun, run_solver
from stridelab.centroidal.nlp.transcription import Transcription, transcribe
from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.verification import Motion, is_verified, total_force_n, verify
from stridelab.centroidal.warm_start import warm_start_point
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Series, g
from stridelab.errors import Fault, InvalidInput


def solved_sequence(transcription: Transcription, w: Series) -> ContactSequence:
    """The problem's sequence with the solved durations and placements in ``w``, if they are free."""
    problem, layout = transcription.problem, transcription.layout
    sequence = problem.sequence.with_durations(w[layout.durations]) if problem.durations else problem.sequence
    shifts_m = [
        span.contact.placement.rotation[:, :2] @ w[at : at + 2]
        for span, at in zip(transcription.movable_spans, layout.shifts, strict=True)
    ]
    return move_contacts(sequence, transcription.movable_spans, shifts_m)


AUTO: tuple[SolverName, ...] = ("ipopt", "fatrop")
"""CasADi solvers in the order in which they are tried: ipopt was faster and more reliable in all measurements."""
KKT_ERROR_MAX: Final = 2e-5
"""Largest KKT residual of a point that counts as a solution without the solver's success."""
SolverChoice = Literal["auto", "native", "casadi", "ipopt", "fatrop"]


@dataclass(frozen=True, eq=False)
class _SolverResult:
    attempt: Attempt
    sequence: ContactSequence
    motion: Motion
    point: Point | NativePoint
    infeasible: bool


def solve(
    problem: CentroidalProblem,
    solver: SolverChoice = "auto",
    limits: Limits = DEFAULT_LIMITS,
    start: Point | NativePoint | None = None,
    on_iteration: IterationCallback | None = None,
) -> CentroidalPlan:
    """Solve (4.20), from the initial guess or a warm start: a plan's ``solution.point`` or a ``warm_start_point``.

    "auto" tries the C++ solver if it is available and supports the problem, then the CasADi solvers, as "casadi" does;
    "native" uses the C++ solver only. A start is used by the solvers of its kind. If a solver does not converge the
    next one is tried, unless infeasibility is proved or the time is up; a failed plan has ``converged`` False and the
    reason in ``status``. Free durations start from the solution with fixed ones, if it converges. Times and iterations
    are sums over all attempts. A plan is converged only if the solver reports success or the KKT residuals are small,
    *and* ``verify`` confirms it.

    Raises ``NotEstimable`` if the contacts have no cone for the control (u_c only), ``InvalidInput``
    (``shape-needs-ipopt``) for fatrop with splines, and for "native" as ``require_native`` does.
    """
    started = time.process_time()
    attempts: list[Attempt] = []
    verification = None
    for result in _run_solvers(problem, solver, limits, start, on_iteration, attempts):
        attempts.append(result.attempt)
        verification = verify(
            result.sequence,
            problem.mass_kg,
            result.motion,
            problem.com_start_m,
            problem.com_end_m,
            problem.start,
            problem.terminal,
            problem.end,
        )
        converged = _is_solved(result.attempt) and is_verified(verification)
        proved = result.infeasible and not (problem.durations or problem.placements)
        if converged or proved or time.process_time() - started > limits.cpu_s:
            break
    assert verification is not None
    motion = result.motion
    return CentroidalPlan(
        sequence=result.sequence,
        mass_kg=problem.mass_kg,
        time_s=motion.time_s,
        phase=motion.phase,
        com_m=motion.com_m,
        com_v_m_s=motion.com_v_m_s,
        com_a_m_s2=total_force_n(motion) / problem.mass_kg + g,
        l_nms=motion.l_nms,
        forces_n=motion.forces_n,
        points_m=motion.points_m,
        solver=attempts[-1].solver,
        converged=converged,
        status=_status_message(attempts, result.infeasible, converged, verification, problem.terminal),
        iterations=sum(a.iterations for a in attempts),
        compute_cost_terms=partial(cost_terms, replace(problem, sequence=result.sequence), motion),
        solve_time_s=sum(a.solve_s for a in attempts),
        build_time_s=sum(a.build_s for a in attempts),
        verification=verification,
        solution=Solution(tuple(attempts), result.point),
        curves_n=motion.curves_n,
    )


def _run_solvers(
    problem: CentroidalProblem,
    choice: SolverChoice,
    limits: Limits,
    start: Point | NativePoint | None,
    on_iteration: IterationCallback | None,
    attempts: list[Attempt],
) -> Iterator[_SolverResult]:
    """Run one solver after the other; solves for a start are appended to ``attempts``."""
    native_start = start if isinstance(start, NativePoint) else None
    if choice == "native" or (choice == "auto" and native_can_solve(problem)):
        native = solve_native(problem, limits, native_start, on_iteration)
        yield _SolverResult(native.attempt, native.sequence, native.motion, native.point, native.infeasible)
    if choice == "native":
        return
    started = time.process_time()
    transcription = transcribe(problem)
    transcribe_s = time.process_time() - started
    casadi_start = start if isinstance(start, Point) else None
    if problem.durations and start is None:
        fixed_durations = solve(replace(problem, durations=None), "ipopt", limits)
        transcribe_s += fixed_durations.build_time_s
        if fixed_durations.solution is not None:
            attempts += [replace(attempt, build_s=0.0) for attempt in fixed_durations.solution.attempts]
        warm = warm_start_point(fixed_durations, problem) if fixed_durations.converged else None
        casadi_start = warm if isinstance(warm, Point) else None
    for name in _solver_order(problem, choice):
        solver_run = run_solver(name, transcription, limits, casadi_start, on_iteration)
        attempt = _attempt_from_run(name, transcription, solver_run)
        sequence = solved_sequence(transcription, solver_run.point.w)
        motion = motion_from_variables(transcription, sequence, solver_run.point.w)
        attempt = replace(attempt, build_s=attempt.build_s + transcribe_s)
        transcribe_s = 0.0
        yield _SolverResult(attempt, sequence, motion, solver_run.point, solver_run.infeasible)


def _solver_order(problem: CentroidalProblem, choice: SolverChoice) -> tuple[SolverName, ...]:
    """Solvers to try; fatrop, which is stage-wise, cannot handle free variables and splines that span stages."""
    if choice == "fatrop" and problem.shape == "cubic":
        message = "fatrop solves stage by stage, and continuous controls span several stages: choose ipopt."
        raise InvalidInput("shape-needs-ipopt", message, [Fault("solver", message)])
    if choice == "ipopt" or choice == "fatrop":
        return (choice,)
    return AUTO[:1] if problem.durations or problem.placements or problem.shape == "cubic" else AUTO


def _attempt_from_run(name: SolverName, transcription: Transcription, solver_run: SolverRun) -> Attempt:
    kkt = None
    if solver_run.iterations:
        kkt = kkt_residuals(transcription.compiled.nlp, transcription.p, transcription.box, solver_run.point)
    return Attempt(
        name,
        solver_run.status,
        solver_run.success,
        solver_run.iterations,
        solver_run.build_s,
        solver_run.solve_s,
        kkt,
        solver_run.log,
    )


def _is_solved(attempt: Attempt) -> bool:
    return attempt.success or (attempt.residuals is not None and attempt.residuals.kkt_error <= KKT_ERROR_MAX)


def motion_from_variables(transcription: Transcription, sequence: ContactSequence, w: Series) -> Motion:
    """Convert variables to states in SI units (momentum about the CoM) and world-frame forces, for ``sequence``."""
    problem, layout = replace(transcription.problem, sequence=sequence), transcription.layout
    phase = transcription.grid.phase
    lengths_s = sequence.durations_s / np.bincount(phase)
    time_s = np.concatenate([[0.0], np.cumsum(lengths_s[phase])])
    x = transcription.node_states(w)
    c, v = x[:, 0:3] + transcription.origin_m, x[:, 3:6]
    L = problem.weight_n * x[:, 6:9] - problem.mass_kg * np.cross(x[:, 0:3], v)
    points = {name: problem.points_m(name) for name in sequence.effectors}
    inner = INNER[problem.shape]
    forces = {name: np.zeros((len(phase), inner, len(of), 3)) for name, of in points.items()}
    for i in range(len(sequence.phases)):
        values = {
            name: np.array([w[use.start : use.start + use.group.size] for use in uses])
            for name, uses in layout.uses_of(i).items()
        }
        point_forces = problem.control.point_forces(problem.contact_patches(i, transcription.origin_m), values)
        for name, f in point_forces.items():
            forces[name][phase == i] = problem.weight_n * f.reshape(-1, inner, *f.shape[1:])
    if inner == 1:
        return Motion(time_s, phase, c, v, L, {name: f[:, 0] for name, f in forces.items()}, points)
    curves = {name: control_points(f, np.diff(time_s)) for name, f in forces.items()}
    return Motion(time_s, phase, c, v, L, {name: f.mean(axis=1) for name, f in curves.items()}, points, curves)


def _status_message(
    attempts: list[Attempt], infeasible: bool, converged: bool, verification: Verification, terminal: Terminal
) -> str:
    """Status message for the plan."""
    summary = "; ".join(f"{a.solver}: {a.status} after {a.iterations} iterations" for a in attempts)
    if converged:
        return f"Converged ({summary})."
    if _is_solved(attempts[-1]):
        return (
            f"The solver reports a solution ({summary}) that does not verify: dynamics gap "
            f"{verification.dynamics_gap:.1e}, terminal gap {verification.terminal_gap:.1e}, "
            f"cone margin {verification.cone_margin_n:.1e} N."
        )
    if infeasible:
        states = {"rest": "at rest at the goal", "capturable": "in a capturable state", "moving": "in the given state"}
        ends = states[terminal]
        return f"No motion over these contacts ends {ends} ({summary})."
    return f"The solvers did not find a motion over these contacts and did not prove infeasibility ({summary})."
