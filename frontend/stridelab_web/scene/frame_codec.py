"""Frames on their way to the browser: whole multiples of a step, told as how they bend, which compresses tenfold.

Along each column the second difference of what moves smoothly is small. So the numbers are sent as second differences
of whole numbers, without sign (0, -1, 1, -2, ... are 0, 1, 2, 3, ...), the four bytes of all of them apart from one
another; before them one byte each says where there is nothing. The result is meant to be compressed.
static/js/viewer/frame_decoder.js reads it.
"""

from typing import Final

import numpy as np

POINT_BITS: Final = 20
"""Points are within half of 2^-20 m, a micrometre, of their file."""
SIZE_BITS: Final = 28
"""Semi-axes of a millimetre keep five digits."""
POSE_BITS: Final = 16
"""Positions of bodies within 8 micrometres, the parts of quaternions within 8e-6."""
FORCE_BITS: Final = 11
"""Forces within a quarter of a millinewton."""
LARGEST_BITS: Final = 28
"""Whole numbers so long have second differences of 31 bits, and are longer than those of a float32."""


def fitting(values: np.ndarray, bits: np.ndarray) -> np.ndarray:
    """``bits`` ``(width,)``, fewer in columns of ``values`` ``(n, width)`` that hold a number too large for them."""
    largest = np.abs(np.where(np.isfinite(values), values, 0.0)).max(axis=0, initial=1.0)
    return np.asarray(np.minimum(bits, LARGEST_BITS - np.ceil(np.log2(largest)).astype(int)))


def pack(values: np.ndarray, bits: np.ndarray) -> bytes:
    """``values`` ``(n, width)`` in steps of ``2 ** -bits`` ``(width,)``, column after column; ``bits`` are fitting."""
    there = np.isfinite(values)
    steps = np.round(np.where(there, values, 0.0).astype(float) * 2.0**bits)
    columns = _held(steps, there).T.astype(np.int64)
    bend = np.diff(columns, n=2, axis=1, prepend=np.zeros((len(columns), 2), dtype=np.int64))
    unsigned = ((bend << 1) ^ (bend >> 63)).astype("<u4")
    planes = np.ascontiguousarray(unsigned).view(np.uint8).reshape(-1, 4).T
    absent: bytes = (~there).T.astype(np.uint8).tobytes()
    return absent + planes.tobytes()


def unbroken(quaternions: np.ndarray) -> np.ndarray:
    """The same turns ``(n, 4)`` with the signs that make each nearest to the one before; q and -q are one turn."""
    flips = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]) < 0
    sign = np.where(np.cumsum(flips) % 2 == 0, 1.0, -1.0)
    return np.concatenate([quaternions[:1], sign[:, None] * quaternions[1:]])


def _held(steps: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Where there is nothing, the number that was there last, so that no difference is told."""
    last = np.maximum.accumulate(np.where(there, np.arange(len(steps))[:, None], 0), axis=0)
    return np.take_along_axis(steps, last, axis=0)
