"""A problem solved by the C++ solver: from flat arrays to a motion with what its solver says of it."""

import time
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.control import Forces
from stridelab.centroidal.force_splines import INNER, control_points
from stridelab.centroidal.native.availability import Missing, availability, lacks
from stridelab.centroidal.native.problem_arrays import POINTS, NativeInput, native_input
from stridelab.centroidal.nlp.callbacks import Iterate, Tell
from stridelab.centroidal.nlp.kkt import Attempt, IterationLog, NativePoint, Residuals
from stridelab.centroidal.nlp.solvers import TIME_IS_UP, Limits
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.verification import Motion
from stridelab.contacts.sequence import ContactSequence
from stridelab.errors import Fault, InvalidInput, NotEstimable

TOLERANCE: Final = 1e-6
"""Of the first-order conditions in the units of the CasADi programme."""
GAP: Final = 1e-6
"""How far the objective may be from its optimum, as a share of it."""
OBJECTIVE_SCALE: Final = 1e-2
"""As ``programme.SCALE``, which is not imported: CasADi is not needed here."""
SOLVED: Final = 0
WORDS: Final = (
    "solved",
    "maximum of iterations exceeded",
    TIME_IS_UP,
    "the cost is not a number",
    "no step leads on",
    "infeasible",
)
"""Of the verdicts, in their order."""


@dataclass(frozen=True, eq=False)
class NativeRun:
    """What the C++ solver found."""

    attempt: Attempt
    sequence: ContactSequence
    motion: Motion
    point: NativePoint
    infeasible: bool


def require_native(problem: CentroidalProblem) -> None:
    """Raise ``NotEstimable`` (``solver-unavailable``) without the solver, or ``InvalidInput`` (``solver-lacks``).

    The latter names what of the problem the solver lacks.
    """
    found = availability()
    if isinstance(found, Missing):
        sentence = f"The native solver cannot serve: {found.reason}"
        raise NotEstimable("solver-unavailable", sentence, [Fault("solver", found.reason)])
    missing = lacks(problem)
    if missing is not None:
        sentence = f"The native solver does not plan with {missing}."
        raise InvalidInput("solver-lacks", sentence, [Fault("solver", missing)])


def solve_native(
    problem: CentroidalProblem, limits: Limits, start: NativePoint | None = None, tell: Tell | None = None
) -> NativeRun:
    """Solve; iterations are told when it is over, which is milliseconds later.

    Raises as ``require_native`` does.
    """
    require_native(problem)
    found = availability()
    assert not isinstance(found, Missing)
    began = time.process_time()
    flat = native_input(problem)
    posed = found.module.problem(*flat.arguments())
    warm = start is not None and posed.begin(*vars(start).values())
    build_s = time.process_time() - began
    said = posed.solve(limits.iterations, limits.cpu_s, TOLERANCE, GAP, warm)
    log = said["log"]
    if tell is not None:
        for i, (cost, infeasibility) in enumerate(log[:, :2].tolist()):
            tell(Iterate(i, cost, infeasibility))
    infeasible = WORDS[said["verdict"]] == "infeasible"
    words = WORDS[said["verdict"]]
    if infeasible:
        words += f": no forces of phase {_phase(flat, said['stage']) + 1} allow what follows"
    attempt = Attempt(
        solver="native",
        status=words,
        success=said["verdict"] == SOLVED,
        iterations=said["iterations"],
        build_s=build_s,
        solve_s=said["cpu_s"],
        residuals=Residuals(
            stationarity=OBJECTIVE_SCALE * said["stationarity"],
            feasibility=said["feasibility"],
            complementarity=OBJECTIVE_SCALE * said["complementarity"],
        ),
        log=IterationLog(log[:, 0], log[:, 1], log[:, 2], log[:, 3]),
    )
    point = NativePoint(*(said[name] for name in ("x", "u", "z", "wrench_u", "wrench_z", "phase_h")))
    sequence = _placed(_chosen(problem.sequence, flat, point), flat, said["shift"])
    return NativeRun(attempt, sequence, _motion(problem, flat, point), point, infeasible)


def _phase(flat: NativeInput, stage: int) -> int:
    return int(np.searchsorted(np.cumsum(flat.phase_layout[:, 0]), stage, side="right"))


def _chosen(sequence: ContactSequence, flat: NativeInput, point: NativePoint) -> ContactSequence:
    """With the durations that were found; the same where they are given."""
    if not len(flat.freedom):
        return sequence
    durations_s = (flat.phase_layout[:, 0] * point.step_s).tolist()
    phases = [replace(p, duration_s=s) for p, s in zip(sequence.phases, durations_s, strict=True)]
    return replace(sequence, phases=tuple(phases))


def _placed(sequence: ContactSequence, flat: NativeInput, shift: Float[np.ndarray, "places 2"]) -> ContactSequence:
    """With the contacts where they were put."""
    touching = [dict(phase.contacts) for phase in sequence.phases]
    for stay, axes, d in zip(flat.moved, flat.place_axes, shift, strict=True):
        place = stay.contact.placement
        there = replace(stay.contact, placement=replace(place, position_m=place.position_m + d @ axes))
        for i in range(stay.first, stay.last + 1):
            touching[i][stay.contact.effector] = there
    if not flat.moved:
        return sequence
    phases = [replace(p, contacts=contacts) for p, contacts in zip(sequence.phases, touching, strict=True)]
    return replace(sequence, phases=tuple(phases))


def _motion(problem: CentroidalProblem, flat: NativeInput, point: NativePoint) -> Motion:
    """States in SI units about the CoM, world-frame forces."""
    phases, inner = problem.grid().phase, INNER[problem.shape]
    time_s = np.concatenate([[0.0], np.cumsum(inner * point.step_s[phases])])
    x = point.x[::inner]
    c, v = x[:, 0:3] + problem.com_start_m, x[:, 3:6]
    L = problem.weight_n * x[:, 6:9] - problem.mass_kg * np.cross(x[:, 0:3], v)
    points = {name: problem.points_m(name) for name in problem.sequence.effectors}
    forces = {name: np.zeros((inner * len(phases), len(of), 3)) for name, of in points.items()}
    slot = hold = k = 0
    for i, (intervals, first, blocks, _, _) in enumerate(flat.phase_layout.tolist()):
        there = flat.present(i)
        u = np.zeros((intervals, blocks, POINTS, 3))
        u[there] = point.u[slot : slot + there.sum()]
        for b, of in enumerate(flat.slots[i]):
            f = problem.weight_n * u[:, b, : of.points] @ flat.block_axes[first + b].T
            forces[of.effector][k : k + intervals, of.first : of.first + of.points] = f
        if flat.phase_cone[i] >= 0:
            w = point.wrench_u[hold : hold + intervals] @ flat.wrench_cones[flat.phase_cone[i]].T
            for name, of_name in _shared(problem, i, w).items():
                forces[name][k : k + intervals] = problem.weight_n * of_name
            hold += intervals
        slot, k = slot + int(there.sum()), k + intervals
    if inner == 1:
        return Motion(time_s, phases, c, v, L, forces, points)
    step_s = np.diff(time_s)
    curves = {name: control_points(f.reshape(-1, inner, *f.shape[1:]), step_s) for name, f in forces.items()}
    return Motion(time_s, phases, c, v, L, {name: f.mean(axis=1) for name, f in curves.items()}, points, curves)


def _shared(problem: CentroidalProblem, phase: int, wrenches: Float[np.ndarray, "n 6"]) -> Forces:
    """Point forces of wrenches, in units of m |g|."""
    touches = problem.touches(phase, problem.com_start_m)
    ((name, group),) = problem.control.generators(touches).items()
    u = np.linalg.lstsq(group.wrench, wrenches.T, rcond=None)[0].T
    return problem.control.forces(touches, {name: u})
