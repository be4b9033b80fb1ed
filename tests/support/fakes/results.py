"""Results of the human wing as the interface gives them, with numbers known in advance.

A comparison as the interface gives it: three estimators whose errors are known functions, with or without truth.

Measures of gait as the interface gives them: two recordings of a person, whose numbers are known.

A study of a population as the interface gives it: six people in two groups, whose numbers are known.

Subjects as the interface gives them, kept in memory.

A table ``stability`` whose feet, margins and angular momentum are known.
"""

import io
import uuid
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from stridelab.schemas.base import Problem, Remark
from stridelab.schemas.comparison import (
    Axes,
    CompareEstimatorsSummary,
    ErrorAgainstTruth,
    MethodAssessment,
    MomentumRateAgreement,
)
from stridelab.schemas.jobs import Artifact, Job, JobResult
from stridelab.schemas.measures import GaitMeasuresSummary, MeasureValue, NotMeasured
from stridelab.schemas.population import (
    CorrelationResult,
    EffectResult,
    LeftOut,
    MixedModelResult,
    PartialCorrelation,
    StudyPopulationSummary,
    SubjectResult,
)
from stridelab.schemas.previews import PartialResults
from stridelab.schemas.quality import Quality, TrialQuality
from stridelab.schemas.recordings import Recording, Subject, SubjectInput
from stridelab_web.parquet import Columns, read_columns

COMPARISON_KIND = "compare-estimators"
RATE_HZ, WINDOW_S = 100.0, (0.5, 1.5)
OFFSETS_M = {
    "kalman-thesis": (0.012, -0.004, 0.003),
    "smoother": (0.001, 0.002, 0.003),
    "geometry": (0.006, 0.0, 0.004),
}
"""Constant error of each method along x, y and z, in no order that a page would choose."""
EMPTY_LISTS = ("/stream/markers", "/live", "/robots/packages")
"""Addresses where the fake has nothing to list."""


def truth_m(time_s: np.ndarray) -> np.ndarray:
    """True centre of mass, shape ``(n, 3)``."""
    return np.column_stack([1.2 * time_s, 0.02 * np.sin(5 * time_s), 0.95 + 0.02 * np.cos(11 * time_s)])


def comparison_summary(*, with_truth: bool) -> CompareEstimatorsSummary:
    """Summary of a comparison."""
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
    by_name = {"comparison": over_time, "spectra": spectra, "contributions": shares, "bode": bode}
    return {f"{stem}.parquet": _parquet(columns) for stem, columns in by_name.items()}


def comparison_result(given: dict[str, Any], files: dict[str, bytes], *, with_truth: bool) -> JobResult:
    """The result of a succeeded comparison; its methods come in the order of a mapping that keeps none."""
    summary = comparison_summary(with_truth=with_truth).model_dump(mode="json")
    summary["methods"] = dict(sorted(summary["methods"].items(), key=lambda item: (len(item[0]), item[0])))
    artifacts = [Artifact(name=name, media_type="application/x", bytes=len(content)) for name, content in files.items()]
    return JobResult(
        kind=COMPARISON_KIND,
        input=given,
        versions={"stridelab": "0.1.0"},
        references=[],
        summary=summary,
        artifacts=artifacts,
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


MEASURES_KIND = "gait-measures"
GOOD = Quality(verdict="good", checks=[], not_checked={})


def value(
    name: str, unit: str, means: tuple[float, float, float], half: float | None, symmetry: float | None = None
) -> list[MeasureValue]:
    """Rows of one measure: over both sides, left and right; ``half`` is that of the 95 % interval."""
    return [
        MeasureValue(
            name=name, unit=unit, side=side, n=n, mean=mean, between_sd=None, error_sd=None,
            ci95=None if half is None else (mean - half, mean + half), symmetry=None if side else symmetry,
        )
        for side, n, mean in zip((None, "left", "right"), (7, 4, 3), means, strict=True)
    ]  # fmt: skip


def measures_summary() -> GaitMeasuresSummary:
    """Numbers, of which the pages show the first six main ones above the table."""
    return GaitMeasuresSummary(
        steps=7, sides={"left": 4, "right": 3},
        measures=[
            *value("step_length", "m", (0.6781, 0.672, 0.684), 0.0192, -0.0177),
            *value("step_width", "m", (0.105, 0.107, 0.103), 0.0065),
            *value("walking_speed", "m/s", (1.212, 1.214, 1.210), 0.0103, 0.0033),
            *value("double_support_share", "1", (0.25, 0.24, 0.26), 0.1, -0.08),
            *value("step_time", "s", (0.5683, 0.571, 0.566), 0.0515, 0.009),
            *value("margin_of_stability_ml_min", "m", (0.0728, 0.0719, 0.0737), 0.0263, -0.0255),
            *value("margin_of_stability_ap_contact", "m", (-0.0004, 0.011, -0.012), 0.0398),
            *value("energy_recovery", "1", (0.55, 0.56, 0.54), None, 0.036),
            *value("angular_momentum_range_x", "1", (0.0138, 0.0139, 0.0137), 0.0027, 0.0146),
            MeasureValue(
                name="foot_placement_residual", unit="m", side=None, n=1, mean=0.0142, between_sd=None, error_sd=0.001,
                ci95=(0.0122, 0.0162),
            ),
        ],
        not_measured=[NotMeasured(name="limb_work_left_positive", code="no-separate-forces", message="One plate.")],
        left_out=[
            LeftOut(recording_id="r3", filename="turn.c3d", code="not-walking", message="The walk turns."),
            LeftOut(recording_id="r4", filename="off.c3d", code="contradicted", message="Sentence of the plates."),
        ],
        n_recordings=2, method="smoother", mass_kg=60.0, height_m=None, speed_m_s=1.212, quality=GOOD,
        trials=[TrialQuality(recording_id=f"r{k}", filename=f"walk {k}.c3d", quality=GOOD) for k in (1, 2)],
        warnings=[Remark(code="gaps-filled", message="C7 is hidden.")],
    )  # fmt: skip


def measures_result(given: dict[str, Any]) -> JobResult:
    """The result of succeeded measures."""
    names = [f"{stem}.{end}" for stem in ("measures", "steps", "xcom", "stability") for end in ("parquet", "csv")]
    artifacts = [Artifact(name=name, media_type="application/x", bytes=2345) for name in names]
    return JobResult(
        kind=MEASURES_KIND, input=given, versions={"stridelab": "0.1.0"}, references=["hof2005"],
        summary=measures_summary().model_dump(mode="json"), artifacts=artifacts,
    )  # fmt: skip


POPULATION_KIND = "study-population"
PEOPLE = (
    ("P01", "adults", 1.62, 0.100, 1.10), ("P02", "adults", 1.71, 0.104, 1.25), ("P03", "adults", 1.80, 0.101, 1.20),
    ("P04", "adults", 1.92, 0.110, 1.35),
    ("C01", "children", 1.20, 0.082, 1.00), ("C02", "children", None, 0.085, 1.05),
)  # fmt: skip
"""Name, group, height in metres, R in metres and speed in m/s."""


def population_summary() -> StudyPopulationSummary:
    """Summary of a study."""
    return StudyPopulationSummary(
        subjects=[_subject(*person) for person in PEOPLE],
        correlations=[
            _pair("omega_rad_s", "height_m", -0.40, (-0.80, 0.27), 0.22, None),
            _pair("R_m", "speed_m_s", 0.34, (-0.33, 0.78), 0.31, None),
            _pair("R_m", "height_m", 0.66, (0.10, 0.90), 0.027, 0.67),
            _pair("z0_m", "height_m", 0.99, (0.95, 1.0), 1e-7, 0.87),
        ],
        mixed_models=[
            MixedModelResult(
                group="adults", parameter="R_m", formula="R_m ~ height_m", method="reml", subject_sd=0.004,
                step_sd=0.002, icc=0.8, n_people=4, n_steps=16, on_bound=False,
                effects=[EffectResult(name="height_m", value=0.03, sd=0.01, freedom=2, p=0.1, ci95=(-0.013, 0.073))],
            )
        ],
        left_out=[LeftOut(recording_id="r7", filename="turn.c3d", code="turning", message="The walk turns.")],
        n_recordings=7, n_steps=24, method=None, pooled=False,
        warnings=[Remark(code="groups-apart", message="The groups are analysed separately: adults (4), children (2).")],
    )  # fmt: skip


def population_result(given: dict[str, Any]) -> JobResult:
    """The result of a succeeded study."""
    names = [f"{stem}.{end}" for stem in ("subjects", "steps", "correlations") for end in ("parquet", "csv")]
    artifacts = [Artifact(name=name, media_type="application/x", bytes=2345) for name in names]
    return JobResult(
        kind=POPULATION_KIND, input=given, versions={"stridelab": "0.1.0"}, references=[],
        summary=population_summary().model_dump(mode="json"), artifacts=artifacts,
    )  # fmt: skip


def _subject(name: str, group: str, height_m: float | None, R_m: float, speed_m_s: float) -> SubjectResult:
    tall = height_m or 1.3
    return SubjectResult(
        subject=name, group=group, group_source="stated" if group == "adults" else "height", recordings=[f"{name}.c3d"],
        n_steps=4, height_m=height_m, leg_m=0.53 * tall, age_years=None, sex=None, mass_kg=None, speed_m_s=speed_m_s,
        step_length_m=0.4 * tall, R_m=R_m, R_sd_m=0.004, r_m=0.15 * R_m, r_sd_m=0.001, z0_m=0.55 * tall, z0_sd_m=0.002,
        omega_rad_s=12 - speed_m_s, omega_sd_rad_s=None, error_mean_mm=10 * (R_m - 0.02), error_sd_mm=0.3,
        error_max_mm=2.0, circumference_share=0.95, double_support_start_error_s=-0.08,
        double_support_start_error_sd_s=0.02, double_support_end_error_s=0.03, double_support_end_error_sd_s=None,
    )  # fmt: skip


def _pair(
    parameter: str, against: str, r: float, ci95: tuple[float, float], p: float, thesis: float | None
) -> CorrelationResult:
    partial = [PartialCorrelation(on="speed_m_s", n=4, r=0.5, p=0.3, ci95=(-0.2, 0.8))]
    return CorrelationResult(
        group="adults", parameter=parameter, against=against, n=4, r=r, p=p, p_holm=min(4 * p, 1.0), ci95=ci95,
        bootstrap_ci95=None, spearman=r - 0.05, spearman_p=p, spearman_ci95=ci95, spearman_bootstrap_ci95=None,
        partial=[] if against == "speed_m_s" else partial, partial_on_speed=None, left_out=[], thesis=thesis,
    )  # fmt: skip


_NOW = datetime(2026, 1, 2, 3, 4, tzinfo=UTC)


def listed_recordings(stored: Iterable[Recording], query: Mapping[str, str]) -> dict[str, Any]:
    """The page of recordings that ``query`` asks for; a cursor is the number of those before it."""
    matching = [one for one in reversed(list(stored)) if query.get("session_id") in (None, one.session_id)]
    if "subject_id" in query:
        matching = [one for one in matching if one.subject_id == query["subject_id"]]
    if "linked" in query:
        matching = [one for one in matching if (one.subject_id is not None) == (query["linked"] == "true")]
    start, limit = int(query.get("cursor", 0)), int(query.get("limit", 50))
    items = [one.model_dump(mode="json") for one in matching[start : start + limit]]
    return {"items": items, "next": str(start + limit) if len(matching) > start + limit else None}


class FakeSubjects:
    """Persons by their id."""

    def __init__(self, recordings: Mapping[str, Recording]) -> None:
        self.stored: dict[str, Subject] = {}
        self._recordings = recordings

    def add(self, name: str | None = "P07", **fields: Any) -> Subject:
        """A person."""
        subject = Subject(subject_id=f"s{uuid.uuid4().hex[:12]}", created_at=_NOW, name=name, **fields)
        self.stored[subject.subject_id] = subject
        return subject

    def routes(self, root: str) -> list[Route]:
        """The calls below ``root``."""
        return [
            Route(f"{root}/subjects", self._all, methods=["GET", "POST"]),
            Route(f"{root}/subjects/{{id}}", self._one, methods=["GET", "PATCH", "DELETE"]),
        ]

    def _shown(self, one: Subject) -> dict[str, Any]:
        linked = sum(recording.subject_id == one.subject_id for recording in self._recordings.values())
        return one.model_copy(update={"n_recordings": linked}).model_dump(mode="json")

    async def _all(self, request: Request) -> Response:
        if request.method == "GET":
            newest = [self._shown(one) for one in reversed(self.stored.values())]
            return JSONResponse({"items": newest, "next": None})
        subject_input = SubjectInput.model_validate(await request.json())
        return JSONResponse(self.add(**subject_input.model_dump()).model_dump(mode="json"), 201)

    async def _one(self, request: Request) -> Response:
        key = request.path_params["id"]
        if key not in self.stored:
            problem = Problem(title="404", status=404, code="subject-not-found", detail="There is no such subject.")
            return Response(problem.model_dump_json(), 404, media_type="application/problem+json")
        if request.method == "DELETE":
            del self.stored[key]
            return Response(status_code=204)
        if request.method == "PATCH":
            changes = SubjectInput.model_validate(await request.json()).model_dump(exclude_unset=True)
            self.stored[key] = self.stored[key].model_copy(update=changes)
        return JSONResponse(self._shown(self.stored[key]))


CORNERS_M = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1], [0.05, 0.05]])
"""A square foot; the fifth point is inside."""


def stability_table(tracks: bytes) -> Columns:
    """The left foot stands beside the line, the right one 0.2 m to its right from frame 100 on.

    The extrapolated CoM is 0.05 m inside the left edge, outside it by 0.02 m from frame 50 to 99.
    """
    time_s = read_columns(tracks)["time_s"]
    n, frame = len(time_s), np.arange(len(time_s))
    y_m = np.where((frame >= 50) & (frame < 100), 0.12, 0.05)
    columns = {"time_s": time_s, "x_m": np.zeros(n), "y_m": np.zeros(n), "z_m": np.ones(n)}
    columns |= {"xcom_x_m": np.zeros(n), "xcom_y_m": y_m, "xcom_z_m": np.zeros(n)}
    columns |= {"momentum_x_m2_s": np.full(n, 0.1), "momentum_y_m2_s": np.zeros(n), "momentum_z_m2_s": np.zeros(n)}
    for side, shift_m, stands in (("left", 0.0, np.ones(n, bool)), ("right", -0.2, frame >= 100)):
        edge_m = 0.1 if side == "left" else shift_m
        margin_m = (edge_m - y_m) * (1.0 if side == "left" else -1.0)
        columns[f"{side}_margin_m"] = np.where(stands, margin_m, np.nan)
        for axis, value in zip("xyz", (0.0, edge_m, 0.0), strict=True):
            columns[f"{side}_edge_{axis}_m"] = np.where(stands, value, np.nan)
        for k, (x, y) in enumerate(CORNERS_M):
            for axis, value in zip("xyz", (x, y + shift_m, 0.0), strict=True):
                columns[f"{side}_outline{k}_{axis}_m"] = np.where(stands, value, np.nan)
    return columns


RESULTS: dict[str, Callable[[dict[str, Any]], JobResult]] = {
    MEASURES_KIND: measures_result,
    POPULATION_KIND: population_result,
}


def no_parts(jobs: Mapping[str, Job]) -> Callable[[Request], Response]:
    """Endpoint of the parts of jobs that have none."""

    def endpoint(request: Request) -> Response:
        job = jobs[request.path_params["id"]]
        parts = PartialResults(job_id=job.id, state=job.state, attempt=job.attempt, chunks=[], next=f"{job.attempt}.0")
        return JSONResponse(parts.model_dump(mode="json"))

    return endpoint
