"""The rolling wheel on the page of a job: all steps, and charts of one of them.

The charts are the wheel at true scale, the path stretched (fig. 3.5), residuals, and theta (fig. 3.9a).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from starlette.concurrency import run_in_threadpool

from stridelab.schemas.cycloid import FitCycloidSummary
from stridelab.schemas.jobs import JobResult
from stridelab.translations.catalogue import gettext, ngettext
from stridelab_web.api_client import JobFiles
from stridelab_web.charts.svg import Chart, range_of
from stridelab_web.pages.results.cycloid_steps import (
    PARAMETERS,
    WheelStep,
    contests_of,
    medians_of,
    steps_of,
    values_of,
)
from stridelab_web.parquet import Columns, read_columns
from stridelab_web.scene.cycloid_frames import radius_m

WHEEL_TABLE: Final = "wheel.parquet"
MM = 1000.0
WIDE_PX, HALF_PX, TALL_PX = 920.0, 560.0, 290.0
SAMPLES_SHOWN: Final = 40
"""Maximum number of measured samples that are drawn as dots."""


@dataclass(frozen=True)
class StepCharts:
    """The four charts; ``stretched`` is the vertical scale over the horizontal one in ``rescaled``."""

    true_scale: Chart
    rescaled: Chart
    stretched: float
    residuals: Chart
    theta: Chart
    off_line_rad: float
    R_m: float


def samples_of(columns: Columns, step: WheelStep) -> Columns:
    """The rows of ``wheel.parquet`` that belong to ``step``: those with the most frequent number in its interval."""
    time, number = columns["time_s"], columns["step"]
    inside = (time >= step.fit.t0_s - 1e-3) & (time <= step.fit.t1_s + 1e-3)
    if not inside.any():
        return {name: values[:0] for name, values in columns.items()}
    numbers, counts = np.unique(number[inside], return_counts=True)
    mine = number == numbers[np.argmax(counts)]
    return {name: values[mine] for name, values in columns.items()}


def draw_step(samples: Columns, step: WheelStep) -> StepCharts:
    """All charts of a step; ``samples`` are its rows of ``wheel.parquet``, at least two."""
    time, theta = samples["time_s"], samples["theta_rad"]
    omega, theta0 = np.polyfit(time - time[0], theta, 1)
    line = theta0 + omega * (time - time[0])
    R_m = radius_m(samples)
    rescaled, stretched = _rescaled_chart(samples, step)
    return StepCharts(
        true_scale=_true_scale_chart(samples, R_m, step),
        rescaled=rescaled,
        stretched=stretched,
        residuals=_residual_chart(samples, step),
        theta=_theta_chart(samples, line, step),
        off_line_rad=float(np.sqrt(np.mean((theta - line) ** 2))),
        R_m=R_m,
    )


def _true_scale_chart(samples: Columns, R_m: float, step: WheelStep) -> Chart:
    start_m, z0 = samples["x_ahead_m"][0], float(samples["hub_z_m"][0])
    ahead, hub = samples["x_ahead_m"] - start_m, samples["hub_x_m"] - start_m
    point = samples["model_x_m"] - start_m
    size = abs(R_m)
    x = range_of(ahead, hub - size, hub + size, share=0.02)
    y = (z0 - size - 0.03, max(z0 + size, float(samples["z_m"].max())) + 0.02)
    canvas = Chart(
        x, y, gettext("Distance ahead since the step began [m]"), gettext("Height [m]"), WIDE_PX, true_scale=True
    )
    canvas.add_horizontal_line(z0 - size, *x, "ground")
    canvas.add_horizontal_line(z0, float(hub.min()), float(hub.max()), "hub-line")
    for k in _drawn_instants(samples["theta_rad"]):
        canvas.add_circle(float(hub[k]), z0, size, "rim")
        canvas.add_curve(np.array([hub[k], point[k]]), np.array([z0, samples["model_z_m"][k]]), "spoke")
        canvas.add_mark(float(hub[k]), z0, "hub", "ring")
        canvas.add_mark(float(point[k]), float(samples["model_z_m"][k]), "point", "circle")
    canvas.add_curve(ahead, samples["z_m"], "measured", gettext("centre of mass"))
    canvas.add_curve(point, samples["model_z_m"], "wheel", gettext("point on the wheel"))
    return canvas.with_caption(
        gettext(
            "%(step)s at true scale: the wheel of radius %(radius)s mm and the path of its point.",
            step=step.name,
            radius=f"{MM * R_m:.0f}",
        )
    )


def _drawn_instants(theta: np.ndarray) -> list[int]:
    """Indices of the first and last sample, and of those nearest to the lowest and highest points between."""
    turns = np.arange(np.ceil(theta.min() / np.pi), np.floor(theta.max() / np.pi) + 1) * np.pi
    between = [int(np.argmin(np.abs(theta - angle))) for angle in turns]
    apart = max(len(theta) // 12, 1)
    return [0, *(k for k in between if apart <= k <= len(theta) - 1 - apart), len(theta) - 1]


def _rescaled_chart(samples: Columns, step: WheelStep) -> tuple[Chart, float]:
    start_m, z0 = samples["x_ahead_m"][0], samples["hub_z_m"]
    ahead, point = samples["x_ahead_m"] - start_m, samples["model_x_m"] - start_m
    up, model = MM * (samples["z_m"] - z0), MM * (samples["model_z_m"] - z0)
    canvas = Chart(
        range_of(ahead, point, share=0.03), range_of(up, model, min_width=10.0),
        gettext("Distance ahead since the step began [m]"), gettext("Height over the hub [mm]"), HALF_PX, TALL_PX,
    )  # fmt: skip
    canvas.add_horizontal_line(0.0, *canvas.x_range, "hub-line")
    canvas.add_curve(point, model, "wheel", gettext("point on the wheel"))
    for k in np.unique(np.linspace(0, len(ahead) - 1, min(SAMPLES_SHOWN, len(ahead))).round().astype(int)):
        canvas.add_mark(float(ahead[k]), float(up[k]), "measured", "circle")
    stretched = MM * (canvas.y_px(0.0) - canvas.y_px(1.0)) / canvas.px_per_x
    return canvas.with_caption(
        gettext(
            "%(step)s with heights stretched %(times)s times: samples and fitted curve.",
            step=step.name,
            times=f"{stretched:.0f}",
        )
    ), stretched


def _residual_chart(samples: Columns, step: WheelStep) -> Chart:
    time = samples["time_s"]
    ahead, up = MM * samples["error_x_m"], MM * samples["error_z_m"]
    canvas = Chart(
        (float(time[0]), float(time[-1])), range_of(ahead, up, np.zeros(1), min_width=1.0),
        gettext("Time [s]"), gettext("Model minus measurement [mm]"), HALF_PX, TALL_PX,
    )  # fmt: skip
    _shade_double_support(canvas, step)
    canvas.add_horizontal_line(0.0, *canvas.x_range, "zero")
    canvas.add_curve(time, ahead, "ahead", gettext("ahead"))
    canvas.add_curve(time, up, "up", gettext("up"))
    return canvas.with_caption(gettext("%(step)s: residuals of the path, ahead and up, over time.", step=step.name))


def _theta_chart(samples: Columns, line: np.ndarray, step: WheelStep) -> Chart:
    time, theta = samples["time_s"], samples["theta_rad"]
    canvas = Chart(
        (float(time[0]), float(time[-1])),
        range_of(theta, line, min_width=1.0),
        gettext("Time [s]"),
        "θ [rad]",
        HALF_PX,
        TALL_PX,
    )
    _shade_double_support(canvas, step)
    canvas.add_curve(time, line, "line", gettext("the line through them"))
    for k in np.unique(np.linspace(0, len(time) - 1, min(SAMPLES_SHOWN, len(time))).round().astype(int)):
        canvas.add_mark(float(time[k]), float(theta[k]), "measured", "circle")
    return canvas.with_caption(gettext("%(step)s: the angle of every sample, and a line through them.", step=step.name))


def _shade_double_support(canvas: Chart, step: WheelStep) -> None:
    """Shade the measured double support, and mark the instants of the thesis' rule."""
    start, end = step.fit.double_support_s
    canvas.add_shade(
        start,
        end,
        "double",
        gettext("both feet down, %(start)s s to %(end)s s", start=f"{start:.3f}", end=f"{end:.3f}"),
    )
    for timing in step.timings:
        if timing.rule_s is not None and canvas.x_range[0] <= timing.rule_s <= canvas.x_range[1]:
            canvas.add_vertical_line(timing.rule_s, *canvas.y_range, "rule")


KIND: Final = "fit-cycloid"
MIN_SAMPLES: Final = 4
SOURCES: Final = {"plates": "Plates", "markers": "Markers", "mixed": "Plates and markers"}


async def cycloid_of(files: JobFiles, result: JobResult, step_number: str) -> dict[str, Any]:
    """Values for the template; shows the step of the given number (from 1), or the first one."""
    summary = FitCycloidSummary.model_validate(result.summary)
    steps = steps_of(summary)
    number = int(step_number) if step_number.isdecimal() and 1 <= int(step_number) <= len(steps) else 1
    shown = steps[number - 1] if steps else None
    charts = None
    if shown is not None and any(item.name == WHEEL_TABLE for item in result.artifacts):
        content = await files.read_file(WHEEL_TABLE)
        charts = await run_in_threadpool(_step_charts, content, shown) if content is not None else None
    return {
        "summary": summary,
        "headline": _wheel_error_sentence(steps),
        "steps": steps,
        "parameters": PARAMETERS,
        "sources": SOURCES,
        "medians": medians_of(steps),
        "shown": shown,
        "charts": charts,
        "lines": values_of(shown, summary.step_to_step_sd) if shown else (),
        "contests": contests_of(shown, steps) if shown else (),
        "previous": number - 1 if number > 1 else None,
        "next": number + 1 if number < len(steps) else None,
    }


def _wheel_error_sentence(steps: Sequence[WheelStep]) -> str:
    """How far the paths are from those of their wheels; empty without a step."""
    if not steps:
        return ""
    mean_mm = sum(step.fit.error_mean_mm for step in steps) / len(steps)
    max_mm = max(step.fit.error_max_mm for step in steps)
    return ngettext(
        "%(num)s step: the centre of mass is %(mean)s mm from its wheel's path on average, %(max)s mm at most.",
        "%(num)s steps: the centre of mass is %(mean)s mm from its wheel's path on average, %(max)s mm at most.",
        len(steps),
        mean=f"{mean_mm:.1f}",
        max=f"{max_mm:.1f}",
    )


def _step_charts(content: bytes, step: WheelStep) -> StepCharts | None:
    samples = samples_of(read_columns(content), step)
    return draw_step(samples, step) if len(samples["time_s"]) >= MIN_SAMPLES else None
