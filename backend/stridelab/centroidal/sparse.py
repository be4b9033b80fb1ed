"""Sparse matrices put together block by block, and handed to CasADi."""

from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import scipy.sparse as sp


@dataclass(frozen=True)
class Blocks:
    """A sparse matrix under construction; entries that meet are added."""

    rows: list[np.ndarray] = field(default_factory=list)
    columns: list[np.ndarray] = field(default_factory=list)
    values: list[np.ndarray] = field(default_factory=list)

    def add(self, row: int, column: int, M: np.ndarray) -> None:
        """Put ``M`` with its upper left corner at ``(row, column)``."""
        i, j = np.nonzero(M)
        self.rows.append(row + i)
        self.columns.append(column + j)
        self.values.append(M[i, j])

    def matrix(self, shape: tuple[int, int]) -> sp.csc_matrix:
        """The finished matrix."""
        if not self.rows:
            return sp.csc_matrix(shape)
        places = np.concatenate(self.rows), np.concatenate(self.columns)
        return sp.csc_matrix((np.concatenate(self.values), places), shape=shape)


def constant(M: sp.csc_matrix) -> ca.DM:
    """The same matrix as CasADi's."""
    M.sort_indices()
    rows, columns = int(M.shape[0]), int(M.shape[1])
    return ca.DM(ca.Sparsity(rows, columns, M.indptr.astype(int), M.indices.astype(int)), M.data)


def scatter(indices: np.ndarray, n: int) -> ca.DM:
    """Matrix that adds the numbers of a vector to the places ``indices`` of a vector of size ``n``."""
    flat = indices.ravel()
    return constant(sp.csc_matrix((np.ones(len(flat)), (flat, np.arange(len(flat)))), shape=(n, len(flat))))


@dataclass(frozen=True)
class Triangle:
    """The upper triangle of a sparse symmetric matrix whose values are expressions."""

    rows: list[np.ndarray] = field(default_factory=list)
    columns: list[np.ndarray] = field(default_factory=list)
    values: list[ca.MX] = field(default_factory=list)

    def add_constant(self, M: sp.csc_matrix) -> None:
        """Add the upper triangle of a constant matrix."""
        upper = sp.triu(M).tocoo()
        self.rows.append(upper.row)
        self.columns.append(upper.col)
        self.values.append(ca.MX(ca.DM(upper.data)))

    def add_blocks(self, indices: np.ndarray, blocks: ca.MX) -> None:
        """Add symmetric ``m x m`` blocks that stand side by side, one for each row of ``indices`` ``(n, m)``."""
        m = indices.shape[1]
        i, j = np.triu_indices(m)
        self.rows.append(indices[:, i].ravel())
        self.columns.append(indices[:, j].ravel())
        at = (np.arange(len(indices))[:, None] * m + j) * m + i
        self.values.append(ca.vec(blocks)[at.ravel().tolist()])

    def matrix(self, n: int) -> ca.MX:
        """The finished ``n x n`` upper triangle."""
        key = np.concatenate(self.columns) * np.int64(n) + np.concatenate(self.rows)
        places, where = np.unique(key, return_inverse=True)
        pattern = ca.Sparsity.triplet(n, n, (places % n).tolist(), (places // n).tolist())
        return ca.MX(pattern, scatter(where, len(places)) @ ca.vertcat(*self.values))
