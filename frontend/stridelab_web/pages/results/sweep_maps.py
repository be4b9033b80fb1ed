"""Charts of a sweep: the cost over one varied field, a map over two, one map per value of a third."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.schemas.sweeps import SweepAxis, SweepSummary
from stridelab_web.charts.svg import Canvas, Chart, Range, span_of
from stridelab_web.parquet import read_columns, read_words

MAPS_AT_MOST: Final = 12
"""Maximum number of values of a third field that are drawn; the table has all."""
SAID: Final = {
    "feasible": "has a motion",
    "refused": "rejected before solving",
    "infeasible": "no motion found",
    "failed": "could not be planned",
}
LEGEND: Final = [(f"cell {outcome}", "shade", text) for outcome, text in SAID.items()]


@dataclass(frozen=True)
class Swept:
    """Outcome, cost and reason of each scenario of a sweep, with one array axis per varied field."""

    axes: Sequence[SweepAxis]
    outcome: np.ndarray
    objective: np.ndarray
    why: np.ndarray

    @staticmethod
    def of(summary: SweepSummary, content: bytes) -> "Swept":
        """Read the artifact ``sweep.parquet``."""
        shape = tuple(len(axis.values) for axis in summary.axes)
        texts = read_words(content)
        columns = read_columns(content)
        return Swept(
            summary.axes,
            np.array(texts["outcome"]).reshape(shape),
            columns["objective"].reshape(shape),
            np.array(texts["why"], dtype=object).reshape(shape),
        )

    def charts(self) -> list[tuple[str, Chart]]:
        """Charts with their titles; a single chart has an empty one."""
        if len(self.axes) == 1:
            return [("", self._curve())]
        if len(self.axes) == 2:
            return [("", self._map(self.outcome, self.objective, self.why))]
        third = self.axes[2]
        return [
            (said(third, value), self._map(self.outcome[..., k], self.objective[..., k], self.why[..., k]))
            for k, value in list(enumerate(third.values))[:MAPS_AT_MOST]
        ]

    def borders(self) -> list[tuple[str, str]]:
        """Range of the first field that has a motion, for every combination of the others."""
        first, others = self.axes[0], self.axes[1:]
        ranges = []
        for index in np.ndindex(*(len(axis.values) for axis in others)):
            feasible = [value for k, value in enumerate(first.values) if self.outcome[(k, *index)] == "feasible"]
            at = ", ".join(said(axis, axis.values[i]) for axis, i in zip(others, index, strict=True))
            unit = f" {first.unit}" if first.unit else ""
            between = "nowhere"
            if feasible:
                between = f"{min(feasible):.4g} to {max(feasible):.4g}{unit}, {len(feasible)} of {len(first.values)}"
            ranges.append((at or first.field, between))
        return ranges

    def _curve(self) -> Chart:
        axis = self.axes[0]
        values = np.array(axis.values)
        canvas = Canvas(span_of(values), span_of(self.objective), titled(axis), "cost (4.20a)")
        for low, high, k in _cells(values):
            if self.outcome[k] != "feasible":
                canvas.shade(low, high, f"cell {self.outcome[k]}", self._said(axis, k))
        canvas.curve(values, self.objective, "main")
        for k, value in enumerate(values):
            canvas.mark(float(value), float(self.objective[k]), "main", text=self._said(axis, k))
        return canvas.chart(
            f"Cost over {axis.field}: {int((self.outcome == 'feasible').sum())} of {len(values)} feasible"
        )

    def _said(self, axis: SweepAxis, k: int) -> str:
        return _sentence(said(axis, axis.values[k]), self.outcome[k], self.objective[k], self.why[k])

    def _map(self, outcome: np.ndarray, objective: np.ndarray, why: np.ndarray) -> Chart:
        across, up = self.axes[0], self.axes[1]
        x, y = list(_cells(np.array(across.values))), list(_cells(np.array(up.values)))
        canvas = Canvas(_whole(x), _whole(y), titled(across), titled(up))
        for left, right, i in x:
            for low, high, j in y:
                at = f"{said(across, across.values[i])}, {said(up, up.values[j])}"
                text = _sentence(at, outcome[i, j], objective[i, j], why[i, j])
                canvas.cell((left, right), (low, high), f"cell {outcome[i, j]}", text)
        number = int((outcome == "feasible").sum())
        return canvas.chart(f"{across.field} against {up.field}: {number} of {outcome.size} feasible")


def titled(axis: SweepAxis) -> str:
    """The field with its unit."""
    return f"{axis.field} [{axis.unit}]" if axis.unit else axis.field


def said(axis: SweepAxis, value: float) -> str:
    """The field with a value."""
    return f"{axis.field} {value:.4g}{' ' if axis.unit else ''}{axis.unit}"


def _sentence(at: str, outcome: str, objective: float, why: str) -> str:
    more = f", cost {objective:.3f}" if outcome == "feasible" else f": {why}" if why else ""
    return f"{at}: {SAID[outcome]}{more}"


def _cells(values: np.ndarray) -> Iterator[tuple[float, float, int]]:
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


def _whole(cells: Sequence[tuple[float, float, int]]) -> Range:
    return min(cell[0] for cell in cells), max(cell[1] for cell in cells) + 1e-12
