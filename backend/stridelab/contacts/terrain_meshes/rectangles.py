"""Largest rectangles of free cells on a grid, and the direction in which they are largest."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

Cells = Bool[np.ndarray, "nx ny"]
Span = tuple[tuple[int, int], tuple[int, int]]
TRIED_CELLS: Final = 80
"""Most cells along an edge while turns are tried."""
TRIED_TURNS_RAD: Final = np.deg2rad(np.arange(0.0, 90.0, 5.0))


def largest_rectangle(free: Cells, least: int = 1) -> Span:
    """First cell of the largest rectangle of free cells, and the one after its last; by the heights of columns.

    Its edges have at least ``least`` cells; without one, both corners are the same.
    """
    rows, columns = np.flatnonzero(free.any(axis=1)), np.flatnonzero(free.any(axis=0))
    if len(rows) == 0:
        return (0, 0), (0, 0)
    i, j = int(rows[0]), int(columns[0])
    (a, b), (c, d) = _largest_inside(free[i : int(rows[-1]) + 1, j : int(columns[-1]) + 1], least)
    return (a + i, b + j), (c + i, d + j)


def has_square(free: Cells, edge: int) -> bool:
    """Whether a square of free cells with an edge of that many cells is somewhere."""
    if edge <= 1 or min(free.shape) < edge:
        return bool(free.any()) and min(free.shape) >= edge
    sums = np.pad(free.astype(np.int64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    squares = sums[edge:, edge:] - sums[:-edge, edge:] - sums[edge:, :-edge] + sums[:-edge, :-edge]
    return bool((squares == edge * edge).any())


def _largest_inside(free: Cells, least: int) -> Span:
    best, found = 0, ((0, 0), (0, 0))
    heights: Int[np.ndarray, "ny"] = np.zeros(free.shape[1], dtype=int)
    for row in range(free.shape[0]):
        heights = np.where(free[row], heights + 1, 0)
        stack: list[tuple[int, int]] = []
        for column, height in enumerate([*heights.tolist(), 0]):
            start = column
            while stack and stack[-1][1] >= height:
                start, top = stack.pop()
                if top * (column - start) > best and min(top, column - start) >= least:
                    best, found = top * (column - start), ((row - top + 1, start), (row + 1, column))
            stack.append((start, height))
    return found


def turn_cells(free: Cells, turn_rad: float) -> tuple[Bool[np.ndarray, "kx ky"], Float[np.ndarray, "2"]]:
    """Cells of a grid turned by ``turn_rad`` about the first corner of the old one, and their origin, in cells.

    A new cell is free if the old cell at its centre is.
    """
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    to_new = np.array([[c, s], [-s, c]])
    corners = np.array([(i, j) for i in (0, free.shape[0]) for j in (0, free.shape[1])], float) @ to_new.T
    low = np.floor(corners.min(axis=0))
    shape = (np.ceil(corners.max(axis=0)) - low).astype(int)
    centres = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij"), axis=-1) + low
    old = np.floor(centres @ to_new).astype(int)
    inside = ((old >= 0) & (old < free.shape)).all(axis=-1)
    turned = np.zeros(tuple(shape), dtype=bool)
    turned[inside] = free[tuple(old[inside].T)]
    return turned, low


def best_turn_rad(free: Cells, at_least: float) -> float:
    """The turn by which the largest rectangle grows most; 0 if by less than the factor ``at_least``."""
    step = max(free.shape) // TRIED_CELLS + 1
    rows, columns = (n // step * step for n in free.shape)
    if step > 1 and rows and columns:
        free = np.asarray(free[:rows, :columns].reshape(rows // step, step, columns // step, step).all(axis=(1, 3)))
    sizes = [size_of(largest_rectangle(turn_cells(free, float(turn))[0])) for turn in TRIED_TURNS_RAD]
    best = int(np.argmax(sizes))
    return float(TRIED_TURNS_RAD[best]) if sizes[best] > at_least * max(sizes[0], 1) else 0.0


def size_of(span: Span) -> int:
    """Cells of a rectangle."""
    (i, j), (k, m) = span
    return (k - i) * (m - j)
