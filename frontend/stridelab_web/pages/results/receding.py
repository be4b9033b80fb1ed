"""The receding horizon on the page of a job: figures as text, charts of the replans and of the motion, and pushes."""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from starlette.concurrency import run_in_threadpool

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.receding import PlanRecedingInput, PlanRecedingSummary, Push
from stridelab_web.api_client import JobFiles
from stridelab_web.charts.plotly import Reading, Row, Trace, plot_document, xyz_row
from stridelab_web.charts.svg import Chart
from stridelab_web.formatting import with_unit
from stridelab_web.parquet import Columns, read_columns

TABLE: Final = "receding.parquet"
LIMIT_MS: Final = 50.0
"""Time for one replan at the 20 Hz of section 4.6.1."""
_COM = ("com_x_m", "com_y_m", "com_z_m")
_VELOCITY = ("com_vx_m_s", "com_vy_m_s", "com_vz_m_s")
_MOMENTUM = ("l_x_nms", "l_y_nms", "l_z_nms")
_ROUNDING = 1e-9


def effect_times_s(pushes: Sequence[Push], period_s: float) -> list[float]:
    """Times (s) at which the pushes take effect: the ends of the periods that contain them."""
    return [period_s * (math.floor(push.time_s / period_s + _ROUNDING) + 1) for push in pushes]


def replan_chart(columns: Columns, pushes: Sequence[Push], period_s: float) -> Chart:
    """A mark per replan over the motion: a circle, or a cross if it has no solution."""
    time_s, took_ms = columns["time_s"], columns["replan_ms"]
    finite_ms = took_ms[np.isfinite(took_ms)]
    end_s = float(time_s[-1])
    high = 1.08 * max(float(finite_ms.max(initial=0.0)), LIMIT_MS)
    canvas = Chart((0.0, end_s), (0.0, high), "time in the motion [s]", "replan [ms]", width=900.0, height=270.0)
    for at_s, push in zip(effect_times_s(pushes, period_s), pushes, strict=True):
        if at_s <= end_s:
            canvas.add_vertical_line(at_s, 0.0, high, "push")
            canvas.add_mark(at_s, 0.97 * high, "push", "triangle", f"Pushed by {push_text(push)} at {at_s:.2f} s")
    canvas.add_horizontal_line(LIMIT_MS, 0.0, end_s, "rule")
    for at_s, ms, iterations, continued in zip(
        time_s, took_ms, columns["iterations"], columns["carried_on"], strict=True
    ):
        if np.isfinite(ms):
            text = f"{at_s:.2f} s: {ms:.0f} ms, {iterations:.0f} iterations"
            text += ", no solution: the previous plan continued" if continued else ""
            canvas.add_mark(
                at_s, ms, "late" if ms > LIMIT_MS or continued else "timely", "cross" if continued else "circle", text
            )
    return canvas.with_caption(
        f"Processor time of each replan over the motion; the line is the {LIMIT_MS:.0f} ms of 20 Hz."
    )


def receding_curves(columns: Columns, pushes: Sequence[Push], period_s: float) -> dict[str, Any]:
    """Plot document of the executed CoM, velocity and angular momentum; periods after pushes are shaded."""
    decimals = dict.fromkeys(_COM, 5) | dict.fromkeys(_VELOCITY, 4) | dict.fromkeys(_MOMENTUM, 5) | {"replan_ms": 1}
    rows = [
        *(Row(f"CoM {axis} [m]", (Trace(key, "executed", "main"),)) for axis, key in zip("xyz", _COM, strict=True)),
        xyz_row("Velocity [m/s]", _VELOCITY),
        xyz_row("Momentum L [N m s]", _MOMENTUM),
    ]
    readings = [Reading(axis, key, "m", 4) for axis, key in zip("xyz", _COM, strict=True)]
    readings += [Reading(f"v{axis}", key, "m/s", 3) for axis, key in zip("xyz", _VELOCITY, strict=True)]
    readings.append(Reading("replan", "replan_ms", "ms", 0))
    shades_s = [(at_s, min(at_s + period_s, float(columns["time_s"][-1]))) for at_s in effect_times_s(pushes, period_s)]
    return plot_document(columns, decimals, rows, readings, shades_s)


def push_text(push: Push) -> str:
    """Change of velocity of a push as text, by axis."""
    parts = [f"{v:+.2f} m/s in {axis}" for axis, v in zip("xyz", push.velocity_m_s, strict=True) if v]
    return ", ".join(parts) or "nothing"


KIND: Final = "plan-receding"
AT_REST_M: Final = 1e-5
"""Distance from its place of rest below which the CoM counts as at rest."""


async def receding_of(files: JobFiles, result: JobResult) -> dict[str, Any]:
    """Values of _receding.html."""
    content = await files.read_file(TABLE)
    columns = await run_in_threadpool(read_columns, content) if content is not None else None
    job_input = PlanRecedingInput.model_validate(result.input)
    summary = PlanRecedingSummary.model_validate(result.summary)
    felt = zip(effect_times_s(job_input.pushes, job_input.period_s), job_input.pushes, strict=True)
    at_rest = summary.goal_gap_m < AT_REST_M
    chart = None
    if columns is not None:
        chart = await run_in_threadpool(replan_chart, columns, job_input.pushes, job_input.period_s)
    return {
        "summary": summary,
        "input": job_input,
        "text": f"{_timely_replans(columns)} motion was replanned every {with_unit(job_input.period_s, 's')}, "
        f"{with_unit(job_input.horizon_s, 's')} ahead.",
        "ends": "at its place of rest" if at_rest else f"{with_unit(summary.goal_gap_m, 'm')} from its place of rest",
        "pushes": [{"at_s": at_s, "text": push_text(push)} for at_s, push in felt],
        "chart": chart,
        "limit_ms": LIMIT_MS,
    }


def _timely_replans(columns: Columns | None) -> str:
    """How many replans took at most a period of 20 Hz, and the beginning of the next clause."""
    if columns is None:
        return "The"
    took_ms = columns["replan_ms"][np.isfinite(columns["replan_ms"])]
    within = int((took_ms <= LIMIT_MS).sum())
    return f"{within} of {len(took_ms)} replans took at most {LIMIT_MS:.0f} ms, the period of 20 Hz; the"


async def receding_plot(client: AsyncClient, job_id: str, result: JobResult) -> dict[str, Any]:
    """Plot document of the same page."""
    columns = await _read_table(client, job_id)
    job_input = PlanRecedingInput.model_validate(result.input)
    return await run_in_threadpool(receding_curves, columns, job_input.pushes, job_input.period_s)


async def _read_table(client: AsyncClient, job_id: str) -> Columns:
    content = await client.read_artifact(job_id, TABLE)
    return await run_in_threadpool(read_columns, content)
