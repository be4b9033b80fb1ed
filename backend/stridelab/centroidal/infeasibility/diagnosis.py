"""Diagnosis of a failed plan in terms of the scenario: phases, effectors, newtons, metres, seconds.

Three tests by linear programs (``elastic_lp``); the first that fails gives the verdict:

    feasible    does any motion exist, somersaults included?             cone violations (N), end miss
    bearable    one within reach, with little spin and without jumping?  cones, metres out of reach, angular momentum
    usual       is the CoM where the robot's postures have it?           the share of postures that are as unusual

If all pass, a motion exists that the solver did not find: it is stuck. If the control is the wrench, whose own cone is
narrower than that of the contacts, (4.20) is solved with point forces, and the phases whose wrenches lie outside that
cone are reported.

A remedy is searched in the durations of the phases, then in the placements of the contacts, then in their friction,
each with the smallest change; only what an elastic program confirms is proposed. The search ends with its processor
time and returns the best result so far.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stridelab.centroidal.infeasibility.body_limits import MAX_SPIN_M2_S
from stridelab.centroidal.infeasibility.elastic_lp import ElasticSolution, EndMiss, is_feasible, solve_elastic
from stridelab.centroidal.infeasibility.nearest_feasible import PENALTY, NearestFeasible, coarse_grid, nearest_feasible
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.reach_box import usual_share
from stridelab.centroidal.solver import solve

Verdict = Literal["impossible", "unbearable", "unusual", "narrow", "stuck", "found"]
Kind = Literal["cone", "reach", "load", "momentum", "end", "unusual", "wrench"]
UNUSUAL_SHARE = 0.001
"""Share of an effector's postures below which a CoM is called unusual."""
N_REPORTED_FINDINGS = 3
"""Number of findings in the message, the worst of each kind first."""
FRICTION_BISECTIONS = 12
"""Bisection steps of the search for the least friction."""
MAX_FRICTION = 1.2
SEARCH_S = 30.0
"""Processor time for the search of a remedy; a program that is running at the limit is completed."""
END_TOLERANCE_M = 0.005
"""End position errors below this are reported as a motion that does not come to rest."""
MIN_REPORTED_CHANGE_S = 0.005
"""Smallest change of a phase's duration that the message names."""


@dataclass(frozen=True)
class Finding:
    """One violated limit.

    ``value`` by ``kind``: a cone margin (N, negative), metres out of reach, the load of a hand (N), an angular momentum
    (Nms), metres from the goal, the share of postures that are as unusual, the gauge of a wrench in the control's cone.
    """

    kind: Kind
    value: float
    phase: int | None = None
    effector: str | None = None

    @property
    def description(self) -> str:
        """Description of the violation, without its location."""
        x = abs(self.value)
        far = f"the motion ends {x:.2f} m from the goal" if x > END_TOLERANCE_M else "the motion does not come to rest"
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
    def location(self) -> str:
        """Location in the scenario."""
        phase = "goal" if self.phase is None else f"phases[{self.phase}]"
        return phase if self.effector is None else f"{phase}.{self.effector}"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """``verdict``, the findings behind it, and at most one remedy: durations, placements or friction.

    ``cut_short``: the search for a remedy ran out of time.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    durations: NearestFeasible | None = None
    placements: NearestFeasible | None = None
    friction: float | None = None
    cut_short: bool = False

    @property
    def sentence(self) -> str:
        """Message: the violated limits and the remedy."""
        summary = {
            "impossible": "No motion over these contacts exists",
            "unbearable": "No motion over these contacts is one that a body can follow",
            "unusual": "The plan needs positions that the robot's postures hardly allow",
            "narrow": "There is a motion over these contacts by forces, but the cone of the control is narrower",
            "stuck": "There are motions over these contacts, but the solver did not find one",
            "found": "The plan respects all limits",
        }[self.verdict]
        details = "; ".join(f"{f.location}: {f.description}" for f in self.findings[:N_REPORTED_FINDINGS])
        return f"{summary}{': ' + details if details else ''}.{self._remedy}"

    @property
    def _remedy(self) -> str:
        if self.durations is not None:
            longer = [(i, s) for i, s in enumerate(self.durations.longer_s.tolist()) if abs(s) > MIN_REPORTED_CHANGE_S]
            changes = ", ".join(f"phase {i} {abs(s):.2f} s {'longer' if s > 0 else 'shorter'}" for i, s in longer)
            return f" A possible remedy: make {changes}."
        if self.placements is not None:
            moves = ", ".join(
                f"{name} from phase {i} by ({x:.3f}, {y:.3f}, {z:.3f}) m"
                for (i, name), (x, y, z) in self.placements.shifts_m.items()
            )
            return f" A possible remedy: move {moves}."
        if self.friction is not None:
            return f" A possible remedy: a friction of {self.friction:.2f} everywhere."
        return " The search for a remedy reached its time limit without a result." if self.cut_short else ""


def diagnose(problem: CentroidalProblem, plan: CentroidalPlan | None = None, search_s: float = SEARCH_S) -> Diagnosis:
    """Explain why ``problem`` has no plan, or check the CoM of the given plan.

    Solves up to some tens of linear programs; the search for a remedy stops after ``search_s`` seconds of processor
    time. About 50 s in total were measured for half a minute of motion.
    """
    solved = plan is not None and plan.converged
    if not solved and not is_feasible(problem):
        return _with_remedy(problem, Diagnosis("impossible", tuple(_infeasibility_findings(problem))), search_s)
    odd = () if plan is None else (*_momentum_findings(problem, plan), *_unusual_posture_findings(problem, plan))
    if not solved or odd:
        bearable = solve_elastic(problem, PENALTY, PENALTY, PENALTY, coarse_grid(problem))
        if bearable is not None and not bearable.is_feasible:
            return _with_remedy(problem, Diagnosis("unbearable", (*_relaxation_findings(bearable), *odd)), search_s)
    if solved:
        return Diagnosis("unusual" if odd else "found", odd)
    narrow = _control_cone_findings(problem)
    return Diagnosis("narrow", (*narrow, *odd)) if narrow else Diagnosis("stuck", odd)


def _control_cone_findings(problem: CentroidalProblem) -> tuple[Finding, ...]:
    """Phases in which a motion by point forces leaves the cone of the control, largest gauge first."""
    if problem.control.has_point_forces:
        return ()
    by_forces = solve(replace(problem, control=PYRAMIDS), "ipopt")
    if not by_forces.converged:
        return ()
    findings = []
    for i in range(len(problem.sequence.phases)):
        patches = problem.contact_patches(i, problem.com_start_m)
        wrenches = np.zeros((int((by_forces.phase == i).sum()), 6))
        for patch in patches:
            f = by_forces.forces_n[patch.effector][by_forces.phase == i] / problem.weight_n
            wrenches += np.hstack([f.sum(axis=1), np.cross(patch.points_m, f).sum(axis=1)])
        gauge = float(problem.control.gauge(patches, wrenches).max())
        if gauge > 1.0:
            findings.append(Finding("wrench", gauge, i))
    return tuple(sorted(findings, key=lambda f: -f.value))


def _infeasibility_findings(problem: CentroidalProblem) -> Iterable[Finding]:
    sticking, missing = solve_elastic(problem, cones=1.0), solve_elastic(problem, end=1.0)
    if sticking is not None:
        yield from _relaxation_findings(sticking)
    if missing is not None:
        yield from _end_findings(missing.miss)


def _end_findings(miss: EndMiss) -> list[Finding]:
    return [] if miss.is_met else [Finding("end", float(np.linalg.norm(miss.com_m)))]


def _relaxation_findings(solution: ElasticSolution) -> list[Finding]:
    """Findings of an elastic solution; the worst of each kind comes first."""
    cones = [Finding("cone", margin, *at) for at, margin in solution.margins_n.items() if margin]
    reach = [Finding("reach", metres, *at) for at, metres in solution.beyond_m.items() if metres]
    loads = [Finding("load", newtons, *at) for at, newtons in solution.loads_n.items() if newtons]
    spins = [Finding("momentum", nms, i) for i, nms in solution.spins_nms.items() if nms]
    kinds = [
        sorted(kind, key=lambda f: -abs(f.value)) for kind in (cones, reach, loads, spins, _end_findings(solution.miss))
    ]
    firsts = [kind[0] for kind in kinds if kind]
    return firsts + [f for kind in kinds for f in kind[1:]]


def _unusual_posture_findings(problem: CentroidalProblem, plan: CentroidalPlan) -> list[Finding]:
    findings = []
    for i, phase in enumerate(problem.sequence.phases):
        intervals = np.flatnonzero(plan.phase == i)
        com_m = plan.com_m[intervals[0] : intervals[-1] + 2]
        for name, contact in phase.contacts.items():
            if name in problem.proxies:
                proxy = problem.proxies[name]
                frame = proxy.frame_placement(contact.placement, float(problem.sequence.headings_rad[i]))
                share = float(usual_share(proxy.mixture, frame.inverse().act(com_m)).min())
                if share < UNUSUAL_SHARE:
                    findings.append(Finding("unusual", share, i, name))
    return sorted(findings, key=lambda f: f.value)


def _momentum_findings(problem: CentroidalProblem, plan: CentroidalPlan) -> list[Finding]:
    peaks_nms = [float(np.abs(plan.l_nms[:-1][plan.phase == i]).max()) for i in range(len(problem.sequence.phases))]
    limit_nms = MAX_SPIN_M2_S * problem.mass_kg
    return sorted(
        (Finding("momentum", nms, i) for i, nms in enumerate(peaks_nms) if nms > limit_nms), key=lambda f: -f.value
    )


def _with_remedy(problem: CentroidalProblem, diagnosis: Diagnosis, search_s: float) -> Diagnosis:
    until_s = time.process_time() + search_s
    longer = nearest_feasible(problem, "durations", until_s)
    if longer is not None and longer.is_feasible:
        return replace(diagnosis, durations=longer)
    nearer = nearest_feasible(problem, "placements", until_s)
    if nearer is not None and nearer.is_feasible:
        return replace(diagnosis, placements=nearer)
    friction = _least_friction(problem, until_s)
    return replace(diagnosis, friction=friction, cut_short=friction is None and time.process_time() > until_s)


def _least_friction(problem: CentroidalProblem, until_s: float) -> float | None:
    """The least friction, applied to every surface that has less, for which a bearable motion exists.

    Returns the smallest confirmed value so far when time runs out.
    """
    if time.process_time() > until_s or not _is_bearable_with_friction(problem, MAX_FRICTION):
        return None
    low, high = 0.0, MAX_FRICTION
    for _ in range(FRICTION_BISECTIONS):
        if time.process_time() > until_s:
            break
        middle = (low + high) / 2.0
        low, high = (low, middle) if _is_bearable_with_friction(problem, middle) else (middle, high)
    return high


def _is_bearable_with_friction(problem: CentroidalProblem, friction: float) -> bool:
    sequence = problem.sequence.map_contacts(lambda _, c: replace(c, friction=max(c.friction, friction)))
    rough = replace(problem, sequence=sequence)
    solution = solve_elastic(rough, PENALTY, PENALTY, PENALTY, coarse_grid(rough))
    return solution is not None and solution.is_feasible
