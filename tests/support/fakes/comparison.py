"""A comparison as the interface gives it: three estimators whose errors are known functions, with or without truth."""

import io
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from stridelab.schemas.base import Remark
from stridelab.schemas.comparison import (
    Axes,
    CompareEstimatorsSummary,
    ErrorAgainstTruth,
    MethodAssessment,
    MomentumRateAgreement,
)
from stridelab.schemas.jobs import Artifact, JobResult

KIND = "compare-estimators"
RATE_HZ, WINDOW_S = 100.0, (0.5, 1.5)
OFFSETS_M = {
    "kalman-thesis": (0.012, -0.004, 0.003),
    "smoother": (0.001, 0.002, 0.003),
    "geometry": (0.006, 0.0, 0.004),
}
"""Constant error of each method along x, y and z, in no order that a page would choose."""


def truth_m(time_s: np.ndarray) -> np.ndarray:
    """True centre of mass, shape ``(n, 3)``."""
    return np.column_stack([1.2 * time_s, 0.02 * np.sin(5 * time_s), 0.95 + 0.02 * np.cos(11 * time_s)])


def summary(*, with_truth: bool) -> CompareEstimatorsSummary:
    """What the tables show."""
    return CompareEstimatorsSummary(
        window_s=WINDOW_S, rate_hz=RATE_HZ, segment_table="carried", mass_kg=60.0, latency_s=0.012, latency_sd_s=0.002,
        latency_applied_s=0.012, reference="truth" if with_truth else "geometry",
        methods={name: _assessment(name, with_truth) for name in OFFSETS_M},
        refused={"rts": Remark(code="window-too-short", message="It needs more than a second.")},
        warnings=[Remark(code="latency-applied", message="The force was read 12 ms later.")],
    )  # fmt: skip


def tables(*, with_truth: bool) -> dict[str, bytes]:
    """The four tables of the result; a spectrum is 1 mm/sqrt(Hz) over the frequency times the size of the offset."""
    t = np.arange(round(WINDOW_S[0] * RATE_HZ), round(WINDOW_S[1] * RATE_HZ)) / RATE_HZ
    truth, f = truth_m(t), np.arange(0, 51) * 1.0
    over_time: dict[str, Any] = {"time_s": t}
    if with_truth:
        over_time |= _named("truth_{}_m", truth)
    spectra: dict[str, Any] = {"frequency_hz": f}
    for name, offset in OFFSETS_M.items():
        column = name.replace("-", "_")
        over_time |= _named(f"{column}_{{}}_m", truth + np.array(offset))
        spectra |= _named(f"{column}_{{}}_m_rthz", np.abs(offset) / np.maximum(f, 0.5)[:, None])
    shares: dict[str, Any] = {"time_s": t}
    for name, share in (("geometry", 0.2), ("force", 0.3), ("axis", 0.5), ("total", 1.0)):
        shares |= _named(f"{name}_{{}}_m", share * truth)
    lines = np.geomspace(0.01, 40, 30)
    bode: dict[str, Any] = {"frequency_hz": lines}
    for k, name in enumerate(("geometry", "force", "axis")):
        bode |= {f"{name}_gain_db": -20.0 * k - 400 * (lines > 30), f"{name}_phase_rad": 0.1 * k + 0 * lines}
    made = {"comparison": over_time, "spectra": spectra, "contributions": shares, "bode": bode}
    return {f"{stem}.parquet": _parquet(columns) for stem, columns in made.items()}


def result(given: dict[str, Any], files: dict[str, bytes], *, with_truth: bool) -> JobResult:
    """The result of a succeeded comparison; its methods come in the order of a mapping that keeps none."""
    made = summary(with_truth=with_truth).model_dump(mode="json")
    made["methods"] = dict(sorted(made["methods"].items(), key=lambda item: (len(item[0]), item[0])))
    artifacts = [Artifact(name=name, media_type="application/x", bytes=len(content)) for name, content in files.items()]
    return JobResult(
        kind=KIND, input=given, versions={"stridelab": "0.1.0"}, references=[], summary=made, artifacts=artifacts
    )


def _assessment(name: str, with_truth: bool) -> MethodAssessment:
    x, y, z = OFFSETS_M[name]
    along = Axes(along=x, lateral=y, vertical=z)
    nothing = Axes(along=None, lateral=None, vertical=None)
    truth = ErrorAgainstTruth(
        horizontal_m=float(np.hypot(x, y)), horizontal_95_m=1.5 * float(np.hypot(x, y)), vertical_m=abs(z),
        rms_m=along, mean_m=along, coverage=Axes(along=0.95, lateral=1.0, vertical=0.5), sd_m=along, lag_s=nothing,
    )  # fmt: skip
    return MethodAssessment(
        method=name.removesuffix("-thesis"), offset_m=along,
        force_residual_n=Axes(along=1000 * x, lateral=1000 * y, vertical=1000 * z),
        held_back_n=None if name == "kalman-thesis" else Axes(along=3.0 + x, lateral=2.0, vertical=None),
        momentum_rate=MomentumRateAgreement(correlation=Axes(along=0.97, lateral=0.98, vertical=-0.1), rms_nm=nothing),
        flight=None, standing_m=None, truth=truth if with_truth else None,
        warnings=[Remark(code="no-spin", message="It takes the angular momentum for constant.")] if "-" in name else [],
    )  # fmt: skip


def _named(pattern: str, track: np.ndarray) -> dict[str, np.ndarray]:
    return {pattern.format(axis): track[:, k] for k, axis in enumerate("xyz")}


def _parquet(columns: dict[str, Any]) -> bytes:
    sink = io.BytesIO()
    pq.write_table(pa.table(columns), sink)
    return sink.getvalue()
