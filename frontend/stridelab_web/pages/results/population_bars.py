"""A value and its deviation per person as bars (figs. 3.6 and 3.10), in percent of the width of their axis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from stridelab.schemas.population import SubjectResult
from stridelab.translations.catalogue import gettext
from stridelab_web.charts.svg import Shape, axis_ticks
from stridelab_web.pages.results.population_charts import groups_of

THESIS_ERROR_MM: Final = 3.5
"""Fig. 3.6: "the mean reconstruction for all the subjects remains below 3.5mm"."""
TICKS: Final = 6
_OVER_STEPS: Final = "Mean and standard deviation over a person's steps; dashed: no error."
TITLES: Final = {
    "distance": (
        "Distance of the path from the wheel [mm] (fig. 3.6)",
        "Mean over steps, and standard deviation within a step. Dashed: 3.5 mm, the thesis' limit of every mean.",
    ),
    "start": ("Start of double support, thesis' rule minus measured [ms] (fig. 3.10)", _OVER_STEPS),
    "end": ("End of double support, thesis' rule minus measured [ms] (fig. 3.10)", _OVER_STEPS),
}
"""Title and hint of each figure."""
MS: Final = 1000.0

Reading = Callable[[SubjectResult], tuple[float | None, float | None]]
"""Returns the value of a subject and its standard deviation."""


@dataclass(frozen=True)
class Bar:
    """One person; positions in percent."""

    subject: str
    css: str
    shape: Shape
    at: float
    low: float
    width: float
    text: str


@dataclass(frozen=True)
class Bars:
    """Bars of all subjects with a value; ``line`` is the position of the thesis' value, or of zero."""

    key: str
    title: str
    hint: str
    bars: tuple[Bar, ...]
    ticks: tuple[tuple[float, str], ...]
    line: float


def bars_of(subjects: Sequence[SubjectResult]) -> tuple[Bars, ...]:
    """The figures that have data: distance from the wheel, and both ends of double support."""
    wanted: tuple[tuple[str, Reading, float], ...] = (
        ("distance", lambda s: (s.error_mean_mm, s.error_sd_mm), THESIS_ERROR_MM),
        (
            "start",
            lambda s: (_milliseconds(s.double_support_start_error_s), _milliseconds(s.double_support_start_error_sd_s)),
            0.0,
        ),
        (
            "end",
            lambda s: (_milliseconds(s.double_support_end_error_s), _milliseconds(s.double_support_end_error_sd_s)),
            0.0,
        ),
    )
    figures = []
    for key, read, line in wanted:
        title, hint = TITLES[key]
        values = [(s, value, sd or 0.0) for s in subjects for value, sd in (read(s),) if value is not None]
        if values:
            figures.append(_draw_bars(key, title, hint, subjects, values, line))
    return tuple(figures)


def _draw_bars(
    key: str,
    title: str,
    hint: str,
    subjects: Sequence[SubjectResult],
    values: Sequence[tuple[SubjectResult, float, float]],
    line: float,
) -> Bars:
    low = min(0.0, line, *(value - sd for _, value, sd in values))
    high = max(0.0, line, *(value + sd for _, value, sd in values))
    margin = 0.04 * (high - low)
    low, high = (low - margin if low < 0 else low), high + margin
    look = groups_of(subjects)

    def to_percent(value: float) -> float:
        return round(100 * (value - low) / (high - low), 2)

    bars = []
    for subject, value, sd in values:
        group, start = look[subject.group], max(value - sd, low)
        description = gettext(
            "%(subject)s: %(value)s, standard deviation %(sd)s",
            subject=subject.subject,
            value=f"{value:z.2f}",
            sd=f"{sd:.2f}",
        )
        width = round(to_percent(value + sd) - to_percent(start), 2)
        bars.append(
            Bar(subject.subject, group.css, group.shape, to_percent(value), to_percent(start), width, description)
        )
    marks = tuple((to_percent(value), text) for value, text in axis_ticks((low, high), TICKS))
    return Bars(key, title, hint, tuple(bars), marks, to_percent(line))


def _milliseconds(value_s: float | None) -> float | None:
    return None if value_s is None else MS * value_s
