"""A sweep on the page of a job, and the page that lists sweeps.

The cost is a curve over one varied field, a map over two, one map per value of a third.
"""

import asyncio
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import Job, JobResult
from stridelab.schemas.sweeps import SweepAxis, SweepSummary
from stridelab_web.api_client import JobFiles, client_of
from stridelab_web.charts.svg import Chart, Range, range_of
from stridelab_web.formatting import plain_number
from stridelab_web.pages.render import render_page
from stridelab_web.pages.terms.sweeps import EFFORT_TERMS, FIELD_TERMS, OUTCOME_TERMS
from stridelab_web.pages.terms.term import Term
from stridelab_web.parquet import read_columns, read_texts

MAX_MAPS: Final = 12
"""Maximum number of values of a third field that are drawn; the table has all."""
OUTCOME_TEXTS: Final = {
    "feasible": "has a motion",
    "refused": "rejected before solving",
    "infeasible": "no motion found",
    "failed": "could not be planned",
}
EFFORT_TITLES: Final = {
    "cost": "Cost (4.20a)",
    "present": "The scenario itself",
    "solve_time": "Processor time",
}
LEGEND: Final = [(f"cell {outcome}", "shade", text) for outcome, text in OUTCOME_TEXTS.items()]


@dataclass(frozen=True)
class SweepGrid:
    """Outcome, cost and reason of each scenario of a sweep, with one array axis per varied field."""

    axes: Sequence[SweepAxis]
    outcome: np.ndarray
    objective: np.ndarray
    why: np.ndarray

    @staticmethod
    def from_table(summary: SweepSummary, content: bytes) -> "SweepGrid":
        """Read the artifact ``sweep.parquet``."""
        shape = tuple(len(axis.values) for axis in summary.axes)
        texts = read_texts(content)
        columns = read_columns(content)
        return SweepGrid(
            summary.axes,
            np.array(texts["outcome"]).reshape(shape),
            columns["objective"].reshape(shape),
            np.array(texts["why"], dtype=object).reshape(shape),
        )

    def draw_charts(self) -> list[tuple[str, Chart]]:
        """Charts with their titles; a single chart has an empty one."""
        if len(self.axes) == 1:
            return [("", self._cost_curve())]
        if len(self.axes) == 2:
            return [("", self._outcome_map(self.outcome, self.objective, self.why))]
        third = self.axes[2]
        return [
            (
                value_text(third, value),
                self._outcome_map(self.outcome[..., k], self.objective[..., k], self.why[..., k]),
            )
            for k, value in list(enumerate(third.values))[:MAX_MAPS]
        ]

    def feasible_ranges(self) -> list[tuple[str, str]]:
        """Range of the first field that has a motion, for every combination of the others."""
        first, others = self.axes[0], self.axes[1:]
        ranges = []
        for index in np.ndindex(*(len(axis.values) for axis in others)):
            feasible = [value for k, value in enumerate(first.values) if self.outcome[(k, *index)] == "feasible"]
            at = ", ".join(value_text(axis, axis.values[i]) for axis, i in zip(others, index, strict=True))
            unit = f" {first.unit}" if first.unit else ""
            between = "nowhere"
            if feasible:
                between = f"{min(feasible):.4g} to {max(feasible):.4g}{unit}, {len(feasible)} of {len(first.values)}"
            ranges.append((at or first.field, between))
        return ranges

    def _cost_curve(self) -> Chart:
        axis = self.axes[0]
        values = np.array(axis.values)
        canvas = Chart(
            range_of(values), range_of(self.objective, min_width=_LEAST_COST_RANGE), axis_title(axis), "cost (4.20a)"
        )
        for low, high, k in _cell_edges(values):
            if self.outcome[k] != "feasible":
                canvas.add_shade(low, high, f"cell {self.outcome[k]}", self._point_text(axis, k))
        canvas.add_curve(values, self.objective, "main")
        for k, value in enumerate(values):
            canvas.add_mark(float(value), float(self.objective[k]), "main", text=self._point_text(axis, k))
        return canvas.with_caption(
            f"Cost over {axis.field}: {int((self.outcome == 'feasible').sum())} of {len(values)} feasible"
        )

    def _point_text(self, axis: SweepAxis, k: int) -> str:
        return _outcome_text(value_text(axis, axis.values[k]), self.outcome[k], self.objective[k], self.why[k])

    def _outcome_map(self, outcome: np.ndarray, objective: np.ndarray, why: np.ndarray) -> Chart:
        across, up = self.axes[0], self.axes[1]
        x, y = list(_cell_edges(np.array(across.values))), list(_cell_edges(np.array(up.values)))
        canvas = Chart(_cells_range(x), _cells_range(y), axis_title(across), axis_title(up))
        for left, right, i in x:
            for low, high, j in y:
                at = f"{value_text(across, across.values[i])}, {value_text(up, up.values[j])}"
                text = _outcome_text(at, outcome[i, j], objective[i, j], why[i, j])
                canvas.add_cell((left, right), (low, high), f"cell {outcome[i, j]}", text)
        number = int((outcome == "feasible").sum())
        return canvas.with_caption(f"{across.field} against {up.field}: {number} of {outcome.size} feasible")


def axis_title(axis: SweepAxis) -> str:
    """The field with its unit."""
    return f"{axis.field} [{axis.unit}]" if axis.unit else axis.field


def value_text(axis: SweepAxis, value: float) -> str:
    """The field with a value."""
    return f"{axis.field} {value:.4g}{' ' if axis.unit else ''}{axis.unit}"


def _outcome_text(at: str, outcome: str, objective: float, why: str) -> str:
    more = f", cost {objective:.3f}" if outcome == "feasible" else f": {why}" if why else ""
    return f"{at}: {OUTCOME_TEXTS[outcome]}{more}"


def _cell_edges(values: np.ndarray) -> Iterator[tuple[float, float, int]]:
    """Yield the lower edge, upper edge and index of each value's cell; edges are midway between values."""
    if len(values) == 1:
        half = 0.05 * (abs(float(values[0])) or 1.0)
        yield float(values[0]) - half, float(values[0]) + half, 0
        return
    edges = np.concatenate(
        [[1.5 * values[0] - values[1] / 2], (values[1:] + values[:-1]) / 2, [1.5 * values[-1] - values[-2] / 2]]
    )
    for k in range(len(values)):
        yield float(min(edges[k : k + 2])), float(max(edges[k : k + 2])), k


def _cells_range(cells: Sequence[tuple[float, float, int]]) -> Range:
    return min(cell[0] for cell in cells), max(cell[1] for cell in cells) + 1e-12


_LEAST_COST_RANGE: Final = 0.1
"""Least width of the axis of costs, which then has two decimals."""
KIND: Final = "sweep"
TABLE: Final = "sweep.parquet"


async def sweep_of(files: JobFiles, result: JobResult) -> dict[str, Any] | None:
    """Values for the template; None for a result without its table."""
    if all(item.name != TABLE for item in result.artifacts):
        return None
    summary = SweepSummary.model_validate(result.summary)
    content = await files.read_file(TABLE)
    charts, borders = await run_in_threadpool(_draw_sweep, summary, content) if content is not None else ([], [])
    return {
        "summary": summary,
        "headline": sweep_headline(summary),
        "present": ", ".join(
            f"{axis.field} {plain_number(axis.present)} {axis.unit}".rstrip() for axis in summary.axes
        ),
        "charts": charts,
        "borders": borders,
        "legend": LEGEND,
        "terms": sweep_terms(summary),
        "field_terms": FIELD_TERMS,
    }


def sweep_terms(summary: SweepSummary) -> list[tuple[str, Term]]:
    """The words on the page of a sweep with what they mean: its fields, the outcomes, cost and effort."""
    fields = [(axis.field.capitalize(), FIELD_TERMS[axis.field]) for axis in summary.axes]
    outcomes = [(text.capitalize(), OUTCOME_TERMS[outcome]) for outcome, text in OUTCOME_TEXTS.items()]
    return [*fields, *outcomes, *((EFFORT_TITLES[key], term) for key, term in EFFORT_TERMS.items())]


def sweep_headline(summary: SweepSummary) -> str:
    """In how many scenarios there is a motion, of what, and what became of the others."""
    who = (
        "The robot has a certified motion" if summary.scope == "whole body" else "The centre of mass alone has a motion"
    )
    left = {
        "rejected before solving": summary.refused,
        "without a motion": summary.infeasible,
        "not planned": summary.failed,
    }
    others = ", ".join(f"{number} {outcome}" for outcome, number in left.items() if number)
    return f"{who} in {summary.feasible} of {summary.points} scenarios{f'; {others}' if others else ''}."


def _draw_sweep(summary: SweepSummary, content: bytes) -> tuple[Any, Any]:
    swept = SweepGrid.from_table(summary, content)
    return swept.draw_charts(), swept.feasible_ranges()


SCOPE_NAMES: Final = {"centre of mass": "centre of mass only", "whole body": "whole body"}


async def sweeps_page(request: Request) -> Response:
    """``GET /sweeps``."""
    client = client_of(request)
    listed = await client.jobs(kind=KIND, cursor=request.query_params.get("cursor"))
    named = await asyncio.gather(*(_sweep_name(client, job) for job in listed.items))
    names = {job.id: name for job, name in zip(listed.items, named, strict=True) if name}
    return render_page(request, "pages/sweeps.html", section="Sweeps", jobs=listed.items, names=names, next=listed.next)


async def _sweep_name(client: AsyncClient, job: Job) -> str:
    return sweep_title(await client.result(job.id)) if job.state == "succeeded" else ""


def sweep_title(result: JobResult) -> str:
    """``Steps over stride, friction: 31 of 105, centre of mass only``."""
    summary = SweepSummary.model_validate(result.summary)
    fields = ", ".join(axis.field for axis in summary.axes)
    return (
        f"{summary.scenario_name} over {fields}: {summary.feasible} of {summary.points}, {SCOPE_NAMES[summary.scope]}"
    )
