"""Scatter charts of a population: a mark with error bars per subject, groups by colour and shape."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.schemas.population import SubjectResult
from stridelab.translations.catalogue import gettext
from stridelab_web.charts.svg import SHAPES, Chart, Shape, range_of
from stridelab_web.pages.results.cycloid_steps import PARAMETERS, Parameter

WIDTH_PX, HEIGHT_PX = 560.0, 330.0
COLOURS: Final = 6
"""Classes ``group0`` to ``group5`` of the style sheet; further groups reuse them."""
MIN_FOR_LINE: Final = 3


@dataclass(frozen=True)
class Quantity:
    """A quantity that the wheel's parameters are plotted against; ``against`` is its heading."""

    key: str
    name: str
    unit: str
    against: str

    @property
    def axis_title(self) -> str:
        """Title of an axis."""
        return f"{gettext(self.name)} [{self.unit}]"


AGAINST: Final = (
    Quantity("height_m", "Height", "m", "Against height"),
    Quantity("leg_m", "Leg", "m", "Against leg"),
    Quantity("speed_m_s", "Speed", "m/s", "Against speed"),
    Quantity("step_length_m", "Step length", "m", "Against step length"),
)


@dataclass(frozen=True)
class Group:
    """A group with its class and shape."""

    name: str
    css: str
    shape: Shape
    size: int


def groups_of(subjects: Sequence[SubjectResult]) -> dict[str, Group]:
    """The groups by name, in the order in which they come."""
    names = dict.fromkeys(subject.group for subject in subjects)
    return {
        name: Group(name, f"group{k % COLOURS}", SHAPES[k % len(SHAPES)], sum(s.group == name for s in subjects))
        for k, name in enumerate(names)
    }


def charts_against(subjects: Sequence[SubjectResult], against: Quantity) -> list[tuple[Parameter, Chart]]:
    """R, r, z0 and omega against one quantity, if any subject has both."""
    drawn = ((parameter, scatter_chart(subjects, against, parameter)) for parameter in PARAMETERS)
    return [(parameter, chart) for parameter, chart in drawn if chart is not None]


def scatter_chart(subjects: Sequence[SubjectResult], against: Quantity, parameter: Parameter) -> Chart | None:
    """One parameter against one quantity of the subjects, with deviations over steps and a line per group."""
    shown = [subject for subject in subjects if getattr(subject, against.key) is not None]
    if not shown:
        return None
    x = np.array([getattr(s, against.key) for s in shown], dtype=float)
    y = parameter.factor * np.array([getattr(s, parameter.key) for s in shown], dtype=float)
    sd = parameter.factor * np.array([getattr(s, parameter.sd_key) or 0.0 for s in shown], dtype=float)
    x_range, y_range = range_of(x, min_width=0.02), range_of(y - sd, y + sd, min_width=1e-3)
    canvas = Chart(x_range, y_range, against.axis_title, parameter.axis_title, WIDTH_PX, HEIGHT_PX)
    names = np.array([subject.group for subject in shown])
    for group in groups_of(subjects).values():
        in_group = names == group.name
        _add_trend(canvas, x[in_group], y[in_group], group)
        for k in np.flatnonzero(in_group):
            person = shown[int(k)]
            canvas.add_vertical_line(float(x[k]), float(y[k] - sd[k]), float(y[k] + sd[k]), f"error {group.css}")
            canvas.add_mark(
                float(x[k]), float(y[k]), group.css, group.shape, _mark_text(person, parameter, against), person.subject
            )
    return canvas.with_caption(
        gettext(
            "%(parameter)s, %(meaning)s. %(against)s of %(number)s people.",
            parameter=parameter.letter,
            meaning=gettext(parameter.meaning),
            against=gettext(against.against),
            number=len(shown),
        )
    )


def _add_trend(canvas: Chart, x: np.ndarray, y: np.ndarray, group: Group) -> None:
    if len(x) < MIN_FOR_LINE or np.ptp(x) <= 0.0:
        return
    slope, at_zero = np.polyfit(x, y, 1)
    ends = np.array([x.min(), x.max()])
    canvas.add_curve(
        ends, at_zero + slope * ends, f"trend {group.css}", gettext("least squares, %(group)s", group=group.name)
    )


def _mark_text(subject: SubjectResult, parameter: Parameter, against: Quantity) -> str:
    sd = getattr(subject, parameter.sd_key)
    about = f" ± {parameter.format_value(sd)}" if sd is not None else ""
    value, other = getattr(subject, parameter.key), getattr(subject, against.key)
    return (
        f"{subject.subject} ({subject.group}): {parameter.letter} {parameter.format_value(value)}{about} "
        f"{parameter.unit},"
        f" {gettext(against.name).lower()} {other:.2f} {against.unit}"
    )
