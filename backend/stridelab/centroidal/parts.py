"""A programme put together from small functions: each is written once, mapped over its uses and scattered into place.

    f(w) = sum over parts, sum over uses i of  phi(w[I_i], q_i)
    g(w) = sum over parts, of  psi(w[I_i], q_i)  into the rows J_i

so that building takes milliseconds per second of motion where differentiating one large expression takes seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from jaxtyping import Int

from stridelab.centroidal.sparse import Pattern, scatter

Indices = Int[np.ndarray, "uses _"]


@dataclass(frozen=True, eq=False)
class Cost:
    """``phi(y, q)`` with its gradient and ``curvature(y, q, theta)``, the upper triangle being read.

    theta is that of ``likelihood``; ``n_q`` is the size of q.
    """

    name: str
    of_y: Indices
    n_q: int
    value: ca.Function
    gradient: ca.Function
    curvature: ca.Function


@dataclass(frozen=True, eq=False)
class Rows:
    """``psi(y, q)`` with its Jacobian and ``curvature(y, q, lambda)`` of ``lambda psi``, None where it is linear."""

    name: str
    of_y: Indices
    of_row: Indices
    n_q: int
    value: ca.Function
    jacobian: ca.Function
    curvature: ca.Function | None


@dataclass(frozen=True, eq=False)
class Programme:
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


def assemble(n: int, n_rows: int, costs: list[Cost], rows: list[Rows], scale: float) -> Programme:
    """Put the parts together; ``scale`` multiplies the objective."""
    parameters = _shapes([*costs, *rows])
    w, theta, s = ca.MX.sym("w", n), ca.MX.sym("theta"), ca.MX.sym("s")
    p = ca.MX.sym("p", sum(n_q * uses for _, (n_q, uses) in parameters))
    lam = ca.MX.sym("lambda", n_rows)
    q = dict(zip((name for name, _ in parameters), _blocks(p, [shape for _, shape in parameters]), strict=True))

    f, gradient = ca.MX(0), ca.MX.zeros(n)
    H, J = Pattern(), Pattern()
    for cost in costs:
        uses, m = cost.of_y.shape
        y = ca.reshape(w[cost.of_y.ravel().tolist()], m, uses)
        f += ca.sum2(cost.value.map(uses)(y, q[cost.name]))
        gradient += scatter(cost.of_y, n) @ ca.vec(cost.gradient.map(uses)(y, q[cost.name]))
        curvature = _triangle(cost.curvature)
        H.add(cost.of_y, cost.of_y, curvature, (s * scale) * curvature.map(uses)(y, q[cost.name], theta).nz[:])
    g = ca.MX.zeros(n_rows)
    for part in rows:
        uses, m = part.of_y.shape
        y = ca.reshape(w[part.of_y.ravel().tolist()], m, uses)
        g += scatter(part.of_row, n_rows) @ ca.vec(part.value.map(uses)(y, q[part.name]))
        J.add(part.of_row, part.of_y, part.jacobian, part.jacobian.map(uses)(y, q[part.name]).nz[:])
        if part.curvature is not None:
            own = ca.reshape(lam[part.of_row.ravel().tolist()], part.of_row.shape[1], uses)
            curvature = _triangle(part.curvature)
            H.add(part.of_y, part.of_y, curvature, curvature.map(uses)(y, q[part.name], own).nz[:])
    return Programme(
        n=n,
        n_rows=n_rows,
        parameters=parameters,
        value=ca.Function("value", [w, p], [scale * f]),
        gradient=ca.Function("gradient", [w, p], [scale * gradient]),
        rows=ca.Function("rows", [w, p], [g]),
        jacobian=ca.Function("jacobian", [w, p], [J.matrix(n_rows, n)]),
        hessian=ca.Function("hessian", [w, p, s, lam, theta], [H.matrix(n, n)]),
    )


def _shapes(parts: Sequence[Cost | Rows]) -> tuple[tuple[str, tuple[int, int]], ...]:
    return tuple((part.name, (part.n_q, len(part.of_y))) for part in parts)


def _blocks(p: ca.MX, shapes: list[tuple[int, int]]) -> list[ca.MX]:
    ends = np.cumsum([0] + [n_q * uses for n_q, uses in shapes]).tolist()
    return [ca.reshape(part, n_q, uses) for part, (n_q, uses) in zip(ca.vertsplit(p, ends), shapes, strict=True)]


def _triangle(function: ca.Function) -> ca.Function:
    """The upper triangle of a function's matrix."""
    inputs = [ca.SX.sym(f"i{i}", function.sparsity_in(i)) for i in range(function.n_in())]
    return ca.Function("upper", inputs, [ca.triu(function(*inputs))])
