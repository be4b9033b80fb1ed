"""Encoding of frames for the browser: quantised columns as second differences, which compresses tenfold.

The second differences of smooth motions are small. Values are rounded to multiples of a step, differenced twice along
each column, mapped to unsigned integers (0, -1, 1, -2, ... become 0, 1, 2, 3, ...) and split into four byte planes.
Before these, one byte per value marks missing ones. The result is meant to be compressed.
static/js/viewer/frame_decoder.js decodes it.
"""

from typing import Final

import numpy as np

POINT_BITS: Final = 20
"""Points are rounded to 2^-20 m, about a micrometre."""
SIZE_BITS: Final = 28
"""Semi-axes of a millimetre have five digits."""
POSE_BITS: Final = 16
"""Errors: at most 8 micrometres in positions of bodies, 8e-6 in components of quaternions."""
FORCE_BITS: Final = 11
"""Error: at most a quarter of a millinewton."""
MAX_BITS: Final = 28
"""Integers of this length have second differences of 31 bits, and exceed the precision of a float32."""


def fit_bits(values: np.ndarray, bits: np.ndarray) -> np.ndarray:
    """``bits`` ``(width,)``, reduced in columns of ``values`` ``(n, width)`` with too large numbers."""
    largest = np.abs(np.where(np.isfinite(values), values, 0.0)).max(axis=0, initial=1.0)
    return np.asarray(np.minimum(bits, MAX_BITS - np.ceil(np.log2(largest)).astype(int)))


def pack_columns(values: np.ndarray, bits: np.ndarray) -> bytes:
    """``values`` ``(n, width)`` in steps of ``2 ** -bits`` ``(width,)``, column after column."""
    present = np.isfinite(values)
    steps = np.round(np.where(present, values, 0.0).astype(float) * 2.0**bits)
    columns = _fill_missing(steps, present).T.astype(np.int64)
    bend = np.diff(columns, n=2, axis=1, prepend=np.zeros((len(columns), 2), dtype=np.int64))
    unsigned = ((bend << 1) ^ (bend >> 63)).astype("<u4")
    planes = np.ascontiguousarray(unsigned).view(np.uint8).reshape(-1, 4).T
    absent: bytes = (~present).T.astype(np.uint8).tobytes()
    return absent + planes.tobytes()


def continuous_signs(quaternions: np.ndarray) -> np.ndarray:
    """The same rotations ``(n, 4)`` with continuous signs; q and -q are the same rotation."""
    flips = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]) < 0
    sign = np.where(np.cumsum(flips) % 2 == 0, 1.0, -1.0)
    return np.concatenate([quaternions[:1], sign[:, None] * quaternions[1:]])


def _fill_missing(steps: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Replace missing values by the previous one, so that their differences are zero."""
    last = np.maximum.accumulate(np.where(present, np.arange(len(steps))[:, None], 0), axis=0)
    return np.take_along_axis(steps, last, axis=0)
