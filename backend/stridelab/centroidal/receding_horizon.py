"""(4.20) on a horizon that recedes: model-predictive control of the CoM over a contact sequence.

Every period the problem is solved anew from where the CoM is, over the next ``horizon_s`` of the sequence, and the
first period of its solution is carried out. A horizon that ends before the sequence asks for viability (4.9f) in place
of rest: a CoM whose capture point lies in the last contacts (``conditions``). Each solution, moved along, starts
the next.

Where a problem has no solution the last plan that had one goes on: it leads to a state that can be stopped.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stridelab.centroidal.boundary_conditions import Start
from stridelab.centroidal.native.availability import serves
from stridelab.centroidal.nlp.solvers import Limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.solver import Asked, solve
from stridelab.centroidal.warm_start import carried
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.conventions import Points, Series, Vector3
from stridelab.errors import Fault, InvalidInput, NotEstimable

SHORT = Limits(iterations=100, cpu_s=10.0)
"""Limits of one solve."""
SLIVER_S = 1e-6
"""Rests of phases that are shorter are none."""
LAST_S = 1.0
"""So long before the end the last plan is carried out as it is: what little is left cannot undo a disturbance."""
LANDING_S = 0.2
"""A horizon that would end in the air, or on hands, ends so long after the next sole has touched."""


@dataclass(frozen=True, eq=False)
class State:
    """Where the CoM is, how fast, and the angular momentum about it."""

    com_m: Vector3
    com_v_m_s: Vector3
    l_nms: Vector3


@dataclass(frozen=True, eq=False)
class Replan:
    """One solution: when, of which problem, the state it began with; ``carried_on`` where it failed.

    ``plan`` is then the last one that had a solution, ``since_s`` older than this moment, else zero. ``took_s`` is the
    processor time of all of it: cutting, moving along, building, solving, checking.
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
class Receding:
    """What was carried out, at the end of every period, and how it was found."""

    time_s: Series
    com_m: Points
    com_v_m_s: Points
    l_nms: Points
    replans: tuple[Replan, ...]


Disturb = Callable[[float, State], State]
"""The state that is found where a plan meant to be, at a time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RecedingHorizon:
    """``problem`` from its start to its end in periods.

    Raises ``InvalidInput``: ``horizon-invalid`` unless ``0 < period_s < horizon_s``, ``horizon-needs-constants`` for
    splines, which would jump at every replan.
    """

    problem: CentroidalProblem
    horizon_s: float = 2.5
    period_s: float = 0.1
    limits: Limits = SHORT
    warm: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.period_s < self.horizon_s < np.inf:
            message = f"A horizon of {self.horizon_s:g} s cannot be solved anew every {self.period_s:g} s."
            raise InvalidInput("horizon-invalid", message, [Fault("horizon_s", message)])
        if self.problem.shape == "cubic":
            message = "A horizon that recedes begins anew with every plan: its forces are constant between nodes."
            raise InvalidInput("horizon-needs-constants", message, [Fault("shape", message)])

    def run(self, disturb: Disturb | None = None) -> Receding:
        """Carry the problem out; ``disturb`` may move the state after every period.

        Raises ``NotEstimable`` (``horizon-lost``) where no solution was ever found, or the last has come to its end.
        """
        replans = tuple(self.replans(disturb))
        total_s, last = self.problem.sequence.duration_s, replans[-1]
        at = [*(r.time_s for r in replans), total_s]
        end = last.plan.at(last.since_s + total_s - last.time_s)
        states = [*(r.state for r in replans), State(end.com_m, end.com_v_m_s, end.l_nms)]
        return Receding(
            np.array(at),
            np.array([s.com_m for s in states]),
            np.array([s.com_v_m_s for s in states]),
            np.array([s.l_nms for s in states]),
            replans,
        )

    def replans(self, disturb: Disturb | None = None) -> Iterator[Replan]:
        """One after the other, as they come; the last one is carried out to the end. Raises as ``run``."""
        problem = self.problem
        state = State(problem.com_start_m, problem.start.com_v_m_s, problem.start.l_nms)
        last: Replan | None = None
        n = max(1, round((problem.sequence.duration_s - LAST_S) / self.period_s) + 1)
        for k in range(n):
            time_s = k * self.period_s
            last = self.step(time_s, state, last)
            yield last
            there = last.plan.at(last.since_s + self.period_s)
            state = State(there.com_m, there.com_v_m_s, there.l_nms)
            if disturb is not None:
                state = disturb(time_s + self.period_s, state)

    def step(self, time_s: float, state: State, last: Replan | None = None) -> Replan:
        """Solve from ``state`` at ``time_s`` on; ``last`` is the replan before, a start, and what goes on otherwise.

        Raises ``NotEstimable`` (``horizon-lost``) where no solution is found and none goes on.
        """
        started = time.process_time()
        asked = self.horizon(time_s, state)
        start = None
        if self.warm and last is not None and not last.carried_on:
            start = carried(last.plan, asked, time_s - last.time_s)
        solver: Final[Asked] = "native" if serves(asked) else "ipopt"
        plan = solve(asked, solver, self.limits, start)
        iterations, warm = plan.iterations, start is not None
        if not plan.converged and warm:
            plan, warm = solve(asked, solver, self.limits), False
            iterations += plan.iterations
        took_s = time.process_time() - started
        if plan.converged:
            return Replan(time_s, asked, state, plan, 0.0, False, warm, iterations, took_s)
        since_s = np.inf if last is None else last.since_s + time_s - last.time_s
        if last is None or since_s + self.period_s > last.plan.time_s[-1]:
            raise NotEstimable(
                "horizon-lost",
                f"No motion was found from where the centre of mass was at {time_s:.1f} s, and no plan goes on: "
                f"{plan.status}",
                [Fault(f"phases[{self.problem.sequence.phase_at(time_s)}]", plan.status)],
            )
        return Replan(time_s, last.problem, state, last.plan, since_s, True, warm, iterations, took_s)

    def horizon(self, time_s: float, state: State) -> CentroidalProblem:
        """The problem of the next ``horizon_s`` from a state."""
        problem, sequence = self.problem, self.problem.sequence
        end_s = self._end_s(time_s + self.horizon_s)
        ends = end_s > sequence.duration_s - SLIVER_S
        return replace(
            problem,
            sequence=window(sequence, time_s, end_s),
            com_start_m=state.com_m,
            start=Start(state.com_v_m_s, state.l_nms),
            com_end_m=problem.com_end_m if ends else self._goal_m(sequence.phase_at(end_s - SLIVER_S)),
            terminal=problem.terminal if ends else "capturable",
        )

    def _end_s(self, wanted_s: float) -> float:
        """The first moment from ``wanted_s`` on when a sole has been touching for a while; the end if there is none."""
        sequence = self.problem.sequence
        end_s = min(wanted_s, sequence.duration_s)
        while not self._soles(sequence.phase_at(end_s - SLIVER_S)):
            end_s = min(sequence.duration_s, float(sequence.ends_s[sequence.phase_at(end_s - SLIVER_S)]) + LANDING_S)
            if end_s >= sequence.duration_s:
                break
        return end_s

    def _soles(self, phase: int) -> dict[str, Contact]:
        contacts = self.problem.sequence.phases[phase].contacts
        return {name: c for name, c in contacts.items() if self.problem.effectors[name].kind == "surface"}

    def _goal_m(self, phase: int) -> Vector3:
        """Over all soles, each where it is or was last, as high as the whole motion ends above its own."""
        sequence, effectors = self.problem.sequence, self.problem.effectors
        final = standing_com_m(sequence.phases[-1].contacts, 0.0, effectors)
        height_m = float(self.problem.com_end_m[2] - final[2])
        soles = {
            name: contact
            for name in sequence.effectors
            if effectors[name].kind == "surface" and (contact := sequence.last_contact(name, phase)) is not None
        }
        return standing_com_m(soles, height_m, effectors)


def window(sequence: ContactSequence, start_s: float, end_s: float) -> ContactSequence:
    """The part of a sequence between two times, its first and last phases cut."""
    phases = []
    for begin, end, phase in zip(sequence.starts_s, sequence.ends_s, sequence.phases, strict=True):
        length_s = float(min(end, end_s) - max(begin, start_s))
        if length_s > SLIVER_S:
            phases.append(ContactPhase(length_s, phase.contacts))
    return replace(sequence, phases=tuple(phases), start_com_height_m=None)
