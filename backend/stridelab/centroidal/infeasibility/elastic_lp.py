"""The constraints of (4.20) alone, relaxed until they have a solution: linear programmes.

In the variables of ``dynamics`` the constraints of u_f are linear, so that what a solver failed at can be decided. They
allow motions that no body follows, somersaults of many metres among them: what cost and densities keep from happening
in (4.20) enters as a box about every contact (``reach_box``) and as bounds that ``bodily`` explains. All can give way,
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
pyramid down by ``n s``: its margin, as ``contacts.wrench_cones.wrench_feasibility`` has it, is ``-mu cos(pi / n) n s``.

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

from stridelab.centroidal.dynamics import N_STATE
from stridelab.centroidal.infeasibility.body_limits import SPIN_M2_S, bodily, carries, pushes, straight
from stridelab.centroidal.infeasibility.lp_constraints import N_RAYS, Vector, Where, missing, rows, sticking
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.conventions import Vector3

HARD = float("inf")
"""Price of what must hold."""
ENOUGH = 1e-6
"""Share of the weight, and metres, below which nothing was given way."""
MET = 1e-5
"""The largest miss (m, m/s, m/s^2, Nms) of an end that is met."""
EFFORT = 1e-2
"""Price of push, per weight and second, of which the other prices should be many times as large."""
TANGENTS = 3
"""Solutions after which the tangent of ``c x c'`` is taken for good."""

SETTLED = 1e-2
"""A tangent that moved less than this (m, m/s) is the last."""


@dataclass(frozen=True, eq=False)
class EndMiss:
    """By how much a motion misses the end: CoM, its velocity and acceleration, angular momentum about it.

    Of a capturable end ``com_m`` holds how far the capture point is out of its hull, and the height.
    """

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
    n_end = programme.n_end
    sizes = (len(where), len(where), len(where), len(lasts), 2 * n_end)
    cut = np.cumsum(sizes)[:-1]
    miss = missing(programme)
    prices = (cones, body, body, body, end)
    cost = np.concatenate(
        [_priced(p) * T for p, T in zip(prices, (seconds, seconds, seconds, lasts, np.ones(2 * n_end)), strict=True)]
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
        unbounded = sp.csc_matrix((len(room), 2 * n_end + 2 * len(aims)))
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
        {
            at: problem.weight_n * (carries(problem, at[1]) + y) if y else 0.0
            for at, y in zip(where, _given(q), strict=True)
        },
        {i: problem.mass_kg * (SPIN_M2_S + y) if y else 0.0 for i, y in enumerate(_given(l))},
        _missed(problem, e[n_end:] - e[:n_end]),
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


def _missed(problem: CentroidalProblem, e: Vector) -> EndMiss:
    if problem.terminal == "capturable":
        beyond = np.array([np.abs(e[2:]).max(), 0.0, e[0]])
        return EndMiss(beyond, np.array([0.0, 0.0, e[1]]), np.zeros(3), np.zeros(3))
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
