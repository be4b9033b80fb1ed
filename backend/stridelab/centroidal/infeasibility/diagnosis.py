"""Why a motion could not be planned, in the terms of whoever asked for it: phases, effectors, newtons, metres, seconds.

Three questions, each decided by linear programmes (``relaxed``), the first that is answered no names the trouble:

    held        is there any motion at all, somersaults included?      cones that lack newtons, the end that is missed
    bearable    one within reach, that hardly spins and does not jump? cones, metres out of reach, angular momentum
    usual       does the plan keep the CoM where postures have it?     the share of postures that are as unusual

If all are answered yes, the solver has missed a motion that exists: it is stuck. Unless the control is the wrench,
whose own cone is narrower than that of the contacts: then (4.20) is solved with forces, and phases are named whose
wrenches that cone does not hold.

What would help is sought in the durations of the phases, then in the places of the contacts, then in their friction,
each changed as little as possible; only what a relaxed programme confirms is proposed. The search ends when its
processor time is up, with what was found until then.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stridelab.centroidal.infeasibility.body_limits import SPIN_M2_S
from stridelab.centroidal.infeasibility.elastic_lp import EndMiss, Relaxed, held, relax
from stridelab.centroidal.infeasibility.nearest_feasible import PENALTY, Nearest, coarse_grid, nearest
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.reach_box import usual_share
from stridelab.centroidal.solver import solve
from stridelab.contacts.sequence import ContactPhase

Verdict = Literal["impossible", "unbearable", "unusual", "narrow", "stuck", "found"]
Kind = Literal["cone", "reach", "load", "momentum", "end", "unusual", "wrench"]
UNUSUAL = 0.001
"""Share of an effector's postures below which a CoM is called unusual."""
SAID = 3
"""Findings that the sentence names, the worst of each kind first."""
FRICTIONS = 12
"""Halvings of the interval in which the least friction is sought."""
FRICTION_MOST = 1.2
SEARCH_S = 30.0
"""Processor time for the search of what would help, not counting the programme that is under way when it is up."""
REST_M = 0.005
"""A motion that ends nearer to the goal than this fails to come to rest there."""
CHANGE_S = 0.005
"""Changes of a phase that are shorter are not worth a word."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    ``value`` by its kind: a cone margin (N, negative), metres out of reach, the load of a hand (N), an angular momentum
    (Nms), metres from the goal, the share of postures that are as unusual, how many times as far out a wrench lies as
    the control's own cone reaches.
    """

    kind: Kind
    value: float
    phase: int | None = None
    effector: str | None = None

    @property
    def says(self) -> str:
        """A sentence without its place."""
        x = abs(self.value)
        far = f"the motion ends {x:.2f} m from the goal" if x > REST_M else "the motion does not come to rest"
        rare = f"only {100.0 * x:.2f} % of its postures are" if x else "none of its postures is"
        return {
            "cone": f"the friction cone lacks {x:.0f} N at every contact point",
            "reach": f"the centre of mass has to be {x:.2f} m out of its reach",
            "load": f"it has to carry {x:.0f} N",
            "momentum": f"the body has to spin with {x:.0f} Nms",
            "end": far,
            "unusual": f"{rare} as unusual as the planned one",
            "wrench": f"the wrench of a motion by forces lies {x:.1f} times as far out as the control's cone reaches",
        }[self.kind]

    @property
    def where(self) -> str:
        """The place in the scenario."""
        phase = "goal" if self.phase is None else f"phases[{self.phase}]"
        return phase if self.effector is None else f"{phase}.{self.effector}"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """``verdict`` and what it rests on; of the proposals at most one is there.

    ``cut_short``: the search for one came to the end of its time.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    durations: Nearest | None = None
    placements: Nearest | None = None
    friction: float | None = None
    cut_short: bool = False

    @property
    def sentence(self) -> str:
        """For a message: what is wrong, and what would help."""
        begin = {
            "impossible": "No motion over these contacts exists",
            "unbearable": "No motion over these contacts is one that a body can follow",
            "unusual": "The plan asks for what the robot's postures hardly allow",
            "narrow": "There is a motion over these contacts by forces, but the cone of the control is narrower",
            "stuck": "There are motions over these contacts, but the solver found none",
            "found": "The plan keeps to all limits",
        }[self.verdict]
        told = "; ".join(f"{f.where}: {f.says}" for f in self.findings[:SAID])
        return f"{begin}{': ' + told if told else ''}.{self._help}"

    @property
    def _help(self) -> str:
        if self.durations is not None:
            longer = [(i, s) for i, s in enumerate(self.durations.longer_s.tolist()) if abs(s) > CHANGE_S]
            changes = ", ".join(f"phase {i} {abs(s):.2f} s {'longer' if s > 0 else 'shorter'}" for i, s in longer)
            return f" It would do to make {changes}."
        if self.placements is not None:
            moves = ", ".join(
                f"{name} from phase {i} by ({x:.3f}, {y:.3f}, {z:.3f}) m"
                for (i, name), (x, y, z) in self.placements.shifts_m.items()
            )
            return f" It would do to move {moves}."
        if self.friction is not None:
            return f" It would do to have a friction of {self.friction:.2f} everywhere."
        return " The search for what would help was ended before it found anything." if self.cut_short else ""


def diagnose(problem: CentroidalProblem, plan: CentroidalPlan | None = None, search_s: float = SEARCH_S) -> Diagnosis:
    """What stands in the way of ``problem``; with its plan, whose failure is to be explained or whose CoM to be judged.

    Takes up to some tens of solutions of linear programmes, of which those that seek help stop after ``search_s``
    seconds of processor time: about 50 s were seen for half a minute of motion.
    """
    solved = plan is not None and plan.converged
    if not solved and not held(problem):
        return _with_help(problem, Diagnosis("impossible", tuple(_impossible(problem))), search_s)
    odd = () if plan is None else (*_spins(problem, plan), *_unusual(problem, plan))
    if not solved or odd:
        bearable = relax(problem, PENALTY, PENALTY, PENALTY, coarse_grid(problem))
        if bearable is not None and not bearable.held:
            return _with_help(problem, Diagnosis("unbearable", (*_gave_way(bearable), *odd)), search_s)
    if solved:
        return Diagnosis("unusual" if odd else "found", odd)
    narrow = _narrow(problem)
    return Diagnosis("narrow", (*narrow, *odd)) if narrow else Diagnosis("stuck", odd)


def _narrow(problem: CentroidalProblem) -> tuple[Finding, ...]:
    """Phases in which a motion by forces leaves the cone of the control, the farthest out first."""
    if problem.control.has_point_forces:
        return ()
    by_forces = solve(replace(problem, control=PYRAMIDS), "ipopt")
    if not by_forces.converged:
        return ()
    found = []
    for i in range(len(problem.sequence.phases)):
        touches = problem.touches(i, problem.com_start_m)
        wrenches = np.zeros((int((by_forces.phase == i).sum()), 6))
        for touch in touches:
            f = by_forces.forces_n[touch.effector][by_forces.phase == i] / problem.weight_n
            wrenches += np.hstack([f.sum(axis=1), np.cross(touch.points_m, f).sum(axis=1)])
        out = float(problem.control.gauge(touches, wrenches).max())
        if out > 1.0:
            found.append(Finding("wrench", out, i))
    return tuple(sorted(found, key=lambda f: -f.value))


def _impossible(problem: CentroidalProblem) -> Iterable[Finding]:
    sticking, missing = relax(problem, cones=1.0), relax(problem, end=1.0)
    if sticking is not None:
        yield from _gave_way(sticking)
    if missing is not None:
        yield from _missed(missing.miss)


def _missed(miss: EndMiss) -> list[Finding]:
    return [] if miss.met else [Finding("end", float(np.linalg.norm(miss.com_m)))]


def _gave_way(found: Relaxed) -> list[Finding]:
    """Every kind's worst first."""
    cones = [Finding("cone", margin, *at) for at, margin in found.margins_n.items() if margin]
    reach = [Finding("reach", metres, *at) for at, metres in found.beyond_m.items() if metres]
    loads = [Finding("load", newtons, *at) for at, newtons in found.loads_n.items() if newtons]
    spins = [Finding("momentum", nms, i) for i, nms in found.spins_nms.items() if nms]
    kinds = [sorted(kind, key=lambda f: -abs(f.value)) for kind in (cones, reach, loads, spins, _missed(found.miss))]
    firsts = [kind[0] for kind in kinds if kind]
    return firsts + [f for kind in kinds for f in kind[1:]]


def _unusual(problem: CentroidalProblem, plan: CentroidalPlan) -> list[Finding]:
    found = []
    for i, phase in enumerate(problem.sequence.phases):
        intervals = np.flatnonzero(plan.phase == i)
        com_m = plan.com_m[intervals[0] : intervals[-1] + 2]
        for name, contact in phase.contacts.items():
            if name in problem.proxies:
                proxy = problem.proxies[name]
                frame = proxy.placement(contact.placement, float(problem.sequence.headings_rad[i]))
                share = float(usual_share(proxy.mixture, frame.inverse().act(com_m)).min())
                if share < UNUSUAL:
                    found.append(Finding("unusual", share, i, name))
    return sorted(found, key=lambda f: f.value)


def _spins(problem: CentroidalProblem, plan: CentroidalPlan) -> list[Finding]:
    most = [float(np.abs(plan.l_nms[:-1][plan.phase == i]).max()) for i in range(len(problem.sequence.phases))]
    limit_nms = SPIN_M2_S * problem.mass_kg
    return sorted(
        (Finding("momentum", nms, i) for i, nms in enumerate(most) if nms > limit_nms), key=lambda f: -f.value
    )


def _with_help(problem: CentroidalProblem, diagnosis: Diagnosis, search_s: float) -> Diagnosis:
    until_s = time.process_time() + search_s
    longer = nearest(problem, "durations", until_s)
    if longer is not None and longer.held:
        return replace(diagnosis, durations=longer)
    nearer = nearest(problem, "placements", until_s)
    if nearer is not None and nearer.held:
        return replace(diagnosis, placements=nearer)
    friction = _least_friction(problem, until_s)
    return replace(diagnosis, friction=friction, cut_short=friction is None and time.process_time() > until_s)


def _least_friction(problem: CentroidalProblem, until_s: float) -> float | None:
    """The least friction, the same on every surface that has less, with which there is a bearable motion.

    A greater one, for which that is confirmed as well, where time is up before.
    """
    if time.process_time() > until_s or not _bearable(problem, FRICTION_MOST):
        return None
    low, high = 0.0, FRICTION_MOST
    for _ in range(FRICTIONS):
        if time.process_time() > until_s:
            break
        middle = (low + high) / 2.0
        low, high = (low, middle) if _bearable(problem, middle) else (middle, high)
    return high


def _bearable(problem: CentroidalProblem, friction: float) -> bool:
    phases = tuple(
        ContactPhase(
            phase.duration_s,
            {name: replace(c, friction=max(c.friction, friction)) for name, c in phase.contacts.items()},
        )
        for phase in problem.sequence.phases
    )
    rough = replace(problem, sequence=replace(problem.sequence, phases=phases))
    found = relax(rough, PENALTY, PENALTY, PENALTY, coarse_grid(rough))
    return found is not None and found.held
