"""The constraints of (4.20) alone, relaxed until they have a solution: linear programmes.

In the variables of ``dynamics`` the constraints of u_f are linear, so that what a solver failed at can be decided. They
allow motions that no body follows, somersaults of many metres among them: what cost and densities keep from happening
in (4.20) enters as a box about every contact (``reach_box``) and as a bound on the angular momentum. All can give way,
each at its price:

    min   p_s sum T s  +  p_b sum T (r + q + l)  +  p_e |e|_1
    s.t.  A w = b,  + e in the rows of the end
          lambda >= -s                             a contact sticks to its surface, alike throughout a phase
          low - r <= R^T (c - p) <= high + r       the CoM is out of an effector's reach, likewise
          |L_c| / m <= SPIN + l                    the body spins, likewise
          |F_z - 1| <= PUSH                        nobody jumps while a sole touches,
          f_n <= GRIP + q at points                and nobody vaults on a hand
          s, r, q, l >= 0

An infinite price makes a constraint hard; what asks of the body at no price is left out. A sum of absolute values is
met with few of them, so that the answer names few phases. With n rays per point, ``lambda >= -s`` moves the point's
pyramid down by ``n s``: its margin, as ``contacts.wrench_margin`` has it, is ``-mu cos(pi / n) n s``.

``L_c = K - m c x c'`` is not linear; it is taken at the last of a few solutions, ``c x c'`` by its tangent. Of all
cheapest motions the one with the least ``int |F - (0, 0, 1)|_1`` is sought, by a price too small to matter, so that
solutions and tangents settle.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.optimize import linprog

from stridelab.centroidal.blocks import Blocks
from stridelab.centroidal.dynamics import DOWN, N_STATE, skew, step
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.centroidal.reach_box import reach_box
from stridelab.contacts.point_contacts import PointContacts
from stridelab.conventions import GRAVITY_M_S2, Vector3

HARD = float("inf")
"""Price of what must hold."""
ENOUGH = 1e-6
"""Share of the weight, and metres, below which nothing was given way."""
MET = 1e-5
"""The largest miss (m, m/s, m/s^2, Nms) of an end that is met."""
SPIN_M2_S = 0.15
"""Angular momentum per mass that arms and trunk can take up for a while: 14 Nms for TALOS, who needs 6 to stride."""
PUSH = 0.25
"""Share of the weight by which soles push more or less than it."""
GRIP = 0.3
"""Share of the weight that a point effector carries at most, three times what the arm of TALOS bears."""
EFFORT = 1e-2
"""Price of push, per weight and second, of which the other prices should be many times as large."""
TANGENTS = 3
"""Solutions after which the tangent of ``c x c'`` is taken for good."""
N_RAYS = 8
"""Rays of the pyramid inside each friction cone."""
N_END = 3 + N_STATE
"""Rows of the end: no acceleration; at the goal, at rest, without angular momentum."""

SETTLED = 1e-2
"""A tangent that moved less than this (m, m/s) is the last."""

Vector = Float[np.ndarray, "_"]
States = Float[np.ndarray, "_ 9"]
Where = tuple[int, str]
"""A contact: its phase and its effector."""


@dataclass(frozen=True, eq=False)
class EndMiss:
    """By how much a motion misses the end: CoM, its velocity and acceleration, angular momentum about it."""

    com_m: Vector3
    velocity_m_s: Vector3
    acceleration_m_s2: Vector3
    momentum_nms: Vector3

    @property
    def met(self) -> bool:
        """Whether the end is reached."""
        parts = (self.com_m, self.velocity_m_s, self.acceleration_m_s2, self.momentum_nms)
        return bool(max(np.abs(part).max() for part in parts) < MET)


@dataclass(frozen=True, eq=False)
class Rows:
    """``A w = b``, ``w >= lower``: states ``(n + 1, 9)`` first, then the ray lengths of every interval and contact.

    ``first[k, effector]`` is where those of interval ``k`` begin; positions are relative to the CoM at the start. The
    last ``N_END`` rows are the end, the ``N_STATE`` before them the start.
    """

    grid: Grid
    wrenches: Mapping[Where, Float[np.ndarray, "6 _"]]
    first: Mapping[Where, int]
    A: sp.csc_matrix
    b: Vector
    lower: Vector


@dataclass(frozen=True, eq=False)
class Relaxed:
    """What gave way: ``margins_n`` of cones (negative), ``beyond_m`` of reach; else zero.

    ``loads_n`` are what hands carry that should not carry so much, ``spins_nms`` the momenta of phases that spin.

    ``w`` are the variables of ``rows``, ``sticks`` the ray lengths s, ``price`` the value of the programme.
    """

    w: Vector
    sticks: Mapping[Where, float]
    margins_n: Mapping[Where, float]
    beyond_m: Mapping[Where, float]
    loads_n: Mapping[Where, float]
    spins_nms: Mapping[int, float]
    miss: EndMiss
    price: float

    @property
    def held(self) -> bool:
        """Whether nothing had to give way."""
        gave = (*self.margins_n.values(), *self.beyond_m.values(), *self.loads_n.values(), *self.spins_nms.values())
        return not any(gave) and self.miss.met


def relax(
    problem: CentroidalProblem, cones: float = HARD, body: float = 0.0, end: float = HARD, grid: Grid | None = None
) -> Relaxed | None:
    """The cheapest way to a solution at these prices; None where what is hard has none.

    Prices are per weight and second, per metre (m^2/s) and second, and per metre (metre per second, ...) of the end.
    """
    programme = rows(problem, problem.grid() if grid is None else grid)
    m, n = programme.A.shape
    where, sticks, seconds = sticking(programme, problem)
    lasts = np.array([phase.duration_s for phase in problem.sequence.phases])
    sizes = (len(where), len(where), len(where), len(lasts), 2 * N_END)
    cut = np.cumsum(sizes)[:-1]
    miss = missing(m)
    prices = (cones, body, body, body, end)
    cost = np.concatenate(
        [_priced(p) * T for p, T in zip(prices, (seconds, seconds, seconds, lasts, np.ones(2 * N_END)), strict=True)]
    )
    most = np.concatenate([np.full(size, _most(p)) for p, size in zip(prices, sizes, strict=True)])
    unasked = sp.csc_matrix((m, 2 * len(where) + len(lasts)))
    effort, aims = pushes(programme, problem) if body else (sp.csc_matrix((0, n + sizes[0])), np.zeros(0))
    columns = sp.bmat(
        [
            [sp.hstack([programme.A, sticks, unasked, miss, -miss]), None],
            [
                sp.hstack([effort, sp.csc_matrix((len(aims), sum(sizes[1:])))]),
                sp.hstack([-sp.identity(len(aims)), sp.identity(len(aims))]),
            ],
        ],
        format="csc",
    )
    bounds = np.column_stack(
        [
            np.concatenate([programme.lower, np.zeros(len(most) + 2 * len(aims))]),
            np.concatenate([np.full(n, np.inf), most, np.full(2 * len(aims), np.inf)]),
        ]
    )
    efforts = EFFORT * np.repeat(programme.grid.step_s, 3)[: len(aims)]
    x, about = None, straight(programme, problem)
    for _ in range(TANGENTS if body else 1):
        G, room = bodily(programme, problem, about) if body else (sp.csc_matrix((0, n + int(cut[-1]))), np.zeros(0))
        unbounded = sp.csc_matrix((len(room), 2 * N_END + 2 * len(aims)))
        found = least(
            np.concatenate([np.zeros(n), cost, efforts, efforts]),
            (columns, np.append(programme.b, aims)),
            (sp.hstack([G, unbounded], format="csc"), room),
            bounds,
        )
        if found is None:
            return None
        x, before = found[: n + len(cost)], about
        about = x[: N_STATE * (len(programme.grid.step_s) + 1)].reshape(-1, N_STATE)
        if np.abs(about[:, :6] - before[:, :6]).max() < SETTLED:
            break
    assert x is not None
    s, r, q, l, e = np.split(x[n:], cut)
    face = N_RAYS * np.cos(np.pi / N_RAYS) * problem.weight_n
    return Relaxed(
        x[:n],
        dict(zip(where, s.tolist(), strict=True)),
        {at: -face * problem.contact(at[1], at[0]).friction * y for at, y in zip(where, _given(s), strict=True)},
        dict(zip(where, _given(r), strict=True)),
        {at: problem.weight_n * (GRIP + y) if y else 0.0 for at, y in zip(where, _given(q), strict=True)},
        {i: problem.mass_kg * (SPIN_M2_S + y) if y else 0.0 for i, y in enumerate(_given(l))},
        _missed(problem, e[N_END:] - e[:N_END]),
        float(cost @ x[n:]),
    )


def held(problem: CentroidalProblem) -> bool:
    """Whether the constraints have a solution at all, wherever it takes the CoM.

    Told by what must give way for one rather than by the words of a solver, which are a matter of tolerances.
    """
    found = relax(problem, cones=1.0)
    return found is not None and found.held


def least(
    cost: Vector,
    equal: tuple[sp.csc_matrix, Vector],
    below: tuple[sp.csc_matrix, Vector],
    bounds: Float[np.ndarray, "_ 2"],
) -> Vector | None:
    """``min cost x`` with rows that equal and rows that stay below; None where there is no solution.

    The simplex method of HiGHS gives up on a few of these programmes; its interior points then answer.
    """
    for method in ("highs-ds", "highs-ipm"):
        found = linprog(cost, A_eq=equal[0], b_eq=equal[1], A_ub=below[0], b_ub=below[1], bounds=bounds, method=method)
        if found.x is not None:
            return np.asarray(found.x)
        if found.status in (2, 3):
            return None
    return None


def rows(problem: CentroidalProblem, grid: Grid) -> Rows:
    """The constraints on a grid."""
    phases, last = problem.sequence.phases, len(grid.step_s) - 1
    wrenches = {(i, name): ray_wrenches(problem, i, name) for i, phase in enumerate(phases) for name in phase.contacts}
    n, first = N_STATE * (last + 2), dict[Where, int]()
    for k, i in enumerate(grid.phase.tolist()):
        for name in phases[i].contacts:
            first[k, name] = n
            n += wrenches[i, name].shape[1]
    A, b = Blocks(), []
    for k, h in enumerate(grid.step_s):
        s, i, row = step(float(h)), int(grid.phase[k]), N_STATE * k
        A.add(row, N_STATE * (k + 1), np.eye(N_STATE))
        A.add(row, N_STATE * k, -s.A)
        b.append(s.b)
        for name in phases[i].contacts:
            A.add(row, first[k, name], -s.B @ wrenches[i, name])
    start = N_STATE * (last + 1)
    A.add(start, 0, np.eye(N_STATE))
    end = start + N_STATE
    for name in phases[-1].contacts:
        A.add(end, first[last, name], wrenches[len(phases) - 1, name][:3])
    A.add(end + 3, N_STATE * (last + 1), np.eye(N_STATE))
    goal = np.concatenate([problem.com_end_m - problem.com_start_m, np.zeros(6)])
    b += [np.zeros(N_STATE), -DOWN, goal]
    lower = np.full(n, -np.inf)
    lower[N_STATE * (last + 2) :] = 0.0
    return Rows(grid, wrenches, first, A.matrix(end + N_END, n), np.concatenate(b), lower)


def ray_wrenches(problem: CentroidalProblem, phase: int, effector: str) -> Float[np.ndarray, "6 m"]:
    """``(F, T)`` about the CoM at the start per unit length of every ray of a contact, point by point."""
    contact = problem.contact(effector, phase)
    points_m = contact.placement.act(problem.points_m(effector)) - problem.com_start_m
    n = len(points_m)
    same = np.broadcast_to(contact.placement.rotation, (n, 3, 3))
    return PointContacts(points_m, same, np.full(n, contact.friction)).rays(N_RAYS).T


def sticking(programme: Rows, problem: CentroidalProblem) -> tuple[list[Where], sp.csc_matrix, Vector]:
    """All contacts, the columns of their ``s`` in ``A``, and the seconds for which each may stick."""
    where = [(i, name) for i, phase in enumerate(problem.sequence.phases) for name in phase.contacts]
    columns, seconds, last = Blocks(), np.zeros(len(where)), len(programme.grid.step_s) - 1
    for j, (i, name) in enumerate(where):
        pull = programme.wrenches[i, name].sum(axis=1)[:, None]
        for k in np.flatnonzero(programme.grid.phase == i):
            h = float(programme.grid.step_s[k])
            seconds[j] += h
            columns.add(N_STATE * int(k), j, step(h).B @ pull)
            if k == last:
                columns.add(N_STATE * (last + 2), j, -pull[:3])
    return where, columns.matrix(len(programme.b), len(where)), seconds


def missing(n_rows: int) -> sp.csc_matrix:
    """Columns of ``e`` in ``A``."""
    return sp.vstack([sp.csc_matrix((n_rows - N_END, N_END)), sp.identity(N_END)], format="csc")


def straight(programme: Rows, problem: CentroidalProblem) -> States:
    """States at rest on a straight line to the goal: the first ones at which tangents are taken."""
    share = programme.grid.time_s / programme.grid.time_s[-1]
    return np.hstack([np.outer(share, problem.com_end_m - problem.com_start_m), np.zeros((len(share), 6))])


def bodily(programme: Rows, problem: CentroidalProblem, about: States) -> tuple[sp.csc_matrix, Vector]:
    """``G (w, s, r, q, l) <= h``: the boxes of all effectors that have a density at every node; spins; pushes; grips.

    ``about`` are the states at which the tangent of ``c x c'`` is taken.
    """
    n, phases = len(programme.lower), problem.sequence.phases
    where = [(i, name) for i, phase in enumerate(phases) for name in phase.contacts]
    boxes = {name: reach_box(proxy.mixture) for name, proxy in problem.proxies.items()}
    G, h, row = Blocks(), list[Vector](), 0
    for j, (i, name) in enumerate(where):
        if name not in boxes:
            continue
        contact, heading_rad = problem.contact(name, i), float(problem.sequence.headings_rad[i])
        frame = problem.proxies[name].placement(contact.placement, heading_rad)
        at = frame.rotation.T @ (problem.com_start_m - frame.position_m)
        both = np.vstack([frame.rotation.T, -frame.rotation.T])
        room = np.concatenate([boxes[name].high_m - at, at - boxes[name].low_m])
        for k in _nodes(programme, i):
            G.add(row, N_STATE * k, both)
            G.add(row, n + len(where) + j, -np.ones((6, 1)))
            h.append(room)
            row += 6
    for i in range(len(phases)):
        for k in _nodes(programme, i):
            c, v = about[k, 0:3], about[k, 3:6]
            spin = np.hstack([skew(v), -skew(c), GRAVITY_M_S2 * np.eye(3)])  # of (c, c', K): K - c x v' - c' x v
            G.add(row, N_STATE * k, np.vstack([spin, -spin]))
            G.add(row, n + 3 * len(where) + i, -np.ones((6, 1)))
            fixed = np.cross(c, v)
            h.append(SPIN_M2_S - np.concatenate([fixed, -fixed]))
            row += 6
    limits = G.matrix(row, n + 3 * len(where) + len(phases))
    stand = [any(problem.effectors[name].kind == "surface" for name in phase.contacts) for phase in phases]
    vertical = pushes(programme, problem)[0][2::3][np.array(stand)[programme.grid.phase]]
    vertical = sp.hstack([vertical, sp.csc_matrix((vertical.shape[0], 2 * len(where) + len(phases)))])
    one, grips = np.ones(vertical.shape[0]), Blocks()
    held_on = [at for at in programme.first if problem.effectors[at[1]].kind == "point"]
    for k, at in enumerate(held_on):
        i = int(programme.grid.phase[at[0]])
        grips.add(k, programme.first[at], np.ones((1, programme.wrenches[i, at[1]].shape[1])))
        grips.add(k, n + 2 * len(where) + where.index((i, at[1])), -np.ones((1, 1)))
    h += [(1.0 + PUSH) * one, (PUSH - 1.0) * one, np.full(len(held_on), GRIP)]
    hands = grips.matrix(len(held_on), limits.shape[1])
    return sp.vstack([limits, vertical, -vertical, hands], format="csc"), np.concatenate(h)


def pushes(programme: Rows, problem: CentroidalProblem) -> tuple[sp.csc_matrix, Vector]:
    """``F`` of every interval as rows on ``(w, s)``, and the weight that it is compared with."""
    n, last = len(programme.lower), len(programme.grid.step_s) - 1
    where = [(i, name) for i, phase in enumerate(problem.sequence.phases) for name in phase.contacts]
    F, column = Blocks(), {at: n + j for j, at in enumerate(where)}
    for k, i in enumerate(programme.grid.phase.tolist()):
        for name in problem.sequence.phases[i].contacts:
            W = programme.wrenches[i, name][:3]
            F.add(3 * k, programme.first[k, name], W)
            F.add(3 * k, column[i, name], -W.sum(axis=1)[:, None])
    return F.matrix(3 * (last + 1), n + len(where)), np.tile(-DOWN, last + 1)


def _nodes(programme: Rows, phase: int) -> range:
    """Nodes of a phase, both ends included."""
    intervals = np.flatnonzero(programme.grid.phase == phase)
    return range(int(intervals[0]), int(intervals[-1]) + 2)


def _missed(problem: CentroidalProblem, e: Vector) -> EndMiss:
    com, velocity, K = e[3:6], e[6:9], e[9:12]
    about_it = np.cross(problem.com_end_m - problem.com_start_m + com, velocity)
    momentum = problem.weight_n * K - problem.mass_kg * about_it
    return EndMiss(com, velocity, e[0:3] * problem.weight_n / problem.mass_kg, momentum)


def _priced(price: float) -> float:
    return price if np.isfinite(price) else 0.0


def _most(price: float) -> float:
    return np.inf if np.isfinite(price) else 0.0


def _given(slacks: Vector) -> list[float]:
    return [float(x) if x > ENOUGH else 0.0 for x in slacks]
