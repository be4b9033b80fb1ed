"""What static/js/viewer/frame_decoder.js does, with numpy."""

import json
from typing import Any

import numpy as np


def read_frames(file: bytes) -> tuple[dict[str, Any], np.ndarray]:
    """Layout and numbers of ``frames.bin``."""
    end = 4 + int.from_bytes(file[:4], "little")
    layout: dict[str, Any] = json.loads(file[4:end])
    return layout, unpack(file[end:], layout)


def unpack(packed: bytes, layout: dict[str, Any]) -> np.ndarray:
    """The numbers as float32 ``(frames, width)``."""
    n, width = layout["n_frames"], layout["width"]
    planes = np.frombuffer(packed, np.uint8).reshape(5, width, n).astype(np.int64)
    unsigned = sum(planes[1 + k] << (8 * k) for k in range(4))
    bend = (unsigned >> 1) ^ -(unsigned & 1)
    whole = bend.cumsum(axis=1).cumsum(axis=1)
    values = whole * 2.0 ** -np.array(layout["bits"])[:, None]
    return np.where(planes[0] == 1, np.nan, values).T.astype(np.float32)
