"""A walk whose markers, forces and centre of mass are known functions of time, and the files that would hold them."""

import io
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

RATE_HZ, DURATION_S = 100.0, 3.0
WINDOW_S = (0.6, 2.4)
LABELS = ("LASI", "RASI", "LKNE", "RKNE", "LANK", "RANK", "LHEE", "RHEE", "C7")
LANDMARKS = {
    "l_asis": "LASI", "r_asis": "RASI", "l_knee_lateral": "LKNE", "r_knee_lateral": "RKNE",
    "l_ankle_lateral": "LANK", "r_ankle_lateral": "RANK", "l_heel": "LHEE", "r_heel": "RHEE", "c7": "C7",
}  # fmt: skip
_PLACE = {"LASI": (0.1, 0.12, 1.0), "RASI": (0.1, -0.12, 1.0), "LKNE": (0.05, 0.1, 0.5), "RKNE": (0.05, -0.1, 0.5),
          "LANK": (0.0, 0.1, 0.1), "RANK": (0.0, -0.1, 0.1), "LHEE": (-0.06, 0.1, 0.04), "RHEE": (-0.06, -0.1, 0.04),
          "C7": (-0.05, 0.0, 1.45)}  # fmt: skip


def marker_m(label: str, time_s: np.ndarray) -> np.ndarray:
    """Track of a marker, shape ``(n, 3)``."""
    swing = 0.25 * np.sin(2 * np.pi * time_s + (0 if label.startswith("L") else np.pi)) * (label[1:] in ("ANK", "HEE"))
    x, y, z = _PLACE[label]
    ones = np.ones_like(time_s)
    return np.column_stack([x + 1.1 * time_s + swing, y * ones, z + 0.02 * np.cos(4 * np.pi * time_s)])


def com_m(time_s: np.ndarray) -> np.ndarray:
    """Track of the centre of mass, shape ``(n, 3)``."""
    return np.column_stack(
        [0.05 + 1.1 * time_s, 0.02 * np.sin(2 * np.pi * time_s), 0.95 + 0.02 * np.cos(4 * np.pi * time_s)]
    )


def _parquet(columns: dict[str, Any]) -> bytes:
    sink = io.BytesIO()
    pq.write_table(pa.table(columns), sink)
    return sink.getvalue()


def tracks_parquet() -> bytes:
    """Markers and two plates; C7 is hidden for the last 50 frames."""
    t = np.arange(int(RATE_HZ * DURATION_S)) / RATE_HZ
    columns: dict[str, Any] = {"time_s": t}
    for label in LABELS:
        track = marker_m(label, t)
        if label == "C7":
            track[-50:] = np.nan
        columns |= {f"{label}_{axis}_m": track[:, k] for k, axis in enumerate("xyz")}
    for index, (start, end, place_x) in enumerate([(0.6, 1.6, 1.2), (1.4, 2.4, 2.0)], start=1):
        loaded = (t >= start) & (t <= end)
        up = np.where(loaded, 700 * np.sin(np.pi * np.clip((t - start) / (end - start), 0, 1)), 0.0)
        columns |= {f"plate{index}_fx_n": 0.1 * up, f"plate{index}_fy_n": 0.02 * up, f"plate{index}_fz_n": up}
        columns |= {
            f"plate{index}_copx_m": np.where(up > 20, place_x + 0.05 * t, np.nan),
            f"plate{index}_copy_m": np.where(up > 20, 0.1 if index == 1 else -0.1, np.nan),
            f"plate{index}_copz_m": np.where(up > 20, 0.0, np.nan),
        }
    return _parquet(columns)


SD_M = (0.004, 0.006, 0.012)
"""Standard deviations of the estimate along x, y and z."""


def com_parquet() -> bytes:
    """Result of an estimate: fused is the truth, geometry is off by 1 cm along every axis; the central axis runs
    through the truth, so its point nearest to the geometry is that offset's share along the force away."""
    t = np.arange(int(RATE_HZ * WINDOW_S[0]), int(RATE_HZ * WINDOW_S[1])) / RATE_HZ
    com = com_m(t)
    v = np.gradient(com, t, axis=0)
    a = np.gradient(v, t, axis=0)
    force = 60 * (a - np.array([0.0, 0.0, -9.81]))
    along = force / np.linalg.norm(force, axis=1, keepdims=True)
    on_axis = com + 0.01 * along.sum(axis=1, keepdims=True) * along
    columns: dict[str, Any] = {"time_s": t}
    for k, axis in enumerate("xyz"):
        columns |= {
            f"{axis}_m": com[:, k], f"v{axis}_m_s": v[:, k], f"a{axis}_m_s2": a[:, k],
            f"sd_{axis}_m": np.full_like(t, SD_M[k]), f"geometry_{axis}_m": com[:, k] + 0.01,
            f"force_{axis}_n": force[:, k], f"axis_{axis}_m": on_axis[:, k],
        }  # fmt: skip
    return _parquet(columns)


SUMMARY = {
    "window_s": list(WINDOW_S), "rate_hz": 100.0, "method": "complementary", "segment_table": "dumas2007-female",
    "mass_kg": 60.25, "latency_s": 0.0113, "latency_sd_s": 0.0012, "latency_applied_s": 0.0,
    "latency_along_s": 0.0197,
    "rms_force_residual_n": [3.21, 2.5, 7.75], "bias_m": [0.0012, -0.0034, 0.0056],
    "observability": {"rank": 5, "observable": True, "sentence": "The height is known from the markers alone."},
    "diagnostics": {"marker_mm": 0.336, "momentum_about_walk_nms": 0.62},
    "warnings": [{"code": "arms-missing", "message": "Arms have no markers; they are taken to hang."}],
}  # fmt: skip


def corners(x: float, y: float) -> list[list[float]]:
    """Corners of a force plate around (x, y), in m."""
    return [[x + a, y + b, 0.0] for a, b in ((0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2), (0.25, -0.2))]
