"""Result tables: one Parquet file (zstd) and its CSV twin of the same stem, units in the column names.

The Parquet file's metadata contain the key ``stridelab``: JSON with the units per column, the software versions and the
caller's provenance. NaN stays NaN in Parquet and is an empty cell in CSV. Parquet contains text unchanged; in CSV, text
that a spreadsheet would evaluate as a formula is prefixed with an apostrophe.
"""

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from jaxtyping import Float

from stridelab.service.kinds.base import ArtifactFile
from stridelab.service.kinds.provenance import software_versions

PARQUET = "application/vnd.apache.parquet"
CSV = "text/csv"
C3D = "application/octet-stream"

METADATA_KEY = b"stridelab"
_FORMULA = frozenset("=+-@\t\r\n\uff1d\uff0b\uff0d\uff20")
"""First characters of formulas, including full-width forms."""

# Longest suffix first: "vx_m_s" is a velocity, not a length followed by seconds.
UNITS = (
    {"_m_s2_rthz": "m/s^2/sqrt(Hz)", "_m_rthz": "m/sqrt(Hz)", "_db": "dB"}
    | {
        "_m2_s": "m^2/s",
        "_m_s2": "m/s^2",
        "_m_s": "m/s",
        "_rad_s": "rad/s",
        "_nms": "N m s",
        "_nm": "N m",
        "_rad": "rad",
    }
    | {
        "_j_kg": "J/kg",
        "_1_min": "1/min",
        "_kg": "kg",
        "_hz": "Hz",
        "_m": "m",
        "_n": "N",
        "_s": "s",
    }
)


def unit_of(column: str) -> str:
    """Unit of a column according to its suffix; "1" for a name without a unit suffix."""
    return next((unit for suffix, unit in UNITS.items() if column.endswith(suffix)), "1")


def track_columns(name: str, track: Float[np.ndarray, "n 3"]) -> dict[str, np.ndarray]:
    """Columns x, y and z of a track; ``name`` has a placeholder for the axis."""
    return {name.format(axis): track[:, i] for i, axis in enumerate("xyz")}


def write_table(
    folder: Path, stem: str, columns: Mapping[str, np.ndarray], provenance: Mapping[str, Any]
) -> tuple[ArtifactFile, ArtifactFile]:
    """Write ``<stem>.parquet`` and ``<stem>.csv`` atomically into ``folder``.

    ``columns`` maps names (with unit suffix) to arrays of one common length. Raises ``ValueError`` when lengths differ.
    """
    about = {
        "units": {name: unit_of(name) for name in columns},
        "versions": software_versions(),
        "provenance": dict(provenance),
    }
    table = pa.table({name: np.asarray(values) for name, values in columns.items()})
    table = table.replace_schema_metadata({METADATA_KEY: json.dumps(about, sort_keys=True).encode()})
    parquet, csv = folder / f"{stem}.parquet", folder / f"{stem}.csv"
    write_atomically(parquet, lambda path: pyarrow.parquet.write_table(table, path, compression="zstd"))
    plain = _safe_for_spreadsheets(_empty_for_nan(table))
    write_atomically(csv, lambda path: pyarrow.csv.write_csv(plain, path))
    return ArtifactFile(parquet.name, PARQUET), ArtifactFile(csv.name, CSV)


def read_metadata(parquet: Path) -> dict[str, Any]:
    """Units, versions and provenance of a table written by ``write_table``."""
    metadata = pyarrow.parquet.read_schema(parquet).metadata or {}
    return dict(json.loads(metadata[METADATA_KEY]))


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Call ``write`` with a temporary file beside ``path``, then rename it; a failure leaves no file.

    The temporary name has the same suffix, on which some writers depend.
    """
    part = path.with_name(f".part-{os.getpid()}-{path.name}")
    try:
        write(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_text_atomically(path: Path, text: str) -> None:
    """Write ``text`` in UTF-8 with ``write_atomically``."""
    write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))


def spreadsheet_text(text: str) -> str:
    """Prefix ``text`` with an apostrophe if a spreadsheet would evaluate it as a formula; numbers are unchanged.

    Such a text begins, after optional spaces, with ``=``, ``+``, ``-``, ``@``, a tab or a line break (OWASP, CSV
    injection).
    """
    begin = text.lstrip(" ")[:1]
    if not begin or begin not in _FORMULA:
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def _safe_for_spreadsheets(table: pa.Table) -> pa.Table:
    for index, field in enumerate(table.schema):
        if pa.types.is_string(field.type) or pa.types.is_large_string(field.type):
            cells = [None if cell is None else spreadsheet_text(cell) for cell in table.column(index).to_pylist()]
            table = table.set_column(index, field.name, pa.array(cells, type=field.type))
    return table.rename_columns([spreadsheet_text(name) for name in table.column_names])


def _empty_for_nan(table: pa.Table) -> pa.Table:
    for index, field in enumerate(table.schema):
        if pa.types.is_floating(field.type):
            # pyarrow.compute would take 40 ms to import.
            cells = pa.array(table.column(index).to_numpy(), type=field.type, from_pandas=True)
            table = table.set_column(index, field.name, cells)
    return table
