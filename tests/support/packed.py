"""What static/js/packed.js does, with numpy."""

from typing import Any

import numpy as np


def unpack(packed: bytes, layout: dict[str, Any]) -> np.ndarray:
    """``frames.bin`` as float32 ``(frames, width)``."""
    n, width = layout["n_frames"], layout["width"]
    planes = np.frombuffer(packed, np.uint8).reshape(5, width, n).astype(np.int64)
    unsigned = sum(planes[1 + k] << (8 * k) for k in range(4))
    bend = (unsigned >> 1) ^ -(unsigned & 1)
    whole = bend.cumsum(axis=1).cumsum(axis=1)
    values = whole * 2.0 ** -np.array(layout["bits"])[:, None]
    return np.where(planes[0] == 1, np.nan, values).T.astype(np.float32)
