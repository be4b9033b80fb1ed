"""(4.20) on a receding horizon: model-predictive control of the CoM over a contact sequence.

Every period the problem is solved from the current state over the next ``horizon_s`` of the sequence, and the first
period of the solution is executed. A horizon that ends before the sequence requires viability (4.9f) instead of rest:
a capture point inside the last contacts (``boundary_conditions``). Each solution, shifted in time, warm-starts the
next.

If a problem has no solution, the last converged plan continues: it ends in a capturable state.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stridelab.centroidal.boundary_conditions import Start
from stridelab.centroidal.native.availability import native_can_solve
from stridelab.centroidal.nlp.solvers import Limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.solver import SolverChoice, solve
from stridelab.centroidal.warm_start import warm_start_point
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.conventions import Points, Series, Vector3
from stridelab.errors import Fault, InvalidInput, NotEstimable

SOLVE_LIMITS = Limits(iterations=100, cpu_s=10.0)
"""Limits of one solve."""
MIN_PHASE_S = 1e-6
"""Remaining phase durations up to this threshold are dropped."""
FINAL_PLAN_S = 1.0
"""Replanning stops this long before the end; the remaining time is too short to correct a disturbance."""
LANDING_S = 0.2
"""A horizon that would end without a sole in contact is extended to this time after the next touch-down."""


@dataclass(frozen=True, eq=False)
class State:
    """CoM position and velocity, and angular momentum about the CoM."""

    com_m: Vector3
    com_v_m_s: Vector3
    l_nms: Vector3


@dataclass(frozen=True, eq=False)
class Replan:
    """One solve of the horizon problem at ``time_s`` from ``state``.

    If it failed, ``carried_on`` is True, ``plan`` is the last converged one and ``since_s`` its age (0 otherwise).
    ``took_s`` is the total processor time: cutting the sequence, warm start, building, solving, checking.
    """

    time_s: float
    problem: CentroidalProblem
    state: State
    plan: CentroidalPlan
    since_s: float
    carried_on: bool
    warm: bool
    iterations: int
    took_s: float


@dataclass(frozen=True, eq=False)
class RecedingMotion:
    """The executed states at the end of every period, and the replans."""

    time_s: Series
    com_m: Points
    com_v_m_s: Points
    l_nms: Points
    replans: tuple[Replan, ...]


Disturbance = Callable[[float, State], State]
"""Maps a time and the planned state to the actual (disturbed) state."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RecedingHorizon:
    """Receding-horizon control of ``problem`` from its start to its end.

    Raises ``InvalidInput``: ``horizon-invalid`` unless ``0 < period_s < horizon_s``, ``horizon-needs-constants`` for
    splines, which would be discontinuous at every replan.
    """

    problem: CentroidalProblem
    horizon_s: float = 2.5
    period_s: float = 0.1
    limits: Limits = SOLVE_LIMITS
    warm: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.period_s < self.horizon_s < np.inf:
            message = f"A horizon of {self.horizon_s:g} s cannot be replanned every {self.period_s:g} s."
            raise InvalidInput("horizon-invalid", message, [Fault("horizon_s", message)])
        if self.problem.shape == "cubic":
            message = (
                "A receding horizon needs forces that are constant between nodes: splines would jump at every replan."
            )
            raise InvalidInput("horizon-needs-constants", message, [Fault("shape", message)])

    def run(self, disturb: Disturbance | None = None) -> RecedingMotion:
        """Execute the problem; ``disturb`` may change the state after every period.

        Raises ``NotEstimable`` (``horizon-lost``) if no solve converged, or if the last converged plan has ended.
        """
        replans = tuple(self.iterate_replans(disturb))
        total_s, last = self.problem.sequence.duration_s, replans[-1]
        times_s = [*(r.time_s for r in replans), total_s]
        end = last.plan.reference_at(last.since_s + total_s - last.time_s)
        states = [*(r.state for r in replans), State(end.com_m, end.com_v_m_s, end.l_nms)]
        return RecedingMotion(
            np.array(times_s),
            np.array([s.com_m for s in states]),
            np.array([s.com_v_m_s for s in states]),
            np.array([s.l_nms for s in states]),
            replans,
        )

    def iterate_replans(self, disturb: Disturbance | None = None) -> Iterator[Replan]:
        """Yield the replans as they are computed; the last one is executed to the end. Raises as ``run``."""
        problem = self.problem
        state = State(problem.com_start_m, problem.start.com_v_m_s, problem.start.l_nms)
        last: Replan | None = None
        n = max(1, round((problem.sequence.duration_s - FINAL_PLAN_S) / self.period_s) + 1)
        for k in range(n):
            time_s = k * self.period_s
            last = self.solve_from(time_s, state, last)
            yield last
            reference = last.plan.reference_at(last.since_s + self.period_s)
            state = State(reference.com_m, reference.com_v_m_s, reference.l_nms)
            if disturb is not None:
                state = disturb(time_s + self.period_s, state)

    def solve_from(self, time_s: float, state: State, last: Replan | None = None) -> Replan:
        """Solve from ``state`` at ``time_s``; ``last``, the previous replan, is the warm start and the fallback.

        Raises ``NotEstimable`` (``horizon-lost``) if the solve fails and no earlier plan continues.
        """
        started = time.process_time()
        problem = self.horizon_problem(time_s, state)
        start = None
        if self.warm and last is not None and not last.carried_on:
            start = warm_start_point(last.plan, problem, time_s - last.time_s)
        solver: Final[SolverChoice] = "native" if native_can_solve(problem) else "ipopt"
        plan = solve(problem, solver, self.limits, start)
        iterations, warm = plan.iterations, start is not None
        if not plan.converged and warm:
            plan, warm = solve(problem, solver, self.limits), False
            iterations += plan.iterations
        took_s = time.process_time() - started
        if plan.converged:
            return Replan(time_s, problem, state, plan, 0.0, False, warm, iterations, took_s)
        since_s = np.inf if last is None else last.since_s + time_s - last.time_s
        if last is None or since_s + self.period_s > last.plan.time_s[-1]:
            raise NotEstimable(
                "horizon-lost",
                f"No motion exists from the state at {time_s:.1f} s, and no earlier plan continues: {plan.status}",
                [Fault(f"phases[{self.problem.sequence.phase_at(time_s)}]", plan.status)],
            )
        return Replan(time_s, last.problem, state, last.plan, since_s, True, warm, iterations, took_s)

    def horizon_problem(self, time_s: float, state: State) -> CentroidalProblem:
        """The problem over the next ``horizon_s`` from a state."""
        problem, sequence = self.problem, self.problem.sequence
        end_s = self._end_s(time_s + self.horizon_s)
        ends = end_s > sequence.duration_s - MIN_PHASE_S
        return replace(
            problem,
            sequence=cut_sequence(sequence, time_s, end_s),
            com_start_m=state.com_m,
            start=Start(state.com_v_m_s, state.l_nms),
            com_end_m=problem.com_end_m if ends else self._goal_m(sequence.phase_at(end_s - MIN_PHASE_S)),
            terminal=problem.terminal if ends else "capturable",
        )

    def _end_s(self, wanted_s: float) -> float:
        """First time from ``wanted_s`` on with a sole in contact (plus ``LANDING_S``), or the end of the sequence."""
        sequence = self.problem.sequence
        end_s = min(wanted_s, sequence.duration_s)
        while not self._sole_contacts(sequence.phase_at(end_s - MIN_PHASE_S)):
            end_s = min(sequence.duration_s, float(sequence.ends_s[sequence.phase_at(end_s - MIN_PHASE_S)]) + LANDING_S)
            if end_s >= sequence.duration_s:
                break
        return end_s

    def _sole_contacts(self, phase: int) -> dict[str, Contact]:
        contacts = self.problem.sequence.phases[phase].contacts
        return {name: c for name, c in contacts.items() if self.problem.effectors[name].kind == "surface"}

    def _goal_m(self, phase: int) -> Vector3:
        """CoM goal above the current or latest soles, at the height of the whole motion's end above its soles."""
        sequence, effectors = self.problem.sequence, self.problem.effectors
        final = standing_com_m(sequence.phases[-1].contacts, 0.0, effectors)
        height_m = float(self.problem.com_end_m[2] - final[2])
        soles = {
            name: contact
            for name in sequence.effectors
            if effectors[name].kind == "surface" and (contact := sequence.last_contact(name, phase)) is not None
        }
        return standing_com_m(soles, height_m, effectors)


def cut_sequence(sequence: ContactSequence, start_s: float, end_s: float) -> ContactSequence:
    """The part of a sequence between two times, with its first and last phases shortened."""
    phases = []
    for begin, end, phase in zip(sequence.starts_s, sequence.ends_s, sequence.phases, strict=True):
        length_s = float(min(end, end_s) - max(begin, start_s))
        if length_s > MIN_PHASE_S:
            phases.append(ContactPhase(length_s, phase.contacts))
    return replace(sequence, phases=tuple(phases), start_com_height_m=None)
