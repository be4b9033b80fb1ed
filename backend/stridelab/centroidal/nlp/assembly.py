"""Assembly of a nonlinear program from small functions: each is mapped over its uses and scattered into place.

    f(w) = sum over parts, sum over uses i of  phi(w[I_i], q_i)
    g(w) = sum over parts, of  psi(w[I_i], q_i)  into the rows J_i

so that building takes milliseconds per second of motion; differentiating one large expression takes seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import scipy.sparse as sp
from jaxtyping import Int

from stridelab.centroidal.nlp.stage_functions import CostFunctions, RowFunctions

Indices = Int[np.ndarray, "uses _"]


@dataclass(frozen=True, eq=False)
class CostPart:
    """``phi(y, q)`` for every row of ``of_y``; of its curvature the upper triangle is used."""

    name: str
    of_y: Indices
    functions: CostFunctions


@dataclass(frozen=True, eq=False)
class ConstraintPart:
    """``psi(y, q)`` for every row of ``of_y``, into the rows ``of_row``."""

    name: str
    of_y: Indices
    of_row: Indices
    functions: RowFunctions


@dataclass(frozen=True, eq=False)
class NonlinearProgram:
    """``f``, ``g`` of ``(w, p)`` and derivatives; ``hessian`` is the upper triangle of that of ``s f + lambda g``.

    ``hessian`` takes ``(w, p, s, lambda, theta)``. ``parameters`` names the blocks of p in their order, each with its
    shape ``(n_q, uses)``.
    """

    n: int
    n_rows: int
    parameters: tuple[tuple[str, tuple[int, int]], ...]
    value: ca.Function
    gradient: ca.Function
    rows: ca.Function
    jacobian: ca.Function
    hessian: ca.Function

    @property
    def n_p(self) -> int:
        """Size of p."""
        return sum(n_q * uses for _, (n_q, uses) in self.parameters)


def assemble_nlp(
    n: int, n_rows: int, costs: list[CostPart], rows: list[ConstraintPart], scale: float
) -> NonlinearProgram:
    """Assemble the nonlinear program; ``scale`` multiplies the objective."""
    parameters = _parameter_shapes([*costs, *rows])
    w, theta, s = ca.MX.sym("w", n), ca.MX.sym("theta"), ca.MX.sym("s")
    p = ca.MX.sym("p", sum(n_q * uses for _, (n_q, uses) in parameters))
    lam = ca.MX.sym("lambda", n_rows)
    q = dict(
        zip((name for name, _ in parameters), _split_parameters(p, [shape for _, shape in parameters]), strict=True)
    )

    f, gradient = ca.MX(0), ca.MX.zeros(n)
    H, J = SparseExpression(), SparseExpression()
    for cost in costs:
        uses, m = cost.of_y.shape
        y = ca.reshape(w[cost.of_y.ravel().tolist()], m, uses)
        f += ca.sum2(cost.functions.value.map(uses)(y, q[cost.name]))
        gradient += scatter_matrix(cost.of_y, n) @ ca.vec(cost.functions.gradient.map(uses)(y, q[cost.name]))
        curvature = _upper_triangle(cost.functions.curvature)
        H.add_blocks(cost.of_y, cost.of_y, curvature, (s * scale) * curvature.map(uses)(y, q[cost.name], theta).nz[:])
    g = ca.MX.zeros(n_rows)
    for part in rows:
        of = part.functions
        uses, m = part.of_y.shape
        y = ca.reshape(w[part.of_y.ravel().tolist()], m, uses)
        g += scatter_matrix(part.of_row, n_rows) @ ca.vec(of.value.map(uses)(y, q[part.name]))
        J.add_blocks(part.of_row, part.of_y, of.jacobian, of.jacobian.map(uses)(y, q[part.name]).nz[:])
        if of.curvature is not None:
            own = ca.reshape(lam[part.of_row.ravel().tolist()], part.of_row.shape[1], uses)
            curvature = _upper_triangle(of.curvature)
            H.add_blocks(part.of_y, part.of_y, curvature, curvature.map(uses)(y, q[part.name], own).nz[:])
    return NonlinearProgram(
        n=n,
        n_rows=n_rows,
        parameters=parameters,
        value=ca.Function("value", [w, p], [scale * f]),
        gradient=ca.Function("gradient", [w, p], [scale * gradient]),
        rows=ca.Function("rows", [w, p], [g]),
        jacobian=ca.Function("jacobian", [w, p], [J.matrix(n_rows, n)]),
        hessian=ca.Function("hessian", [w, p, s, lam, theta], [H.matrix(n, n)]),
    )


def _parameter_shapes(parts: Sequence[CostPart | ConstraintPart]) -> tuple[tuple[str, tuple[int, int]], ...]:
    return tuple((part.name, (part.functions.value.size1_in(1), len(part.of_y))) for part in parts)


def _split_parameters(p: ca.MX, shapes: list[tuple[int, int]]) -> list[ca.MX]:
    ends = np.cumsum([0] + [n_q * uses for n_q, uses in shapes]).tolist()
    return [ca.reshape(part, n_q, uses) for part, (n_q, uses) in zip(ca.vertsplit(p, ends), shapes, strict=True)]


def _upper_triangle(function: ca.Function) -> ca.Function:
    """Function that returns the upper triangle of the matrix of ``function``."""
    inputs = [ca.SX.sym(f"i{i}", function.sparsity_in(i)) for i in range(function.n_in())]
    return ca.Function("upper", inputs, [ca.triu(function(*inputs))])


def to_casadi(M: sp.csc_matrix) -> ca.DM:
    """Convert a SciPy sparse matrix to CasADi."""
    M.sort_indices()
    rows, columns = int(M.shape[0]), int(M.shape[1])
    return ca.DM(ca.Sparsity(rows, columns, M.indptr.tolist(), M.indices.tolist()), M.data)


def scatter_matrix(indices: Int[np.ndarray, "..."], n: int) -> ca.DM:
    """Matrix that adds the entries of a vector to the entries ``indices`` of a vector of size ``n``."""
    flat = indices.ravel()
    return to_casadi(sp.csc_matrix((np.ones(len(flat)), (flat, np.arange(len(flat)))), shape=(n, len(flat))))


@dataclass(frozen=True)
class SparseExpression:
    """A sparse matrix of expressions under construction; overlapping entries are added."""

    rows: list[Int[np.ndarray, "_"]] = field(default_factory=list)
    columns: list[Int[np.ndarray, "_"]] = field(default_factory=list)
    values: list[ca.MX] = field(default_factory=list)

    def add_blocks(
        self,
        of_row: Int[np.ndarray, "uses rows"],
        of_column: Int[np.ndarray, "uses columns"],
        function: ca.Function,
        values: ca.MX,
    ) -> None:
        """Add the nonzeros of ``function``'s matrix, use after use.

        An upper triangle is preserved if the indices of every use ascend.
        """
        i, j = (np.array(x, dtype=int) for x in function.sparsity_out(0).get_triplet())
        self.rows.append(of_row[:, i].ravel())
        self.columns.append(of_column[:, j].ravel())
        self.values.append(ca.vec(values))

    def matrix(self, n_rows: int, n_columns: int) -> ca.MX:
        """The finished matrix."""
        if not self.values:
            return ca.MX(n_rows, n_columns)
        key = np.concatenate(self.columns) * np.int64(n_rows) + np.concatenate(self.rows)
        places, where = np.unique(key, return_inverse=True)
        pattern = ca.Sparsity.triplet(n_rows, n_columns, (places % n_rows).tolist(), (places // n_rows).tolist())
        return ca.MX(pattern, scatter_matrix(where, len(places)) @ ca.vertcat(*self.values))
