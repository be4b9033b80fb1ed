"""Reads height maps: ESRI ASCII grids (``.asc``), and grey PNG images of 8 or 16 bits with a stated cell and height.

The first row of both is the one with the largest y. Each cell is a point at its middle.
"""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.terrain_meshes.clouds import MAX_CLOUD_BYTES, MAX_POINTS, checked_points, refuse_terrain
from stridelab.contacts.terrain_meshes.reading import SHOWN_NAME
from stridelab.conventions import Points
from stridelab.errors import Fault, UnreadableFile

HEIGHT_MAP_FORMATS: Final = (".asc", ".png")
HEADER_WORDS: Final = ("ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "nodata_value")
GREY: Final = ("L", "I;16", "I;16B", "I;16L", "I")
WHITE: Final = (65_535, 255)
"""Value of white with 16 and with 8 bits."""
Heights = Float[np.ndarray, "rows columns"]


def read_ascii_grid(path: Path, *, metres_per_unit: float = 1.0) -> Points:
    """Points of an ESRI ASCII grid in metres; cells without data are left out.

    Raises ``UnreadableFile`` (``terrain-file-unreadable``).
    """
    if path.stat().st_size > MAX_CLOUD_BYTES:
        raise refuse_terrain(path, f"It has more than {MAX_CLOUD_BYTES // 1_000_000} MB.")
    head: dict[str, float] = {}
    try:
        with path.open(encoding="latin-1") as file:
            while True:
                position = file.tell()
                words = file.readline(1_000).split()
                if len(words) != 2 or words[0].lower() not in HEADER_WORDS:
                    file.seek(position)
                    break
                head[words[0].lower()] = float(words[1])
            rows, columns, cell = int(head["nrows"]), int(head["ncols"]), head["cellsize"]
            if not (0 < rows * columns <= MAX_POINTS and rows > 0 and cell > 0.0):
                raise refuse_terrain(path, f"It states {rows} by {columns} cells of {cell:g}; at most {MAX_POINTS}.")
            values = np.array(file.read().split(), float)
    except (ValueError, OverflowError) as error:
        raise refuse_terrain(path, "A value of it is no number.") from error
    except KeyError as error:
        raise refuse_terrain(path, f"Its header does not state {error.args[0]}.") from error
    if len(values) != rows * columns:
        raise refuse_terrain(path, f"It has {len(values)} values; its header states {rows} by {columns}.")
    values[values == head.get("nodata_value", -9999.0)] = np.nan
    half = 0.5 * cell
    low = [head.get(f"{axis}llcenter", head.get(f"{axis}llcorner", 0.0) + half) for axis in "xy"]
    return checked_points(path, _points_of(values.reshape(rows, columns), cell, low), metres_per_unit, "+z")


def read_height_image(
    path: Path, *, cell_m: float | None, height_m: float | None = None, height_range_m: float | None = None
) -> Points:
    """Points of a grey image: cells of ``cell_m``, centred at the origin.

    Heights are ``height_m`` for each step of grey, or ``height_range_m`` from black to white.

    Raises ``UnreadableFile`` (``terrain-file-unreadable``), also if the cell or the height is not stated.
    """
    missing = [
        Fault(name, f"missing: {text}")
        for name, text, is_stated in (
            ("cell_m", "the edge of a cell of the image, in metres", _is_length(cell_m)),
            ("height_range_m", "the height from black to white, in metres", _is_length(height_m or height_range_m)),
        )
        if not is_stated
    ]
    if missing or cell_m is None:
        text = "An image needs the edge of its cells and the height from black to white, in metres"
        names = " and ".join(fault.where for fault in missing)
        message = f"The file of the terrain cannot be used. {text}: state {names}."
        faults = [Fault(path.name[:SHOWN_NAME], "cannot be used"), *missing]
        raise UnreadableFile("terrain-file-unreadable", message, faults)
    from PIL import Image

    try:
        with Image.open(path, formats=["PNG"]) as image:
            if image.width * image.height > MAX_POINTS:
                raise refuse_terrain(path, f"It has {image.width} by {image.height} cells; at most {MAX_POINTS}.")
            if image.mode not in GREY:
                raise refuse_terrain(path, f"It is not a grey image of 8 or 16 bits, but of mode {image.mode}.")
            values = np.array(image, float)
            steps = WHITE[image.mode == "L"]
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise refuse_terrain(path, "It is damaged, or no PNG image.") from error
    low = [-0.5 * cell_m * (n - 1) for n in (values.shape[1], values.shape[0])]
    step_m = height_m if height_m is not None else (height_range_m or 0.0) / steps
    return checked_points(path, _points_of(values * step_m, cell_m, low), 1.0, "+z")


def _is_length(value: float | None) -> bool:
    return value is not None and 0.0 < value < np.inf


def _points_of(heights: Heights, cell: float, low: list[float]) -> Points:
    rows, columns = heights.shape
    x, y = np.meshgrid(low[0] + cell * np.arange(columns), low[1] + cell * np.arange(rows)[::-1])
    return np.column_stack([x.ravel(), y.ravel(), heights.ravel()])
