"""A recorded walk and its wheels as the interface gives them, known functions of time.

A walk whose markers, forces and centre of mass are known functions of time, and the files that would hold them.

The wheel of the fake walk as the interface gives it: two steps on exact cycloids, with known residuals.
"""

import io
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from stridelab.schemas.base import Remark
from stridelab.schemas.cycloid import FitCycloidSummary, FittedStep, Rival, StepScatter, TimedWheel, Wheel, WheelSd
from stridelab.schemas.jobs import Artifact, JobResult

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


KIND = "fit-cycloid"
WHEEL_RATE_HZ = 100.0
STEPS_S = ((0.6, 1.2), (1.2, 1.8))
WHEELS = ((0.105, 0.0150, 0.940, 11.0, -3.2), (0.112, 0.0172, 0.944, 11.4, -3.4))
"""R, r, z0 in metres, omega in rad/s and theta0 in rad."""
RESIDUAL_M = (0.0006, -0.0004)
"""Model minus measurement: a wave of this height ahead, and this constant up."""
START_X_M, SIDE_Y_M = 0.7, 0.1


def theta_rad(k: int, time_s: np.ndarray) -> np.ndarray:
    """Angle of step ``k``: a line with a wave on it."""
    *_, omega, theta0 = WHEELS[k]
    t = time_s - STEPS_S[k][0]
    return theta0 + omega * t + 0.1 * np.sin(omega * t)


def samples(k: int) -> dict[str, np.ndarray]:
    """Rows of ``wheel.parquet`` of step ``k``; the walk goes along y, so that ahead and x are not mixed up."""
    R, r, z0, *_ = WHEELS[k]
    start, end = STEPS_S[k]
    t = np.arange(round(start * WHEEL_RATE_HZ), round(end * WHEEL_RATE_HZ) + (k == len(STEPS_S) - 1)) / WHEEL_RATE_HZ
    theta = theta_rad(k, t)
    hub = START_X_M + 0.66 * k + R * (theta - theta[0])
    model_x, model_z = hub - r * np.sin(theta), z0 - r * np.cos(theta)
    error_x, error_z = RESIDUAL_M[0] * np.sin(9 * t), np.full_like(t, RESIDUAL_M[1])
    ahead, up = model_x - error_x, model_z - error_z
    side = np.full_like(t, SIDE_Y_M)
    return {
        "time_s": t, "step": np.full(len(t), k), "x_ahead_m": ahead, "z_m": up, "theta_rad": theta,
        "hub_x_m": hub, "hub_z_m": np.full_like(t, z0), "model_x_m": model_x, "model_z_m": model_z,
        "error_x_m": error_x, "error_z_m": error_z, "x_m": side, "y_m": ahead,
        "hub_world_x_m": side, "hub_world_y_m": hub,
    }  # fmt: skip


def wheel_parquet() -> bytes:
    """All steps, one after the other."""
    parts = [samples(k) for k in range(len(STEPS_S))]
    sink = io.BytesIO()
    pq.write_table(pa.table({name: np.concatenate([part[name] for part in parts]) for name in parts[0]}), sink)
    return sink.getvalue()


def summary() -> FitCycloidSummary:
    """Two steps; the second has flags, no length, and the start of double support is not to be had by the rule."""
    return FitCycloidSummary(
        window_s=(0.6, 1.8), rate_hz=WHEEL_RATE_HZ, method="smoother", segment_table="dumas2007-female", mass_kg=60.0,
        latency_s=0.012, latency_applied_s=0.012, ahead=(0.0, 1.0),
        steps=[_step(0), _step(1).model_copy(update=_POOR)], overlapping=[],
        step_to_step_sd=StepScatter(R_m=0.0049, r_m=0.0016, z0_m=0.0028, omega_rad_s=0.28, n=2, between="steps"),
        steps_left_out=1, warnings=[Remark(code="one-plate-step", message="The second step is timed by markers.")],
    )  # fmt: skip


def result(given: dict[str, Any]) -> JobResult:
    """The result of a succeeded fit."""
    artifacts = [
        Artifact(name=name, media_type="application/x", bytes=1234)
        for name in ("steps.parquet", "steps.csv", "wheel.parquet", "wheel.csv")
    ]
    return JobResult(
        kind=KIND,
        input=given,
        versions={"stridelab": "0.1.0"},
        references=[],
        summary=summary().model_dump(mode="json"),
        artifacts=artifacts,
    )


_POOR: dict[str, Any] = {
    "side": "right", "source": "markers", "flags": ["timed-omega-low", "r-too-large"], "step_length_m": None,
    "circumference_share": None, "double_support_model_s": (None, 1.75),
}  # fmt: skip


def _step(k: int) -> FittedStep:
    R, r, z0, omega, theta0 = WHEELS[k]
    start, end = STEPS_S[k]
    timed = {
        "R_m": R, "r_m": 0.8 * r, "z0_m": z0, "omega_rad_s": omega, "theta0_rad": theta0,
        "error_mean_mm": 7.2, "error_max_mm": 14.0, "bounds": [],
    }  # fmt: skip
    return FittedStep(
        t0_s=start, t1_s=end, fitted_s=(start + 0.04 * k, end), side="left", source="plates", measured=True, R_m=R,
        r_m=r, z0_m=z0, omega_rad_s=omega,
        theta0_rad=theta0, sd=WheelSd(R_m=0.0011, r_m=0.0002, z0_m=0.0003), error_mean_mm=0.52 + k, error_sd_mm=0.2,
        error_max_mm=0.72 + k, theta_off_line_rad=0.07, double_support_s=(start + 0.45, end),
        double_support_model_s=(start + 0.38, end + 0.03), period_s=0.6, step_length_m=0.66, speed_m_s=1.1,
        circumference_share=1.0 + k / 10,
        reversed=Wheel(R_m=0.101, r_m=0.0144, z0_m=0.939, omega_rad_s=11.2, theta0_rad=-0.1, error_mean_mm=0.61,
                       error_max_mm=0.9, converged=True),
        timed=TimedWheel.model_validate(timed),
        reversed_timed=TimedWheel.model_validate({**timed, "error_mean_mm": 4.3}),
        rivals=[
            _rival("path", "sinusoid", 4, 0.81, 0.95, -101.0), _rival("path", "two-harmonics", 6, 0.29, 0.61, -112.5),
            _rival("path", "pendulum-arcs", 9, 1.86, 2.4, -70.0),
            _rival("path", "wheel", 4, 0.77, 0.58, -99.0 - 20 * k),
            _rival("path", "wheel-reversed", 4, 0.8, 0.97, -98.0),
            _rival("time", "one-harmonic", 8, 1.1, 1.3, -150.0), _rival("time", "two-harmonics", 12, 0.5, 0.7, -190.0),
            _rival("time", "wheel", 6, 7.2, 8.0, -120.0), _rival("time", "wheel-reversed", 6, 4.3, 5.0, -130.0),
        ],
        flags=[],
    )  # fmt: skip


def _rival(space: str, model: str, parameters: int, rms_mm: float, held_out_mm: float, aic: float) -> Rival:
    fields = {"space": space, "model": model, "parameters": parameters}
    return Rival.model_validate({**fields, "rms_mm": rms_mm, "held_out_mm": held_out_mm, "aic": aic})
