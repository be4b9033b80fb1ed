"""From a problem to a plan: transcribe, solve, read the solution, check it."""

import time
from typing import Literal

import numpy as np

from stridelab.centroidal.cost import cost_terms, objective
from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solvers import DEFAULT_LIMITS, Limits, Run, SolverName, run
from stridelab.centroidal.transcription import Transcription, transcribe
from stridelab.centroidal.verify import Motion, holds, total_force_n, verify
from stridelab.conventions import Series, g

AUTO: tuple[SolverName, ...] = ("ipopt", "fatrop")
"""Solvers in the order in which "auto" tries them: ipopt was faster and surer in every measurement."""


def solve(
    problem: CentroidalProblem, solver: Literal["auto", "ipopt", "fatrop"] = "auto", limits: Limits = DEFAULT_LIMITS
) -> CentroidalPlan:
    """Solve (4.20). The plan of a failed solve says so: ``converged`` False and why in ``status``; it never raises.

    "auto" tries the next solver where one does not converge, unless that proved that there is no solution at all; times
    and iterations are then the sums. A plan is converged only if the solver says so *and* ``verify`` agrees.
    """
    started = time.process_time()
    programme = transcribe(problem)
    transcribe_s = time.process_time() - started
    runs: list[tuple[SolverName, Run]] = []
    for name in AUTO if solver == "auto" else (solver,):
        found = run(name, programme, limits)
        runs.append((name, found))
        motion = read(programme, found.w)
        verification = verify(problem.sequence, problem.mass_kg, motion, problem.com_start_m, problem.com_end_m)
        converged = found.success and holds(verification)
        if converged or found.infeasible:
            break
    terms = cost_terms(problem, motion)
    return CentroidalPlan(
        sequence=problem.sequence,
        mass_kg=problem.mass_kg,
        time_s=motion.time_s,
        phase=motion.phase,
        com_m=motion.com_m,
        com_v_m_s=motion.com_v_m_s,
        com_a_m_s2=total_force_n(motion) / problem.mass_kg + g,
        l_nms=motion.l_nms,
        forces_n=motion.forces_n,
        points_m=motion.points_m,
        solver=runs[-1][0],
        converged=converged,
        status=_sentence(runs, converged, verification),
        iterations=sum(r.iterations for _, r in runs),
        objective=objective(terms),
        cost_terms=terms,
        solve_time_s=sum(r.solve_s for _, r in runs),
        build_time_s=transcribe_s + sum(r.build_s for _, r in runs),
        verification=verification,
    )


def read(programme: Transcription, w: Series) -> Motion:
    """States in SI units about the CoM and world-frame forces from the programme's variables."""
    problem, layout, grid = programme.problem, programme.layout, programme.grid
    x = programme.states(w)
    c, v = x[:, 0:3] + programme.origin_m, x[:, 3:6]
    L = problem.weight_n * x[:, 6:9] - problem.mass_kg * np.cross(x[:, 0:3], v)
    points = {name: problem.points_m(name) for name in problem.sequence.effectors}
    forces = {name: np.zeros((len(grid.phase), len(of), 3)) for name, of in points.items()}
    for i in range(len(problem.sequence.phases)):
        values = {
            name: np.array([w[use.start : use.start + use.group.size] for use in uses])
            for name, uses in layout.uses_of(i).items()
        }
        found = problem.control.forces(problem.touches(i, programme.origin_m), values)
        for name, f in found.items():
            forces[name][grid.phase == i] = problem.weight_n * f
    return Motion(grid.time_s, grid.phase, c, v, L, forces, points)


def _sentence(runs: list[tuple[SolverName, Run]], converged: bool, verification: Verification) -> str:
    """What happened, in words."""
    said = "; ".join(f"{name}: {r.status} after {r.iterations} iterations" for name, r in runs)
    if converged:
        return f"Converged ({said})."
    if runs[-1][1].success:
        return (
            f"The solver reports a solution ({said}) that does not verify: dynamics gap "
            f"{verification.dynamics_gap:.1e}, terminal gap {verification.terminal_gap:.1e}, "
            f"cone margin {verification.cone_margin_n:.1e} N."
        )
    if runs[-1][1].infeasible:
        return f"No motion over these contacts ends at rest at the goal ({said})."
    return f"No motion was found over these contacts ({said})."
