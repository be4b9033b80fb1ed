"""A mixed-integer linear program, written row by row, for scipy's HiGHS."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from stridelab.conventions import Series

Columns = tuple[int, ...]
Terms = list[tuple[int, float]]
"""Variables with their coefficients; those of one variable add up."""
INFEASIBLE: Final = 2
"""Status of ``scipy.optimize.milp`` for a program that is proven to have no solution."""


@dataclass(frozen=True, eq=False)
class Answer:
    """``x`` None: no solution is known; ``proven`` that there is none, otherwise time ran out."""

    x: Series | None
    objective: float
    proven: bool


class LinearProgram:
    """``min c x`` with ``low <= A x <= high``, bounds and whole numbers."""

    def __init__(self) -> None:
        self._low: list[float] = []
        self._high: list[float] = []
        self._cost: list[float] = []
        self._whole: list[int] = []
        self._entries: list[tuple[int, int, float]] = []
        self._row_low: list[float] = []
        self._row_high: list[float] = []

    def add(
        self, n: int, low: float = -np.inf, high: float = np.inf, cost: float = 0.0, *, whole: bool = False
    ) -> Columns:
        """``n`` new variables; returns their columns."""
        first = len(self._low)
        self._low += [low] * n
        self._high += [high] * n
        self._cost += [cost] * n
        self._whole += [int(whole)] * n
        return tuple(range(first, first + n))

    def row(self, terms: Terms, low: float = -np.inf, high: float = np.inf) -> None:
        """``low <= sum of coefficient times variable <= high``."""
        row = len(self._row_low)
        self._entries += [(row, column, float(value)) for column, value in terms if value != 0.0]
        self._row_low.append(low)
        self._row_high.append(high)

    def solve(self, seconds: float) -> Answer:
        """The optimum to HiGHS' gap of 1e-4, or the best that was found in time."""
        shape = (len(self._row_low), len(self._low))
        rows, columns, values = zip(*self._entries, strict=True)
        A = csr_array((values, (rows, columns)), shape=shape)
        found = milp(
            np.array(self._cost),
            integrality=np.array(self._whole),
            bounds=Bounds(np.array(self._low), np.array(self._high)),
            constraints=LinearConstraint(A, np.array(self._row_low), np.array(self._row_high)),
            options={"time_limit": seconds},
        )
        if found.x is None:
            return Answer(None, np.inf, found.status == INFEASIBLE)
        return Answer(np.asarray(found.x), float(found.fun), proven=True)
