"""Sparse matrices put together from many small ones, for CasADi."""

from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import scipy.sparse as sp
from jaxtyping import Int


def constant(M: sp.csc_matrix) -> ca.DM:
    """The same matrix as CasADi's."""
    M.sort_indices()
    rows, columns = int(M.shape[0]), int(M.shape[1])
    return ca.DM(ca.Sparsity(rows, columns, M.indptr.tolist(), M.indices.tolist()), M.data)


def scatter(indices: Int[np.ndarray, "..."], n: int) -> ca.DM:
    """Matrix that adds the numbers of a vector to the places ``indices`` of a vector of size ``n``."""
    flat = indices.ravel()
    return constant(sp.csc_matrix((np.ones(len(flat)), (flat, np.arange(len(flat)))), shape=(n, len(flat))))


@dataclass(frozen=True)
class Pattern:
    """A sparse matrix under construction, its values expressions; entries that meet are added."""

    rows: list[Int[np.ndarray, "_"]] = field(default_factory=list)
    columns: list[Int[np.ndarray, "_"]] = field(default_factory=list)
    values: list[ca.MX] = field(default_factory=list)

    def add(
        self,
        of_row: Int[np.ndarray, "uses rows"],
        of_column: Int[np.ndarray, "uses columns"],
        function: ca.Function,
        values: ca.MX,
    ) -> None:
        """Add the nonzeros of ``function``'s matrix, use after use.

        An upper triangle stays one where the indices of every use ascend.
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
        return ca.MX(pattern, scatter(where, len(places)) @ ca.vertcat(*self.values))
