"""Parquet bytes as columns."""

import io
from collections.abc import Mapping

import numpy as np
import pyarrow.parquet as pq

Columns = Mapping[str, np.ndarray]
"""Name to values, float64, NaN where a value is missing."""


def read_columns(content: bytes) -> Columns:
    """All numeric columns of a Parquet table (shape ``(rows,)`` each)."""
    table = pq.read_table(io.BytesIO(content))
    columns: dict[str, np.ndarray] = {}
    for name in table.column_names:
        values = table.column(name).to_numpy()
        if values.dtype.kind in "fiub":
            columns[name] = values.astype(np.float64)
    return columns


def read_texts(content: bytes) -> Mapping[str, list[str]]:
    """All columns of text of a Parquet table."""
    table = pq.read_table(io.BytesIO(content))
    return {
        name: table.column(name).to_pylist() for name in table.column_names if table.schema.field(name).type == "string"
    }


def xyz_columns(columns: Columns, before: str, after: str) -> np.ndarray | None:
    """Columns ``<before>x<after>``, y and z as one array of shape ``(rows, 3)``, or None where one is missing."""
    names = [f"{before}{axis}{after}" for axis in "xyz"]
    if not all(name in columns for name in names):
        return None
    return np.column_stack([columns[name] for name in names])
