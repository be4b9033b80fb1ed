"""Strict hierarchy of least-squares levels under equalities and inequalities (section 4.6; Escande 2014, Saab 2013).

    level 0    A_0 z = b_0
    level k    min |A_k z - b_k|^2   over the optima of the levels above                all under  l <= G z <= u

Each level moves only in the null space of those above, ``z = z_k + Z_k w`` with ``A_i Z_k = 0`` for i < k, so a lower
level cannot disturb a higher one. The inequalities are the same on every level.

An exact shortcut first assumes that the residuals of the upper levels can be zero: they are factorised together with
the equalities, and only the last level's quadratic program is solved. If it has a solution, zero is optimal for the
upper levels, and the result is that of the whole cascade; otherwise the cascade is solved level by level. On a motion
without saturation this takes one quadratic program per sample. Where the C++ module is built, it makes that program
(``reduced_level``), to rounding that of ``_reduced_exactly`` in another basis of the null space: a third of the time of
numpy, which multiplies the zeros of the rows of single joints and forces as well.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import daqp
import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import lapack

from stridelab.centroidal.native.availability import NativeSolver, native_availability

Unknowns = Float[np.ndarray, "n"]
Basis = Float[np.ndarray, "n k"]

_RANK = 1e-9
"""Pivots below this share of the largest one count as zero."""
_CONSISTENT = 1e-7
"""Largest residual, relative to the right-hand side, of consistent equalities."""
_DAMPING = 1e-9
"""Weight of |w|^2 on a level that does not determine w uniquely."""
_PROXIMAL = -1e-5
"""Weight of the proximal steps for a level that does not determine ``w``; negative: only if necessary."""
_BINDING = 1e-6
_ROUNDING = 1e-10
"""Largest entry, relative to the level's rows, of a level that the levels above leave nothing to decide."""
_NO_BOUND = 1e30


class Rows(NamedTuple):
    """Linear rows ``A z = b``."""

    A: Float[np.ndarray, "m n"]
    b: Float[np.ndarray, "m"]


class Inequalities(NamedTuple):
    """``lower <= G z <= upper``; infinite bounds are allowed."""

    G: Float[np.ndarray, "m n"]
    lower: Float[np.ndarray, "m"]
    upper: Float[np.ndarray, "m"]


@dataclass(frozen=True)
class HierarchyFailure:
    """The level that had no solution and why."""

    level: int
    reason: str


class HierarchyResult(NamedTuple):
    """``z``, valid if ``failure`` is None; ``quadratic_programs`` counts the quadratic programs that were solved."""

    z: Unknowns
    failure: HierarchyFailure | None
    quadratic_programs: int


def solve_hierarchy(equality: Rows, levels: Sequence[Rows], bounds: Inequalities) -> HierarchyResult:
    """Solve the hierarchy; a failure is returned with its level, never raised."""
    n_solved = 0
    shortcut = _reduced_exactly((equality, *levels[:-1]), levels[-1], bounds)
    if shortcut is not None:
        solution = _solve_level(shortcut)
        n_solved = 1
        if solution.flag > 0:
            return HierarchyResult(shortcut.z + shortcut.Z @ solution.w, None, n_solved)
    z, Z, residual = _solve_linear(equality)
    if not _is_negligible(residual, equality.b):
        reason = f"the equalities contradict each other by {np.abs(residual).max():.2g}"
        return HierarchyResult(z, HierarchyFailure(0, reason), 0)
    for number, level in enumerate(levels, start=1):
        solution = _solve_level(_reduced_level(z, Z, level, bounds))
        n_solved += 1
        if solution.flag < 1:
            reason = _REASONS.get(solution.flag, f"solver flag {solution.flag}")
            return HierarchyResult(z, HierarchyFailure(number, reason), n_solved)
        z = z + Z @ solution.w
        if number < len(levels) and Z.shape[1]:
            fixed_rows = np.vstack([level.A, bounds.G[_binding_rows(level, z, solution.multipliers)]]) @ Z
            Z = Z @ _solve_linear(Rows(fixed_rows, np.zeros(len(fixed_rows)))).null
            bounds = _widened_bounds(z, bounds)
    return HierarchyResult(z, None, n_solved)


def minimum_violations(
    equality: Rows, bounds: Inequalities, soft: Bool[np.ndarray, "m"]
) -> Float[np.ndarray, "m"] | None:
    """Smallest violations (least squares) of the ``soft`` inequalities for which all other constraints hold.

    None if there is no solution even then.
    """
    z, Z, _ = _solve_linear(equality)
    G, off = bounds.G @ Z, bounds.G @ z
    n, m, soft_rows = Z.shape[1], len(off), np.flatnonzero(soft)
    H = np.diag(np.concatenate([np.full(n, _DAMPING), np.ones(len(soft_rows))]))
    rows = np.hstack([G, np.zeros((m, len(soft_rows)))])
    rows[soft_rows, n + np.arange(len(soft_rows))] = -1.0
    upper, lower = np.minimum(bounds.upper - off, _NO_BOUND), np.maximum(bounds.lower - off, -_NO_BOUND)
    x, _, flag, _ = daqp.solve(H, np.zeros(len(H)), rows, upper, lower, np.zeros(m, np.int32))
    if flag < 1:
        return None
    violation = np.zeros(m)
    violation[soft_rows] = np.abs(x[n:])
    return violation


class _LinearSolution(NamedTuple):
    z: Unknowns
    null: Basis
    residual: Float[np.ndarray, "m"]


def _solve_linear(rows: Rows) -> _LinearSolution:
    """Smallest solution of ``A z = b``, orthonormal basis of the null space of A, ``A z - b``.

    By QR with column pivoting of A' (``A' P = Q R``): a quarter of the time of a singular value decomposition.
    """
    A, b = rows
    m, n = A.shape
    packed, order, tau, _, _ = lapack.dgeqp3(A.T)
    pivots = np.abs(np.diagonal(packed))
    rank = int(np.count_nonzero(pivots > _RANK * pivots[0])) if min(m, n) and pivots[0] > 0.0 else 0
    square = np.zeros((n, n), order="F")
    square[:, : min(m, n)] = packed[:, : min(m, n)]
    Q, _, _ = lapack.dorgqr(square, tau, overwrite_a=1)
    if rank == 0:
        return _LinearSolution(np.zeros(n), np.eye(n), -b)
    picked = b[order[:rank] - 1]
    y, _ = lapack.dtrtrs(packed[:rank, :rank], picked, lower=0, trans=1)
    z = Q[:, :rank] @ y
    return _LinearSolution(z, Q[:, rank:], np.zeros(m) if rank == m else A @ z - b)


def _is_negligible(residual: Float[np.ndarray, "m"], b: Float[np.ndarray, "m"]) -> bool:
    """Whether residuals are zero up to rounding."""
    return float(np.abs(residual).max(initial=0.0)) <= _CONSISTENT * (1.0 + float(np.abs(b).max(initial=0.0)))


class _ReducedLevel(NamedTuple):
    """A level for ``z + Z w``: ``min_w w' H w / 2 + f' w`` under ``lower <= C w <= upper``."""

    z: Unknowns
    Z: Basis
    H: Float[np.ndarray, "k k"]
    f: Float[np.ndarray, "k"]
    C: Float[np.ndarray, "m k"]
    lower: Float[np.ndarray, "m"]
    upper: Float[np.ndarray, "m"]


def _reduced_exactly(above: Sequence[Rows], level: Rows, bounds: Inequalities) -> _ReducedLevel | None:
    """``level`` over the solutions of all rows above it together, or None if these are inconsistent."""
    native = native_availability()
    if isinstance(native, NativeSolver):
        m, n = bounds.G.shape
        values = np.empty(2 * n * (n + 1) + m * (n + 2))
        k = native.module.reduced_level(above, level, bounds, values)
        if k is None:
            return None
        return _ReducedLevel(*_views_in_turn(values, (n,), (n, k), (k, k), (k,), (m, k), (m,), (m,)))
    z, Z, off = _solve_linear(Rows(np.concatenate([A for A, _ in above]), np.concatenate([b for _, b in above])))
    row = 0
    for _, b in above if off.any() else ():
        if not _is_negligible(off[row : row + len(b)], b):
            return None
        row += len(b)
    return _reduced_level(z, Z, level, bounds)


def _views_in_turn(values: Float[np.ndarray, "_"], *shapes: tuple[int, ...]) -> Iterator[Float[np.ndarray, "..."]]:
    """Views of ``values``, one after the other."""
    start = 0
    for shape in shapes:
        end = start + math.prod(shape)
        yield values[start:end].reshape(shape)
        start = end


def _reduced_level(z: Unknowns, Z: Basis, level: Rows, bounds: Inequalities) -> _ReducedLevel:
    B = level.A @ Z
    if np.abs(B).max(initial=0.0) <= _ROUNDING * np.abs(level.A).max(initial=0.0):
        B = np.zeros_like(B)  # the level is decided above; rounding errors would drive w until the bounds stop it
    off = bounds.G @ z
    lower, upper = np.maximum(bounds.lower - off, -_NO_BOUND), np.minimum(bounds.upper - off, _NO_BOUND)
    return _ReducedLevel(z, Z, B.T @ B, B.T @ (level.A @ z - level.b), bounds.G @ Z, lower, upper)


class _LevelSolution(NamedTuple):
    w: Float[np.ndarray, "k"]
    flag: int
    multipliers: Float[np.ndarray, "m"]


def _solve_level(level: _ReducedLevel) -> _LevelSolution:
    """Optimal ``w``; the solver's flag (positive: solved), multipliers."""
    m = len(level.upper)
    if not len(level.f):
        return _LevelSolution(np.zeros(0), 1, np.zeros(m))
    equal = np.zeros(m, np.int32)
    w, _, flag, info = daqp.solve(level.H, level.f, level.C, level.upper, level.lower, equal, eps_prox=_PROXIMAL)
    return _LevelSolution(np.asarray(w), int(flag), np.abs(np.asarray(info["lam"])))


def _binding_rows(level: Rows, z: Unknowns, multipliers: Float[np.ndarray, "m"]) -> Bool[np.ndarray, "m"]:
    """Rows that are active in all optima of this level: those with a multiplier; none if the level is met exactly."""
    is_met = _is_negligible(level.A @ z - level.b, level.b)
    return multipliers > (np.inf if is_met else _BINDING * multipliers.max(initial=0.0))


def _widened_bounds(z: Unknowns, bounds: Inequalities) -> Inequalities:
    """Widen the bounds to contain ``z``: the solver meets active bounds only within its tolerance."""
    reached = bounds.G @ z
    return Inequalities(bounds.G, np.minimum(bounds.lower, reached), np.maximum(bounds.upper, reached))


_REASONS = {
    -1: "the constraints are inconsistent",
    -2: "the solver cycled",
    -3: "the quadratic program is unbounded",
    -4: "the solver reached its iteration limit",
    -5: "the quadratic program is not convex",
    -6: "the initial working set is overdetermined",
}
