"""The files of ``fit-cycloid``: ``steps`` (one row per step) and ``wheel`` (one per sample of a step)."""

from pathlib import Path

import numpy as np

from stridelab.conventions import Points, Vector3
from stridelab.estimation.estimator import ComEstimate
from stridelab.pipelines.fit_cycloid import CycloidResult
from stridelab.schemas.cycloid import FitCycloidSummary
from stridelab.schemas.tasks import RecordingSource
from stridelab.service.kinds.base import ArtifactFile
from stridelab.service.kinds.result_tables import write_table
from stridelab.walking.step_fit import StepFit

STEP_FIELDS = (
    *("t0_s", "t1_s", "R_m", "r_m", "z0_m", "omega_rad_s", "theta0_rad", "error_mean_mm", "error_sd_mm"),
    *("error_max_mm", "theta_off_line_rad", "period_s", "step_length_m", "speed_m_s", "circumference_share"),
)
"""Columns of ``steps`` that are fields of a step of the summary."""


def write_cycloid(folder: Path, source: RecordingSource, result: CycloidResult) -> tuple[ArtifactFile, ...]:
    """Write both tables as Parquet and CSV into ``folder``."""
    provenance = {
        "file": source.filename,
        "frame": "world, z up; ahead is along the walk",
        "summary": result.summary.model_dump(mode="json"),
    }
    tables = {"steps": step_columns(result.summary), "wheel": wheel_columns(result)}
    return tuple(file for stem, columns in tables.items() for file in write_table(folder, stem, columns, provenance))


def step_columns(summary: FitCycloidSummary) -> dict[str, np.ndarray]:
    """One row per step, as in the summary; missing values are NaN."""
    steps = summary.steps
    columns: dict[str, np.ndarray] = {
        "step": np.arange(len(steps)),
        "side": np.array([step.side for step in steps]),
        "source": np.array([step.source for step in steps]),
        "measured": np.array([step.measured for step in steps], dtype=bool),
    }
    columns |= {name: _number_column([getattr(step, name) for step in steps]) for name in STEP_FIELDS}
    for name in ("R_m", "r_m", "z0_m"):
        columns[f"sd_{name}"] = _number_column([getattr(step.sd, name) for step in steps])
        columns[f"reversed_{name}"] = _number_column([getattr(step.reversed, name) for step in steps])
    for name in ("double_support", "double_support_model"):
        for end, edge in enumerate(("start", "end")):
            columns[f"{name}_{edge}_s"] = _number_column([getattr(step, f"{name}_s")[end] for step in steps])
    columns["flags"] = np.array([" ".join(sorted(step.flags)) for step in steps])
    return columns


def wheel_columns(result: CycloidResult) -> dict[str, np.ndarray]:
    """Measured and modelled path of every step in the plane of progression, and its position in the laboratory."""
    parts = [_step_samples(result, k, fit) for k, fit in enumerate(result.fits)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _step_samples(result: CycloidResult, k: int, fit: StepFit) -> dict[str, np.ndarray]:
    wheel, theta, t = fit.path.wheel, fit.path.theta_rad, fit.time_s
    hub, model = wheel.hub_m(theta), wheel.position_m(theta)
    com = in_laboratory_m(result.estimate, result.floor_m_s, t)
    forward = result.ahead * [1.0, 1.0, 0.0] / np.linalg.norm(result.ahead[:2])
    hub_world = com + (hub[:, 0] - fit.path_m[:, 0])[:, None] * forward
    return {
        "time_s": t,
        "step": np.full(len(t), k),
        "x_ahead_m": fit.path_m[:, 0],
        "z_m": fit.path_m[:, 1],
        "theta_rad": theta,
        "hub_x_m": hub[:, 0],
        "hub_z_m": hub[:, 1],
        "model_x_m": model[:, 0],
        "model_z_m": model[:, 1],
        "error_x_m": fit.path.error_m[:, 0],
        "error_z_m": fit.path.error_m[:, 1],
        "x_m": com[:, 0],
        "y_m": com[:, 1],
        "hub_world_x_m": hub_world[:, 0],
        "hub_world_y_m": hub_world[:, 1],
    }


def in_laboratory_m(estimate: ComEstimate, floor_m_s: Vector3, time_s: np.ndarray) -> Points:
    """The estimate at its samples ``time_s`` in laboratory coordinates: the motion of the belt is added."""
    first = int(np.argmin(np.abs(estimate.time_s - time_s[0])))
    return np.asarray(estimate.com_m[first : first + len(time_s)] + floor_m_s * time_s[:, None])


def _number_column(values: list[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in values], dtype=float)
