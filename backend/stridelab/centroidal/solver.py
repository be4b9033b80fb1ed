"""What the solver chose where it was free to: the contact sequence with its durations and placements.

From a problem to a plan: transcribe, solve, read the solution, check it.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from stridelab.centroidal.boundary_conditions import Terminal
from stridelab.centroidal.cost_terms import cost_terms, objective
from stridelab.centroidal.force_splines import INNER, control_points
from stridelab.centroidal.native.availability import serves
from stridelab.centroidal.native.solve import solve_native
from stridelab.centroidal.nlp.callbacks import Tell
from stridelab.centroidal.nlp.kkt import Attempt, NativePoint, Point, Solution, residuals
from stridelab.centroidal.nlp.solvers import DEFAULT_LIMITS, Limits, Run, SolverName, run
from stridelab.centroidal.nlp.transcription import Transcription, transcribe
from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.verification import Motion, holds, total_force_n, verify
from stridelab.centroidal.warm_start import carried
from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.conventions import Series, g
from stridelab.errors import Fault, InvalidInput


def chosen(programme: Transcription, w: Series) -> ContactSequence:
    """The sequence of the problem, or with what ``w`` says of durations and contacts."""
    problem, layout = programme.problem, programme.layout
    sequence = problem.sequence
    if not (problem.durations or problem.placements):
        return sequence
    durations_s = [
        float(w[layout.durations[i]]) if problem.durations else phase.duration_s
        for i, phase in enumerate(sequence.phases)
    ]
    contacts: list[dict[str, Contact]] = [dict(phase.contacts) for phase in sequence.phases]
    for stay, at in zip(programme.movable, layout.shifts, strict=True):
        place = stay.contact.placement
        moved = replace(place, position_m=place.position_m + place.rotation[:, :2] @ w[at : at + 2])
        for i in range(stay.first, stay.last + 1):
            contacts[i][stay.contact.effector] = replace(stay.contact, placement=moved)
    phases = [
        replace(phase, duration_s=duration_s, contacts=touching)
        for phase, duration_s, touching in zip(sequence.phases, durations_s, contacts, strict=True)
    ]
    return replace(sequence, phases=tuple(phases))


AUTO: tuple[SolverName, ...] = ("ipopt", "fatrop")
"""Solvers of CasADi in the order in which they are tried: ipopt was faster and surer in every measurement."""
KKT_ERROR_MAX: Final = 2e-5
"""A point is a solution where its solver says so, or where no first-order condition lacks more than this."""
Asked = Literal["auto", "native", "casadi", "ipopt", "fatrop"]


@dataclass(frozen=True, eq=False)
class _Found:
    attempt: Attempt
    sequence: ContactSequence
    motion: Motion
    point: Point | NativePoint
    infeasible: bool


def solve(
    problem: CentroidalProblem,
    solver: Asked = "auto",
    limits: Limits = DEFAULT_LIMITS,
    start: Point | NativePoint | None = None,
    tell: Tell | None = None,
) -> CentroidalPlan:
    """Solve (4.20), cold, or from ``start``: a plan's ``solution.point``, or what ``carried`` makes of another plan.

    "auto" asks the C++ solver where it is built and does all that the problem wants, then those of CasADi, as "casadi"
    does; "native" asks it alone. A start counts for the solvers that know its kind. The plan of a failed solve says so:
    ``converged`` False and why in ``status``. The next solver is tried where one does not converge, unless that proved
    that there is no solution at all or the time is up. Free durations begin where the given ones lead, if they lead
    anywhere. Times and iterations are sums over all attempts. A plan is converged only if the solver, or our look at
    its first-order conditions, says so *and* ``verify`` agrees. Raises ``NotEstimable`` where the contacts have no cone
    for the problem's control (u_c only), as ``require_native`` does where "native" is asked for,
    and ``InvalidInput`` (``shape-needs-ipopt``) where fatrop is asked for splines.
    """
    started = time.process_time()
    attempts: list[Attempt] = []
    verification = None
    for found in _attempts(problem, solver, limits, start, tell, attempts):
        attempts.append(found.attempt)
        verification = verify(
            found.sequence,
            problem.mass_kg,
            found.motion,
            problem.com_start_m,
            problem.com_end_m,
            problem.start,
            problem.terminal,
        )
        converged = _solved(found.attempt) and holds(verification)
        proved = found.infeasible and not (problem.durations or problem.placements)
        if converged or proved or time.process_time() - started > limits.cpu_s:
            break
    assert verification is not None
    motion = found.motion
    terms = cost_terms(replace(problem, sequence=found.sequence), motion)
    return CentroidalPlan(
        sequence=found.sequence,
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
        status=_sentence(attempts, found.infeasible, converged, verification, problem.terminal),
        iterations=sum(a.iterations for a in attempts),
        objective=objective(terms),
        cost_terms=terms,
        solve_time_s=sum(a.solve_s for a in attempts),
        build_time_s=sum(a.build_s for a in attempts),
        verification=verification,
        solution=Solution(tuple(attempts), found.point),
        curves_n=motion.curves_n,
    )


def _attempts(
    problem: CentroidalProblem,
    asked: Asked,
    limits: Limits,
    start: Point | NativePoint | None,
    tell: Tell | None,
    attempts: list[Attempt],
) -> Iterator[_Found]:
    """One solver after the other; ``attempts`` gets what is solved on the way to a start."""
    theirs = start if isinstance(start, NativePoint) else None
    if asked == "native" or (asked == "auto" and serves(problem)):
        run_ = solve_native(problem, limits, theirs, tell)
        yield _Found(run_.attempt, run_.sequence, run_.motion, run_.point, run_.infeasible)
    if asked == "native":
        return
    started = time.process_time()
    programme = transcribe(problem)
    transcribe_s = time.process_time() - started
    ours = start if isinstance(start, Point) else None
    if problem.durations and start is None:
        given = solve(replace(problem, durations=None), "ipopt", limits)
        transcribe_s += given.build_time_s
        if given.solution is not None:
            attempts += [replace(attempt, build_s=0.0) for attempt in given.solution.attempts]
        found = carried(given, problem) if given.converged else None
        ours = found if isinstance(found, Point) else None
    for name in _solvers(problem, asked):
        ran = run(name, programme, limits, ours, tell)
        attempt = _attempt(name, programme, ran)
        sequence = chosen(programme, ran.point.w)
        motion = read(programme, sequence, ran.point.w)
        attempt = replace(attempt, build_s=attempt.build_s + transcribe_s)
        transcribe_s = 0.0
        yield _Found(attempt, sequence, motion, ran.point, ran.infeasible)


def _solvers(problem: CentroidalProblem, asked: Asked) -> tuple[SolverName, ...]:
    """What is free, and a spline, belongs to many stages: fatrop, which goes from one to the next, is not asked."""
    if asked == "fatrop" and problem.shape == "cubic":
        message = "fatrop goes from stage to stage, and continuous controls belong to several: ask for ipopt."
        raise InvalidInput("shape-needs-ipopt", message, [Fault("solver", message)])
    if asked == "ipopt" or asked == "fatrop":
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


def _sentence(
    attempts: list[Attempt], infeasible: bool, converged: bool, verification: Verification, terminal: Terminal
) -> str:
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
    if infeasible:
        ends = "at rest at the goal" if terminal == "rest" else "where it could be stopped"
        return f"No motion over these contacts ends {ends} ({said})."
    return f"No motion was found over these contacts, nor a proof that there is none ({said})."
