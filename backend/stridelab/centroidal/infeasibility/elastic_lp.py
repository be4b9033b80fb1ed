"""Elastic relaxation of the constraints of (4.20) as a linear program.

In the variables of ``dynamics`` the constraints of u_f are linear, so that feasibility can be decided. They admit
motions that no body follows, such as somersaults of many metres; what cost and densities prevent in (4.20) enters as
a box about every contact (``reach_box``) and as the bounds of ``body_limits``. Each constraint has a slack at a price:

    min   p_s sum T s  +  p_b sum T (r + q + l)  +  p_e |e|_1
    s.t.  A w = b,  + e in the rows of the end
          lambda >= -s                             adhesion of a contact, constant over a phase
          low - r <= R^T (c - p) <= high + r       distance of the CoM out of an effector's reach, likewise
          |L_c| / m <= SPIN + l                    excess of angular momentum, likewise
          |F_z - 1| <= PUSH                        no jumping while a sole is in contact
          f_n <= GRIP + q at points                excess load of a hand
          s, r, q, l >= 0

An infinite price makes a constraint hard; body limits at price zero are left out. The L1 penalty gives sparse slacks,
so that few phases are reported. With n rays per point, ``lambda >= -s`` moves the point's pyramid down by ``n s``: its
margin, as defined in ``contacts.wrench_cones.wrench_feasibility``, is ``-mu cos(pi / n) n s``.

``L_c = K - m c x c'`` is not linear; ``c x c'`` is linearised at the previous of a few solutions. A negligible price
selects, among all cheapest motions, the one with the least ``int |F - (0, 0, 1)|_1``, so that the iteration converges.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.optimize import linprog

from stridelab.centroidal.contact_wrench import N_STATE
from stridelab.centroidal.infeasibility.body_limits import (
    MAX_SPIN_M2_S,
    body_limit_rows,
    contact_force_rows,
    max_load_share,
    straight_line_states,
)
from stridelab.centroidal.infeasibility.lp_constraints import (
    N_RAYS,
    Vector,
    Where,
    adhesion_columns,
    end_slack_columns,
    linear_constraints,
)
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.conventions import Vector3

HARD = float("inf")
"""Price of a hard constraint."""
SLACK_TOLERANCE = 1e-6
"""Slacks up to this (share of the weight, metres) count as zero."""
END_TOLERANCE = 1e-5
"""Largest end error (m, m/s, m/s^2, Nms) that counts as zero."""
EFFORT_PRICE = 1e-2
"""Price of force variation, per weight and second; the other prices should be many times larger."""
MAX_TANGENTS = 3
"""Maximum number of linearisations of ``c x c'``."""

TANGENT_TOLERANCE = 1e-2
"""Change of the states (m, m/s) below which the linearisation has converged."""


@dataclass(frozen=True, eq=False)
class EndMiss:
    """End error of a motion: CoM, its velocity and acceleration, angular momentum about it.

    For a capturable end ``com_m`` holds the distance of the capture point outside its hull, and the height error.
    """

    com_m: Vector3
    velocity_m_s: Vector3
    acceleration_m_s2: Vector3
    momentum_nms: Vector3

    @property
    def is_met(self) -> bool:
        """Whether the end is reached."""
        parts = (self.com_m, self.velocity_m_s, self.acceleration_m_s2, self.momentum_nms)
        return bool(max(np.abs(part).max() for part in parts) < END_TOLERANCE)


@dataclass(frozen=True, eq=False)
class ElasticSolution:
    """Solution of the elastic program; violations are zero where a limit holds.

    ``margins_n`` of cones (negative), ``beyond_m`` out of reach, ``loads_n`` of overloaded hands, ``spins_nms`` of
    phases with excessive angular momentum. ``w`` are the variables of ``LinearConstraints``, ``sticks`` the slacks s,
    ``price`` the optimal value.
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
    def is_feasible(self) -> bool:
        """Whether all slacks are zero and the end is met."""
        gave = (*self.margins_n.values(), *self.beyond_m.values(), *self.loads_n.values(), *self.spins_nms.values())
        return not any(gave) and self.miss.is_met


def solve_elastic(
    problem: CentroidalProblem, cones: float = HARD, body: float = 0.0, end: float = HARD, grid: Grid | None = None
) -> ElasticSolution | None:
    """Cheapest elastic solution at these prices; None if the hard constraints are infeasible.

    Prices are per weight and second (``cones``), per metre (m^2/s) and second (``body``), and per metre (m/s, ...) of
    the end error (``end``).
    """
    lp = linear_constraints(problem, problem.grid() if grid is None else grid)
    m, n = lp.A.shape
    contacts, sticks, seconds = adhesion_columns(lp, problem)
    durations_s = problem.sequence.durations_s
    n_end = lp.n_end
    sizes = (len(contacts), len(contacts), len(contacts), len(durations_s), 2 * n_end)
    splits = np.cumsum(sizes)[:-1]
    miss = end_slack_columns(lp)
    prices = (cones, body, body, body, end)
    cost = np.concatenate(
        [
            _finite_price(p) * T
            for p, T in zip(prices, (seconds, seconds, seconds, durations_s, np.ones(2 * n_end)), strict=True)
        ]
    )
    slack_bounds = np.concatenate([np.full(size, _slack_bound(p)) for p, size in zip(prices, sizes, strict=True)])
    no_columns = sp.csc_matrix((m, 2 * len(contacts) + len(durations_s)))
    effort, references = contact_force_rows(lp, problem) if body else (sp.csc_matrix((0, n + sizes[0])), np.zeros(0))
    columns = sp.bmat(
        [
            [sp.hstack([lp.A, sticks, no_columns, miss, -miss]), None],
            [
                sp.hstack([effort, sp.csc_matrix((len(references), sum(sizes[1:])))]),
                sp.hstack([-sp.identity(len(references)), sp.identity(len(references))]),
            ],
        ],
        format="csc",
    )
    bounds = np.column_stack(
        [
            np.concatenate([lp.lower, np.zeros(len(slack_bounds) + 2 * len(references))]),
            np.concatenate([np.full(n, np.inf), slack_bounds, np.full(2 * len(references), np.inf)]),
        ]
    )
    efforts = EFFORT_PRICE * np.repeat(lp.grid.step_s, 3)[: len(references)]
    x, about = None, straight_line_states(lp, problem)
    for _ in range(MAX_TANGENTS if body else 1):
        G, room = (
            body_limit_rows(lp, problem, about) if body else (sp.csc_matrix((0, n + int(splits[-1]))), np.zeros(0))
        )
        unbounded = sp.csc_matrix((len(room), 2 * n_end + 2 * len(references)))
        solution = minimise_linear(
            np.concatenate([np.zeros(n), cost, efforts, efforts]),
            (columns, np.append(lp.b, references)),
            (sp.hstack([G, unbounded], format="csc"), room),
            bounds,
        )
        if solution is None:
            return None
        x, previous = solution[: n + len(cost)], about
        about = x[: N_STATE * (len(lp.grid.step_s) + 1)].reshape(-1, N_STATE)
        if np.abs(about[:, :6] - previous[:, :6]).max() < TANGENT_TOLERANCE:
            break
    assert x is not None
    s, r, q, l, e = np.split(x[n:], splits)
    face = N_RAYS * np.cos(np.pi / N_RAYS) * problem.weight_n
    return ElasticSolution(
        x[:n],
        dict(zip(contacts, s.tolist(), strict=True)),
        {
            at: -face * problem.usable_friction(at[1], at[0]) * y
            for at, y in zip(contacts, _significant_slacks(s), strict=True)
        },
        dict(zip(contacts, _significant_slacks(r), strict=True)),
        {
            at: problem.weight_n * (max_load_share(problem, at[1]) + y) if y else 0.0
            for at, y in zip(contacts, _significant_slacks(q), strict=True)
        },
        {i: problem.mass_kg * (MAX_SPIN_M2_S + y) if y else 0.0 for i, y in enumerate(_significant_slacks(l))},
        _end_miss(problem, e[n_end:] - e[:n_end]),
        float(cost @ x[n:]),
    )


def is_feasible(problem: CentroidalProblem) -> bool:
    """Whether the constraints have a solution, wherever it takes the CoM.

    Decided by the slacks of the elastic program instead of a solver's status, which depends on tolerances.
    """
    solution = solve_elastic(problem, cones=1.0)
    return solution is not None and solution.is_feasible


def minimise_linear(
    cost: Vector,
    equal: tuple[sp.csc_matrix, Vector],
    below: tuple[sp.csc_matrix, Vector],
    bounds: Float[np.ndarray, "_ 2"],
) -> Vector | None:
    """Minimise ``cost x`` under equality and upper-bound rows; None if infeasible or unbounded.

    Falls back to the interior-point method where the simplex method of HiGHS fails numerically.
    """
    for method in ("highs-ds", "highs-ipm"):
        result = linprog(cost, A_eq=equal[0], b_eq=equal[1], A_ub=below[0], b_ub=below[1], bounds=bounds, method=method)
        if result.x is not None:
            return np.asarray(result.x)
        if result.status in (2, 3):
            return None
    return None


def _end_miss(problem: CentroidalProblem, e: Vector) -> EndMiss:
    if problem.terminal == "capturable":
        beyond = np.array([np.abs(e[2:]).max(), 0.0, e[0]])
        return EndMiss(beyond, np.array([0.0, 0.0, e[1]]), np.zeros(3), np.zeros(3))
    com, velocity, K = e[-9:-6], e[-6:-3], e[-3:]
    about_it = np.cross(problem.com_end_m - problem.com_start_m + com, velocity)
    momentum = problem.weight_n * K - problem.mass_kg * about_it
    return EndMiss(com, velocity, e[0:3] * problem.weight_n / problem.mass_kg, momentum)


def _finite_price(price: float) -> float:
    return price if np.isfinite(price) else 0.0


def _slack_bound(price: float) -> float:
    return np.inf if np.isfinite(price) else 0.0


def _significant_slacks(slacks: Vector) -> list[float]:
    return [float(x) if x > SLACK_TOLERANCE else 0.0 for x in slacks]
