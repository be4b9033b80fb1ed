"""Reads clouds of points: PLY without faces, text (``.xyz``, ``.pts``, ``.csv``), and PCD (text, or binary).

A stranger's bytes are parsed here: call it in a process with limits.
"""

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import IO, Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.terrain_meshes.reading import EXTENT_M, SHOWN_NAME, UP_AXES, UpAxis, describe_extent
from stridelab.conventions import Points
from stridelab.errors import Fault, UnreadableFile

CLOUD_FORMATS: Final = (".xyz", ".pts", ".csv", ".pcd")
MAX_CLOUD_BYTES: Final = 200_000_000
MAX_POINTS: Final = 6_000_000
LEAST_POINTS: Final = 100
HEADER_LINES: Final = 200
PLY_TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
KnownPoints = Float[np.ndarray, "k 3"]
NUMBER: Final = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|nan|NaN")


def read_cloud(path: Path, *, metres_per_unit: float = 1.0, up: UpAxis | None = None) -> Points:
    """Points in metres with z up; those without coordinates are left out.

    Raises ``UnreadableFile`` (``terrain-file-unreadable``) for a damaged, empty or too large file, for a compressed
    PCD, and for an extent that no terrain has.
    """
    if path.stat().st_size > MAX_CLOUD_BYTES:
        raise refuse_terrain(path, f"It has more than {MAX_CLOUD_BYTES // 1_000_000} MB.")
    try:
        with path.open("rb") as file:
            ending = path.suffix.lower()
            points = (
                _read_pcd(path, file)
                if ending == ".pcd"
                else _read_ply(path, file)
                if ending == ".ply"
                else _read_text(path)
            )
    except (ValueError, KeyError, IndexError, TypeError, OverflowError, StopIteration) as error:
        raise refuse_terrain(path, "It is damaged, or its content does not match its name.") from error
    return checked_points(path, points, metres_per_unit, up)


def checked_points(path: Path, points: Points, metres_per_unit: float, up: UpAxis | None) -> KnownPoints:
    """The points in metres with z up. Raises ``UnreadableFile`` for too few, too many, or a wrong unit."""
    if len(points) > MAX_POINTS:
        raise refuse_terrain(path, f"It has {len(points)} points; at most {MAX_POINTS} are read.")
    known = np.isfinite(points).all(axis=1)
    if known.sum() < LEAST_POINTS:
        missing = len(points) - int(known.sum())
        text = f"It has {int(known.sum())} points with coordinates, and {missing} without; {LEAST_POINTS} are needed."
        raise refuse_terrain(path, text)
    points_m = np.asarray(points[known] * metres_per_unit @ UP_AXES[up or "+z"].T)
    low, high = np.quantile(points_m[:, :2], [0.001, 0.999], axis=0)
    extent_m = float((high - low).max())
    if not EXTENT_M[0] <= extent_m <= EXTENT_M[1]:
        raise refuse_terrain(path, describe_extent(extent_m, metres_per_unit))
    return points_m


def has_faces(path: Path) -> bool:
    """Whether the header of a PLY file states faces."""
    with path.open("rb") as file:
        head = [line.split() for line in _header_lines(file, b"end_header")]
    return any(words[:2] == ["element", "face"] and words[-1] != "0" for words in head)


def _header_lines(file: IO[bytes], last: bytes) -> Iterator[str]:
    """Lines of a header up to the one that begins with ``last``."""
    for line in islice(iter(lambda: file.readline(10_000), b""), HEADER_LINES):
        yield line.decode("latin-1").strip()
        if line.strip().startswith(last):
            return


def _read_ply(path: Path, file: IO[bytes]) -> Points:
    """Vertices of a PLY file, text or binary, of which they are the first element."""
    kind, count, fields, element = "", 0, [], ""
    for line in _header_lines(file, b"end_header"):
        words = line.split()
        if words[:1] == ["format"]:
            kind = words[1]
        elif words[:1] == ["element"]:
            if element == "" and words[1] != "vertex":
                raise refuse_terrain(path, "Its first element is not that of the vertices.")
            element = words[1]
            count = int(words[2]) if element == "vertex" else count
        elif words[:1] == ["property"] and element == "vertex":
            fields.append((words[2], PLY_TYPES[words[1]]))
    _limit_count(path, count)
    if kind == "ascii":
        columns = [[name for name, _ in fields].index(axis) for axis in "xyz"]
        text = (line.decode("latin-1") for line in islice(file, count))
        return _columns_of(text, columns, None)
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}[kind]
    return _read_records(path, file, np.dtype([(name, order + form) for name, form in fields]), count)


def _read_records(path: Path, file: IO[bytes], record: np.dtype[np.void], count: int) -> Points:
    """Coordinates of binary records."""
    content = file.read(count * record.itemsize)
    if len(content) < count * record.itemsize:
        raise refuse_terrain(path, f"It ends after {len(content) // max(record.itemsize, 1)} of {count} points.")
    values = np.frombuffer(content, record, count)
    return np.column_stack([values[axis].astype(float) for axis in "xyz"])


def _read_pcd(path: Path, file: IO[bytes]) -> Points:
    """Points of a PCD file, text or binary without compression."""
    head = {words[0].upper(): words[1:] for line in _header_lines(file, b"DATA") if (words := line.split())}
    kind = head["DATA"][0]
    if kind == "binary_compressed":
        text = "It is compressed (DATA binary_compressed); save it as binary, or convert it to PLY."
        raise refuse_terrain(path, text)
    count = int(head["POINTS"][0]) if "POINTS" in head else int(head["WIDTH"][0]) * int(head.get("HEIGHT", ["1"])[0])
    _limit_count(path, count)
    names, sizes, forms = head["FIELDS"], head["SIZE"], head["TYPE"]
    repeats = [int(n) for n in head.get("COUNT", ["1"] * len(names))]
    if kind == "ascii":
        starts = np.cumsum([0, *repeats])
        text_lines = (line.decode("latin-1") for line in islice(file, count))
        return _columns_of(text_lines, [int(starts[names.index(axis)]) for axis in "xyz"], None)
    if kind != "binary":
        raise refuse_terrain(path, f"Its data are {kind[:20]}, neither ascii nor binary.")
    letters = {"F": "f", "I": "i", "U": "u"}
    fields = [
        (name if name in "xyz" else f"other{k}", f"<{letters[form]}{int(size)}", (n,) if n > 1 else ())
        for k, (name, form, size, n) in enumerate(zip(names, forms, sizes, repeats, strict=True))
    ]
    return _read_records(path, file, np.dtype(fields), count)


def _limit_count(path: Path, count: int) -> None:
    if not 0 <= count <= MAX_POINTS:
        raise refuse_terrain(path, f"It states {count} points; at most {MAX_POINTS} are read.")


def _read_text(path: Path) -> Points:
    """Rows of numbers, of which the first three, or those named x, y and z, are coordinates."""
    columns, delimiter, skipped = [0, 1, 2], None, 0
    with path.open(encoding="latin-1") as file:
        for line in islice(file, HEADER_LINES):
            delimiter = next((one for one in (";", ",") if one in line), None)
            words = [word.strip().strip('"') for word in line.lstrip("#/ \t").strip().split(delimiter)]
            if len(words) >= 3 and all(NUMBER.fullmatch(word) for word in words[:3]) and line.lstrip()[:1] not in "#/":
                break
            lower = [word.lower() for word in words]
            if all(axis in lower for axis in "xyz"):
                columns = [lower.index(axis) for axis in "xyz"]
            elif len(words) > 1 and line.lstrip()[:1] not in ("#", "/"):
                raise refuse_terrain(path, f"Line {skipped + 1} is neither numbers nor names of x, y and z.")
            skipped += 1
        else:
            raise refuse_terrain(path, "It has no row of three numbers.")
    with path.open(encoding="latin-1") as file:
        return _columns_of(islice(file, skipped, skipped + MAX_POINTS + 1), columns, delimiter)


def _columns_of(lines: Iterator[str], columns: list[int], delimiter: str | None) -> Points:
    rows = np.loadtxt(lines, usecols=columns, delimiter=delimiter, ndmin=2, comments=("#", "//"))
    return rows.reshape(-1, 3)


def refuse_terrain(path: Path, reason: str) -> UnreadableFile:
    """The error of a file of a terrain that cannot be used, and why."""
    message = f"The file of the terrain cannot be used. {reason}"
    return UnreadableFile("terrain-file-unreadable", message, [Fault(path.name[:SHOWN_NAME], "cannot be used")])
