"""Comparison of estimators on the page of a job: tables with a row per method, and the figures to choose from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from stridelab.schemas.comparison import Axes, CompareEstimatorsSummary, MethodAssessment
from stridelab.schemas.jobs import JobResult
from stridelab.translations.catalogue import gettext
from stridelab_web.api_client import client_of
from stridelab_web.formatting import method_name, other_remarks
from stridelab_web.pages.results.comparison_plots import FIGURES, STYLES
from stridelab_web.parquet import read_columns

PER_AXIS: Final = ("along", "lateral", "vertical")
DASH: Final = "–"
Values = tuple[float | None, ...]


@dataclass(frozen=True)
class Cell:
    """A figure as text; ``best`` marks the smallest of its column if smaller is better."""

    text: str
    best: bool = False


@dataclass(frozen=True)
class Group:
    """Columns under one heading; ``cells`` by method."""

    title: str
    columns: tuple[str, ...]
    cells: Mapping[str, tuple[Cell, ...]]


@dataclass(frozen=True)
class _Figure:
    """How a group is read from an assessment; ``None`` where a check does not apply."""

    title: str
    columns: tuple[str, ...]
    read: Callable[[MethodAssessment], Values | None]
    factor: float = 1.0
    digits: int = 1
    least_is_best: bool = False


def against_truth(summary: CompareEstimatorsSummary) -> list[Group]:
    """Errors where the truth is known; empty where it is not."""
    return _column_groups(summary, _TRUTH)


def against_physics(summary: CompareEstimatorsSummary) -> list[Group]:
    """Checks that need no truth; groups without values are left out."""
    return _column_groups(summary, _PHYSICS)


def comparison_headline(summary: CompareEstimatorsSummary) -> str:
    """Which method errs least, or predicts hidden force best; empty if neither is known of two methods."""
    truths = {name: one.truth for name, one in summary.methods.items() if one.truth}
    if len(truths) > 1:
        best = min(truths, key=lambda name: truths[name].horizontal_m)
        error = f"{1000 * truths[best].horizontal_m:.1f} mm"
        return gettext("Smallest horizontal error: %(method)s, %(error)s RMS.", method=method_name(best), error=error)
    every = {name: _axes_values(one.held_back_n) for name, one in summary.methods.items()}
    held_back = {
        name: axes for name, values in every.items() if len(axes := [v for v in values or () if v is not None]) == 3
    }
    if len(held_back) < 2:
        return ""

    def best_method(axis: int) -> str:
        return min(held_back, key=lambda name: held_back[name][axis])

    along, lateral, vertical = (best_method(axis) for axis in range(3))
    if along == lateral == vertical:
        return gettext("Hidden force is predicted best by this method: %(method)s.", method=method_name(along))
    return gettext(
        "Hidden force is predicted best along the walk by %(along)s, sideways by %(lateral)s, "
        "vertically by %(vertical)s.",
        along=method_name(along), lateral=method_name(lateral), vertical=method_name(vertical),
    )  # fmt: skip


def _axes_values(axes: Axes | None) -> Values | None:
    return None if axes is None else (axes.along, axes.lateral, axes.vertical)


_TRUTH: Final = (
    _Figure(
        "Error [mm]",
        ("horizontal, RMS", "95th percentile", "vertical, RMS"),
        lambda m: (m.truth.horizontal_m, m.truth.horizontal_95_m, m.truth.vertical_m) if m.truth else None,
        1000.0, 2, least_is_best=True,
    ),
    _Figure("Inside the 95 % band [%]", PER_AXIS,
            lambda m: _axes_values(m.truth.coverage if m.truth else None), 100.0, 0),
    _Figure("Stated standard deviation [mm]", PER_AXIS,
            lambda m: _axes_values(m.truth.sd_m if m.truth else None), 1000.0, 1),
    _Figure("Late by [ms]", PER_AXIS, lambda m: _axes_values(m.truth.lag_s if m.truth else None), 1000.0, 1),
)  # fmt: skip
_PHYSICS: Final = (
    _Figure("Force residual [N]", PER_AXIS, lambda m: _axes_values(m.force_residual_n)),
    _Figure("At samples held back [N]", PER_AXIS, lambda m: _axes_values(m.held_back_n), least_is_best=True),
    _Figure(
        "dL/dt of the segments, r", PER_AXIS,
        lambda m: _axes_values(m.momentum_rate.correlation if m.momentum_rate else None),
        digits=2,
    ),
    _Figure(
        "In flight", ("vertical against g [%]", "horizontal [m/s²]"),
        lambda m: (100 * m.flight.vertical_share, m.flight.horizontal_m_s2) if m.flight else None, digits=2,
    ),
    _Figure(
        "Standing [mm]", ("horizontal",), lambda m: None if m.standing_m is None else (m.standing_m,), 1000.0,
    ),
    _Figure("Fused minus markers [mm]", PER_AXIS, lambda m: _axes_values(m.offset_m), 1000.0),
)  # fmt: skip
COLUMN_TITLES: Final = tuple(dict.fromkeys(text for one in (*_TRUTH, *_PHYSICS) for text in (one.title, *one.columns)))
"""Headings of the tables."""


def _column_groups(summary: CompareEstimatorsSummary, figures: tuple[_Figure, ...]) -> list[Group]:
    groups = []
    for figure in figures:
        rows = {name: figure.read(one) for name, one in summary.methods.items()}
        if any(value is not None for row in rows.values() if row for value in row):
            groups.append(Group(figure.title, figure.columns, _group_cells(figure, rows)))
    return groups


def _group_cells(figure: _Figure, rows: Mapping[str, Values | None]) -> dict[str, tuple[Cell, ...]]:
    whole = {name: row or (None,) * len(figure.columns) for name, row in rows.items()}
    least = [
        min((abs(v) for row in whole.values() if (v := row[k]) is not None), default=None)
        for k in range(len(figure.columns))
    ]
    return {
        name: tuple(
            Cell(
                DASH if value is None else f"{figure.factor * value:z.{figure.digits}f}",
                figure.least_is_best and value is not None and abs(value) == least[k],
            )
            for k, value in enumerate(row)
        )
        for name, row in whole.items()
    }


KIND: Final = "compare-estimators"


def comparison_of(job_id: str, result: JobResult, chosen: str) -> dict[str, Any]:
    """Values for the template; ``chosen`` is the key of the figure to show, by default the first one."""
    summary = _ordered_summary(result)
    present = {item.name for item in result.artifacts}
    offered = {key: figure for key, figure in FIGURES.items() if figure.table in present}
    key = chosen if chosen in offered else next(iter(offered), None)
    return {
        "summary": summary,
        "headline": comparison_headline(summary),
        "tables": [
            table
            for table in (
                (gettext("Against the truth"), against_truth(summary)),
                (gettext("Against physics"), against_physics(summary)),
            )
            if table[1]
        ],
        "remarks": [
            *(("", remark) for remark in other_remarks(summary.warnings)),
            *((name, remark) for name, one in summary.methods.items() for remark in one.warnings),
        ],
        "figures": [(name, figure.title, name == key) for name, figure in offered.items()],
        "figure": None if key is None else offered[key],
        "plots_url": f"/jobs/{job_id}/figures/{key}.json",
    }


async def figure_json(request: Request) -> Response:
    """``GET /jobs/{id}/figures/{name}.json``: the curves of one figure."""
    client, job_id = client_of(request), request.path_params["id"]
    view = FIGURES.get(request.path_params["name"])
    result = await client.result(job_id)
    if view is None or all(item.name != view.table for item in result.artifacts):
        raise HTTPException(404, "This job has no such figure.")
    summary = _ordered_summary(result)
    content = await client.read_artifact(job_id, view.table)
    drawn = await run_in_threadpool(lambda: view.draw(read_columns(content), summary))
    return JSONResponse(drawn, headers={"Cache-Control": "private, max-age=600"})


def _ordered_summary(result: JobResult) -> CompareEstimatorsSummary:
    """The summary with its methods in the order of the pages, unknown ones last."""
    summary = CompareEstimatorsSummary.model_validate(result.summary)
    rank = {name: place for place, name in enumerate(STYLES)}
    names = sorted(summary.methods, key=lambda name: (rank.get(name, len(rank)), name))
    return summary.model_copy(update={"methods": {name: summary.methods[name] for name in names}})
