"""Solving with the C++ solver: from flat arrays to a motion and the solver's report."""

import time
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.control import Forces
from stridelab.centroidal.force_splines import INNER, control_points
from stridelab.centroidal.free_variables import move_contacts
from stridelab.centroidal.native.availability import NativeUnavailable, native_availability, unsupported_features
from stridelab.centroidal.native.problem_arrays import POINTS_PER_BLOCK, NativeInput, native_input
from stridelab.centroidal.nlp.callbacks import Iterate, IterationCallback
from stridelab.centroidal.nlp.kkt import Attempt, IterationLog, NativePoint, Residuals
from stridelab.centroidal.nlp.solvers import TIME_LIMIT_STATUS, Limits
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.verification import Motion
from stridelab.contacts.sequence import ContactSequence
from stridelab.errors import Fault, InvalidInput, NotEstimable

TOLERANCE: Final = 1e-6
"""Tolerance of the first-order conditions in the units of the CasADi nonlinear program."""
OPTIMALITY_GAP: Final = 1e-6
"""Relative optimality gap of the objective."""
OBJECTIVE_SCALE: Final = 1e-2
"""Equal to ``nlp.nlp.SCALE``, which is not imported because it needs CasADi."""
SOLVED: Final = 0
STATUS_TEXTS: Final = (
    "solved",
    "maximum of iterations exceeded",
    TIME_LIMIT_STATUS,
    "the cost is not a number",
    "no step leads on",
    "infeasible",
)
"""Status texts, indexed by the solver's verdict."""


@dataclass(frozen=True, eq=False)
class NativeRun:
    """Result of the C++ solver."""

    attempt: Attempt
    sequence: ContactSequence
    motion: Motion
    point: NativePoint
    infeasible: bool


def require_native(problem: CentroidalProblem) -> None:
    """Raise ``NotEstimable`` (``solver-unavailable``) without the solver, or ``InvalidInput`` (``solver-lacks``).

    The latter names the features of the problem that the solver does not support.
    """
    solver = native_availability()
    if isinstance(solver, NativeUnavailable):
        message = f"The native solver is not available: {solver.reason}"
        raise NotEstimable("solver-unavailable", message, [Fault("solver", solver.reason)])
    unsupported = unsupported_features(problem)
    if unsupported is not None:
        message = f"The native solver does not support {unsupported}."
        raise InvalidInput("solver-lacks", message, [Fault("solver", unsupported)])


def solve_native(
    problem: CentroidalProblem,
    limits: Limits,
    start: NativePoint | None = None,
    on_iteration: IterationCallback | None = None,
) -> NativeRun:
    """Solve a problem; ``on_iteration`` receives all iterations after the solve, which takes milliseconds.

    Raises as ``require_native`` does.
    """
    require_native(problem)
    solver = native_availability()
    assert not isinstance(solver, NativeUnavailable)
    start_cpu_s = time.process_time()
    flat = native_input(problem)
    native_problem = solver.module.problem(*flat.module_arguments())
    warm = start is not None and native_problem.begin(*vars(start).values())
    build_s = time.process_time() - start_cpu_s
    report = native_problem.solve(limits.iterations, limits.cpu_s, TOLERANCE, OPTIMALITY_GAP, warm)
    log = report["log"]
    if on_iteration is not None:
        for i, (cost, infeasibility) in enumerate(log[:, :2].tolist()):
            on_iteration(Iterate(i, cost, infeasibility))
    infeasible = STATUS_TEXTS[report["verdict"]] == "infeasible"
    status = STATUS_TEXTS[report["verdict"]]
    if infeasible:
        status += f": no forces of phase {_phase_of_stage(flat, report['stage']) + 1} allow the rest of the motion"
    attempt = Attempt(
        solver="native",
        status=status,
        success=report["verdict"] == SOLVED,
        iterations=report["iterations"],
        build_s=build_s,
        solve_s=report["cpu_s"],
        residuals=Residuals(
            stationarity=OBJECTIVE_SCALE * report["stationarity"],
            feasibility=report["feasibility"],
            complementarity=OBJECTIVE_SCALE * report["complementarity"],
        ),
        log=IterationLog(log[:, 0], log[:, 1], log[:, 2], log[:, 3]),
    )
    point = NativePoint(*(report[name] for name in ("x", "u", "z", "wrench_u", "wrench_z", "phase_h")))
    sequence = _solved_sequence(problem.sequence, flat, point, report["shift"])
    return NativeRun(attempt, sequence, _motion_from_point(problem, flat, point), point, infeasible)


def _phase_of_stage(flat: NativeInput, stage: int) -> int:
    return int(np.searchsorted(np.cumsum(flat.phase_layout[:, 0]), stage, side="right"))


def _solved_sequence(
    sequence: ContactSequence, flat: NativeInput, point: NativePoint, shift: Float[np.ndarray, "places 2"]
) -> ContactSequence:
    """The sequence with the solved durations and placements, if they are free."""
    if len(flat.duration_limits):
        sequence = sequence.with_durations(flat.phase_layout[:, 0] * point.step_s)
    return move_contacts(sequence, flat.moved, [d @ axes for axes, d in zip(flat.place_axes, shift, strict=True)])


def _motion_from_point(problem: CentroidalProblem, flat: NativeInput, point: NativePoint) -> Motion:
    """Convert a solver point to states in SI units (momentum about the CoM) and world-frame forces."""
    phases, inner = problem.grid().phase, INNER[problem.shape]
    time_s = np.concatenate([[0.0], np.cumsum(inner * point.step_s[phases])])
    x = point.x[::inner]
    c, v = x[:, 0:3] + problem.com_start_m, x[:, 3:6]
    L = problem.weight_n * x[:, 6:9] - problem.mass_kg * np.cross(x[:, 0:3], v)
    points = {name: problem.points_m(name) for name in problem.sequence.effectors}
    forces = {name: np.zeros((inner * len(phases), len(of), 3)) for name, of in points.items()}
    slot = hold = k = 0
    for i, (intervals, first, blocks, _, _) in enumerate(flat.phase_layout.tolist()):
        active = flat.active_controls(i)
        u = np.zeros((intervals, blocks, POINTS_PER_BLOCK, 3))
        u[active] = point.u[slot : slot + active.sum()]
        for b, of in enumerate(flat.slots[i]):
            f = problem.weight_n * u[:, b, : of.points] @ flat.block_axes[first + b].T
            forces[of.effector][k : k + intervals, of.first : of.first + of.points] = f
        if flat.phase_cone[i] >= 0:
            w = point.wrench_u[hold : hold + intervals] @ flat.wrench_cones[flat.phase_cone[i]].T
            for name, name_forces in _distribute_wrenches(problem, i, w).items():
                forces[name][k : k + intervals] = problem.weight_n * name_forces
            hold += intervals
        slot, k = slot + int(active.sum()), k + intervals
    if inner == 1:
        return Motion(time_s, phases, c, v, L, forces, points)
    step_s = np.diff(time_s)
    curves = {name: control_points(f.reshape(-1, inner, *f.shape[1:]), step_s) for name, f in forces.items()}
    return Motion(time_s, phases, c, v, L, {name: f.mean(axis=1) for name, f in curves.items()}, points, curves)


def _distribute_wrenches(problem: CentroidalProblem, phase: int, wrenches: Float[np.ndarray, "n 6"]) -> Forces:
    """Distribute wrenches over the contact points, in units of m |g|."""
    patches = problem.contact_patches(phase, problem.com_start_m)
    ((name, group),) = problem.control.generators(patches).items()
    u = np.linalg.lstsq(group.wrench, wrenches.T, rcond=None)[0].T
    return problem.control.point_forces(patches, {name: u})
