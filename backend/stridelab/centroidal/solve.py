"""From a problem to a plan: transcribe, solve, read the solution, check it."""

import time
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from stridelab.centroidal.carried import carried
from stridelab.centroidal.chosen import chosen
from stridelab.centroidal.cost import cost_terms, objective
from stridelab.centroidal.iterates import Tell
from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solution import Attempt, Point, Solution, residuals
from stridelab.centroidal.solvers import DEFAULT_LIMITS, Limits, Run, SolverName, run
from stridelab.centroidal.spline import INNER, control_points
from stridelab.centroidal.transcription import Transcription, transcribe
from stridelab.centroidal.verify import Motion, holds, total_force_n, verify
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Series, g
from stridelab.errors import Fault, InvalidInput

AUTO: tuple[SolverName, ...] = ("ipopt", "fatrop")
"""Solvers in the order in which "auto" tries them: ipopt was faster and surer in every measurement."""
KKT_ERROR_MAX: Final = 2e-5
"""A point is a solution where its solver says so, or where no first-order condition lacks more than this."""


def solve(
    problem: CentroidalProblem,
    solver: Literal["auto", "ipopt", "fatrop"] = "auto",
    limits: Limits = DEFAULT_LIMITS,
    start: Point | None = None,
    tell: Tell | None = None,
) -> CentroidalPlan:
    """Solve (4.20), cold, or from ``start``: a plan's ``solution.point``, or what ``carried`` makes of another plan.

    The plan of a failed solve says so: ``converged`` False and why in ``status``. "auto" tries the next solver where
    one does not converge, unless that proved that there is no solution at all or its time is up. Free durations begin
    where the given ones lead, if they lead anywhere. Times and iterations are sums over all attempts. A plan is
    converged only if the solver, or our look at its first-order conditions, says so *and* ``verify`` agrees. Raises
    ``NotEstimable`` where the contacts have no cone for the problem's control (u_c only), and ``InvalidInput``
    ("shape-needs-ipopt") where fatrop is asked for splines; nothing else.
    """
    started = time.process_time()
    programme = transcribe(problem)
    transcribe_s = time.process_time() - started
    attempts: list[Attempt] = []
    if problem.durations and start is None:
        given = solve(replace(problem, durations=None), "ipopt", limits)
        transcribe_s += given.build_time_s
        if given.solution is not None:
            attempts += [replace(attempt, build_s=0.0) for attempt in given.solution.attempts]
        start = carried(given, problem) if given.converged else None
    for name in _solvers(problem, solver):
        found = run(name, programme, limits, start, tell)
        attempts.append(_attempt(name, programme, found))
        sequence = chosen(programme, found.point.w)
        motion = read(programme, sequence, found.point.w)
        verification = verify(
            sequence,
            problem.mass_kg,
            motion,
            problem.com_start_m,
            problem.com_end_m,
            problem.start,
            problem.terminal,
        )
        converged = _solved(attempts[-1]) and holds(verification)
        proved = found.infeasible and not (problem.durations or problem.placements)
        if converged or proved or time.process_time() - started > limits.cpu_s:
            break
    terms = cost_terms(replace(problem, sequence=sequence), motion)
    return CentroidalPlan(
        sequence=sequence,
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
        status=_sentence(attempts, found, converged, verification),
        iterations=sum(a.iterations for a in attempts),
        objective=objective(terms),
        cost_terms=terms,
        solve_time_s=sum(a.solve_s for a in attempts),
        build_time_s=transcribe_s + sum(a.build_s for a in attempts),
        verification=verification,
        solution=Solution(tuple(attempts), found.point),
        curves_n=motion.curves_n,
    )


def _solvers(problem: CentroidalProblem, asked: Literal["auto", "ipopt", "fatrop"]) -> tuple[SolverName, ...]:
    """What is free, and a spline, belongs to many stages: fatrop, which goes from one to the next, is not asked."""
    if asked == "fatrop" and problem.shape == "cubic":
        message = "fatrop goes from stage to stage, and continuous controls belong to several: ask for ipopt."
        raise InvalidInput("shape-needs-ipopt", message, [Fault("solver", message)])
    if asked != "auto":
        return (asked,)
    return AUTO[:1] if problem.durations or problem.placements or problem.shape == "cubic" else AUTO


def _attempt(name: SolverName, programme: Transcription, found: Run) -> Attempt:
    checked = None
    if found.iterations:
        checked = residuals(programme.compiled.programme, programme.p, programme.box, found.point)
    return Attempt(
        name, found.status, found.success, found.iterations, found.build_s, found.solve_s, checked, found.log
    )


def _solved(attempt: Attempt) -> bool:
    return attempt.success or (attempt.residuals is not None and attempt.residuals.kkt_error <= KKT_ERROR_MAX)


def read(programme: Transcription, sequence: ContactSequence, w: Series) -> Motion:
    """States in SI units about the CoM and world-frame forces from the variables, for the chosen ``sequence``."""
    problem, layout = replace(programme.problem, sequence=sequence), programme.layout
    phase = programme.grid.phase
    lengths_s = np.array([p.duration_s for p in sequence.phases]) / np.bincount(phase)
    time_s = np.concatenate([[0.0], np.cumsum(lengths_s[phase])])
    x = programme.states(w)
    c, v = x[:, 0:3] + programme.origin_m, x[:, 3:6]
    L = problem.weight_n * x[:, 6:9] - problem.mass_kg * np.cross(x[:, 0:3], v)
    points = {name: problem.points_m(name) for name in sequence.effectors}
    inner = INNER[problem.shape]
    forces = {name: np.zeros((len(phase), inner, len(of), 3)) for name, of in points.items()}
    for i in range(len(sequence.phases)):
        values = {
            name: np.array([w[use.start : use.start + use.group.size] for use in uses])
            for name, uses in layout.uses_of(i).items()
        }
        found = problem.control.forces(problem.touches(i, programme.origin_m), values)
        for name, f in found.items():
            forces[name][phase == i] = problem.weight_n * f.reshape(-1, inner, *f.shape[1:])
    if inner == 1:
        return Motion(time_s, phase, c, v, L, {name: f[:, 0] for name, f in forces.items()}, points)
    curves = {name: control_points(f, np.diff(time_s)) for name, f in forces.items()}
    return Motion(time_s, phase, c, v, L, {name: f.mean(axis=1) for name, f in curves.items()}, points, curves)


def _sentence(attempts: list[Attempt], last: Run, converged: bool, verification: Verification) -> str:
    """What happened, in words."""
    said = "; ".join(f"{a.solver}: {a.status} after {a.iterations} iterations" for a in attempts)
    if converged:
        return f"Converged ({said})."
    if _solved(attempts[-1]):
        return (
            f"The solver reports a solution ({said}) that does not verify: dynamics gap "
            f"{verification.dynamics_gap:.1e}, terminal gap {verification.terminal_gap:.1e}, "
            f"cone margin {verification.cone_margin_n:.1e} N."
        )
    if last.infeasible:
        return f"No motion over these contacts ends at rest at the goal ({said})."
    return f"No motion was found over these contacts ({said})."
