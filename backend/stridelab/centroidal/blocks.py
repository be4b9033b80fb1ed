"""A sparse matrix of numbers, put together block by block."""

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Blocks:
    """The matrix under construction; entries that meet are added."""

    rows: list[Int[np.ndarray, "_"]] = field(default_factory=list)
    columns: list[Int[np.ndarray, "_"]] = field(default_factory=list)
    values: list[Float[np.ndarray, "_"]] = field(default_factory=list)

    def add(self, row: int, column: int, M: Float[np.ndarray, "rows columns"]) -> None:
        """Put ``M`` with its upper left corner at ``(row, column)``."""
        i, j = np.nonzero(M)
        self.rows.append(row + i)
        self.columns.append(column + j)
        self.values.append(M[i, j])

    def matrix(self, n_rows: int, n_columns: int) -> sp.csc_matrix:
        """The finished matrix."""
        if not self.values:
            return sp.csc_matrix((n_rows, n_columns))
        places = np.concatenate(self.rows), np.concatenate(self.columns)
        return sp.csc_matrix((np.concatenate(self.values), places), shape=(n_rows, n_columns))
