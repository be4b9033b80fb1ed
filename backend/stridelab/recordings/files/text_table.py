"""Parses tables of numbers separated by tabs or blanks; errors name the line and column."""

import re
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series
from stridelab.recordings.files.raw import LARGEST_PLAUSIBLE

_NO_NUMBER: Final = re.compile(r"([-+]?(nan(\(\w*\))?|1\.#(ind|qnan|snan)\d*))?", re.IGNORECASE)
"""An empty cell, and NaN as the runtime libraries of C print it: ``nan``, ``-nan(ind)``, ``1.#QNAN``, ``-1.#IND00``."""

Table = Float[np.ndarray, "rows columns"]


class BrokenLineError(ValueError):
    """Syntax error in a text file; the message names the line and completes a sentence for users."""


def numbered_lines(lines: list[str], start: int) -> list[tuple[int, str]]:
    """The non-blank lines from index ``start``, each with its line number, counted from one."""
    return [(i + 1, line) for i, line in enumerate(lines) if i >= start and line.strip()]


def split_cells(row: str) -> list[str]:
    """The cells of a row, separated by tabs, or by blanks if it has no tabs."""
    return row.rstrip("\r\n").split("\t") if "\t" in row else row.split()


def parse_table(rows: list[tuple[int, str]], width: int) -> Table:
    """Numbers of tab (or blank) separated rows; empty cells are NaN.

    Raises ``BrokenLineError`` for a short row, a cell that is not a number, or a magnitude above ``LARGEST_PLAUSIBLE``.
    """
    values = []
    for line, row in rows:
        cells = split_cells(row)
        if len(cells) < width and "\t" in row and width - len(cells) <= 3:
            cells += [""] * (width - len(cells))
        if len(cells) < width:
            raise BrokenLineError(f"line {line} has {len(cells)} of {width} values")
        values.append([_parse_cell(cell, line, column) for column, cell in enumerate(cells[:width], start=1)])
    return np.array(values, dtype=np.float64).reshape(len(values), width)


def parse_storage(text: str) -> tuple[list[str], list[str], Table]:
    """Header lines, names of the columns and rows of a MOT or STO file, whose header ends in ``endheader``.

    Raises ``BrokenLineError`` as ``parse_table``, and for a file without that line.
    """
    lines = text.splitlines()
    ends = [i for i, line in enumerate(lines) if line.strip().lower() == "endheader"]
    if not ends:
        raise BrokenLineError("it has no line endheader")
    rows = numbered_lines(lines, ends[0] + 1)
    if not rows:
        raise BrokenLineError(f"the file ends with endheader in line {ends[0] + 1}, before the names of its columns")
    columns = rows[0][1].split()
    return lines[: ends[0]], columns, parse_table(rows[1:], len(columns))


def _parse_cell(cell: str, line: int, column: int) -> float:
    try:
        value = np.nan if _NO_NUMBER.fullmatch(cell.strip()) else float(cell)
    except ValueError as error:
        raise BrokenLineError(
            f"line {line}, column {column} holds {cell.strip()[:40]!r}, which is not a number"
        ) from error
    if LARGEST_PLAUSIBLE < abs(value) < np.inf:
        raise BrokenLineError(f"line {line}, column {column} holds {value:.3g}, which is implausibly large")
    return value


def sampling_rate_hz(time_s: Series) -> float:
    """Sampling rate of a time column with rounded entries: the mean over the whole column."""
    rate_hz = float((len(time_s) - 1) / (time_s[-1] - time_s[0]))
    nearest = round(rate_hz)
    return float(nearest) if nearest and abs(rate_hz - nearest) < 1e-3 * nearest else rate_hz
