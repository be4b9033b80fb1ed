"""Pushes on the page of a job: the counts, a map by instant and direction, and the falls."""

import math
from typing import Any, Final

import numpy as np
from starlette.concurrency import run_in_threadpool

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.receding import PushBasinSummary, PushOutcome
from stridelab_web.api_client import JobFiles
from stridelab_web.charts.svg import Chart, Shape
from stridelab_web.parquet import read_columns, read_texts

KIND: Final = "push-basin"
TABLE: Final = "pushes.parquet"
MARKS: Final[dict[PushOutcome, tuple[str, Shape, str]]] = {
    "survived": ("", "circle", "survived"),
    "unexplained": ("late", "triangle", "fell, not proved inevitable"),
    "proved-lost": ("measured", "cross", "fell, proved lost"),
}
"""Colour, shape and name of each outcome."""
SIDES: Final = ("forwards (x)", "left (y)", "backwards", "right")


async def push_basin_of(files: JobFiles, result: JobResult) -> dict[str, Any]:
    """Values of _push_basin.html."""
    summary = PushBasinSummary.model_validate(result.summary)
    content = await files.read_file(TABLE)
    chart, falls = await run_in_threadpool(draw_pushes, summary, content) if content is not None else (None, [])
    low, high = (f"{100 * end:.0f}" for end in summary.survived_ci95)
    return {
        "summary": summary,
        "headline": f"Survived: {summary.survived} of {summary.n} pushes ({low} to {high} %, 95 % confidence).",
        "counts": f"Survived, {_endings(summary)}. Proved lost: {summary.proved_lost}; unexplained: "
        f"{summary.unexplained}.",
        "chart": chart,
        "falls": falls,
        "legend": list(MARKS.values()),
    }


def _endings(summary: PushBasinSummary) -> str:
    """How the survived pushes end."""
    if summary.arrived is None:
        return f"{summary.completed} of them with a completed motion"
    return f"{summary.arrived} of them at the end of the plan, {summary.completed} with a completed motion"


def draw_pushes(summary: PushBasinSummary, content: bytes) -> tuple[Chart, list[dict[str, Any]]]:
    """Map of the pushes by time and direction, and a row of the table for each fall."""
    columns, texts = read_columns(content), read_texts(content)
    degrees = np.degrees(columns["direction_rad"])
    chart = Chart(
        (0.0, summary.duration_s), (-180.0, 180.0), "time of the push [s]", "direction from x to y [°]", width=920.0
    )
    falls = []
    pushes = zip(columns["time_s"], degrees, texts["outcome"], texts["reason"], strict=True)
    for k, (time_s, angle, outcome, reason) in enumerate(pushes):
        css, shape, named = MARKS[outcome]  # type: ignore[index]  # a column of the contract
        text = f"push {k}, {time_s:.2f} s, {angle:.0f}°, {direction_name(angle)}: {named}"
        chart.add_mark(float(time_s), float(angle), css, shape, f"{text}. {reason}" if reason else text)
        if outcome != "survived":
            row = {"push": k, "time_s": float(time_s), "direction": f"{angle:.0f}°, {direction_name(angle)}"}
            falls.append(row | {"outcome": named, "reason": reason})
    caption = f"Pushes by time and direction: {summary.survived} of {summary.n} survived"
    return chart.with_caption(caption), falls


def direction_name(degrees: float) -> str:
    """The nearest of the four directions along the world's axes."""
    return SIDES[round(math.radians(degrees) / (math.pi / 2.0)) % 4]
