"""A person and a robot in one table and in curves over a step, computed by the same functions.

Scaled values are those of a robot that walked exactly as the person: lengths times s, the ratio of the heights of the
hips, times and speeds times sqrt(s), rates over sqrt(s).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np

from stridelab.conventions import Series
from stridelab.errors import StridelabError
from stridelab.measures.extrapolated_com import extrapolated_com
from stridelab.measures.margin_of_stability import margins_of_stability, sideways_margin_m
from stridelab.measures.spatiotemporal import spatiotemporal
from stridelab.measures.walk_motion import AHEAD, LEFT, OTHER_SIDE, UP, WalkMotion
from stridelab.schemas.imitation.contract import ComparedQuantity
from stridelab.walking.step_fit import StepFit, fit_step, select_samples
from stridelab.walking.steps import GaitStep

MEASURES: Final = (
    "walking_speed",
    "step_length",
    "step_width",
    "step_time",
    "double_support_share",
    "com_vertical_excursion",
    "com_lateral_excursion",
    "margin_of_stability_ml_min",
    "margin_of_stability_ap_contact",
)
"""Measures of gait in the table, in this order."""
WHEEL: Final[Mapping[str, str]] = {"wheel_R": "m", "wheel_r": "m", "wheel_z0": "m", "wheel_omega": "rad/s"}
OF_LEVEL_GROUND: Final = (
    "com_height",
    "com_vertical_excursion",
    "margin_of_stability_ml_min",
    "margin_of_stability_ap_contact",
    *WHEEL,
)
"""Quantities that stairs do not have: heights above one floor, and margins of a pendulum of this height."""
CURVE_POINTS: Final = 101
_POWER: Final[Mapping[str, float]] = {"m": 1.0, "s": 0.5, "m/s": 0.5, "rad/s": -0.5, "1": 0.0}
"""Power of s with which a quantity of a unit scales."""


@dataclass(frozen=True)
class Walker:
    """A walk to compare: its motion, its steps, and the wheels fitted to them.

    ``rises_m`` are those from foothold to foothold on stairs, empty on level ground.
    """

    motion: WalkMotion
    steps: tuple[GaitStep, ...]
    fits: tuple[StepFit, ...]
    rises_m: tuple[float, ...] = ()

    @classmethod
    def of_motion(cls, motion: WalkMotion, steps: Sequence[GaitStep], rises_m: Sequence[float] = ()) -> "Walker":
        """Fit a wheel to every step that allows it, on level ground."""
        return cls(motion, tuple(steps), () if rises_m else tuple(_fitted_wheels(motion, steps)), tuple(rises_m))


def compare_walks(person: Walker, robot: Walker, ratio: float) -> list[ComparedQuantity]:
    """The rows of the table; ``ratio`` is s."""
    sides = [_values(person), _values(robot)]
    rows = []
    names = ["com_height", *MEASURES, *WHEEL]
    if person.rises_m:
        names = ["step_rise", *(name for name in names if name not in OF_LEVEL_GROUND)]
    for name in names:
        (unit, own), (_, other) = (side.get(name, ("", [])) for side in sides)
        unit = unit or sides[1].get(name, ("1", []))[0]
        mean = float(np.mean(own)) if own else None
        rows.append(
            ComparedQuantity(
                name=name,
                unit=unit,
                person=mean,
                scaled=None if mean is None else mean * ratio ** _POWER[unit],
                robot=float(np.mean(other)) if other else None,
                n_person=len(own),
                n_robot=len(other),
            )
        )
    return rows


def compared_curves(person: Walker, robot: Walker, ratio: float) -> dict[str, np.ndarray]:
    """Mean curves from a foot's lift-off (0) to the other's (1); those of the person are scaled to the robot.

    Heights and speeds are differences from their mean over the step. Sideways is towards the standing foot, from the
    middle of the step. The margin is that of ``sideways_margin_m`` of the standing foot, NaN after the mean strike.
    """
    share = np.linspace(0.0, 1.0, CURVE_POINTS)
    columns: dict[str, np.ndarray] = {"step_share": share}
    for name, walker, s in (("person", person, ratio), ("robot", robot, 1.0)):
        of_steps = (_curves_of_step(walker.motion, step, share) for step in walker.steps)
        curves = [curve for curve in of_steps if curve is not None]
        if walker.rises_m:
            curves = [curve | {"margin_m": np.full_like(share, np.nan)} for curve in curves]
        powers = {"com_height_m": s, "com_sideways_m": s, "com_speed_m_s": sqrt(s), "margin_m": s}
        for column, factor in powers.items():
            tracks = [curve[column] for curve in curves]
            columns[f"{name}_{column}"] = factor * np.mean(tracks, axis=0) if tracks else np.full(len(share), np.nan)
    return columns


def _values(walker: Walker) -> dict[str, tuple[str, list[float]]]:
    """Unit and values per step of every quantity."""
    values: dict[str, tuple[str, list[float]]] = {}
    for measure in (*spatiotemporal(walker.motion, walker.steps), *margins_of_stability(walker.motion, walker.steps)):
        values.setdefault(measure.name, (measure.unit, []))[1].append(measure.value)
    heights = [float(walker.motion.com_m[walker.motion.samples(s.start_s, s.end_s), UP].mean()) for s in walker.steps]
    values["com_height"] = ("m", heights)
    values["step_rise"] = ("m", [rise for rise in walker.rises_m if rise != 0.0])
    wheels = [(f.path.wheel.R_m, f.path.wheel.r_m, f.path.wheel.z0_m, abs(f.omega_rad_s)) for f in walker.fits]
    for k, (name, unit) in enumerate(WHEEL.items()):
        values[name] = (unit, [wheel[k] for wheel in wheels])
    return values


def _fitted_wheels(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[StepFit]:
    path = motion.com_m[:, [AHEAD, UP]]
    fits = []
    for step in steps:
        samples = select_samples(motion.time_s, step.start_s, step.end_s, ())
        if samples is None:
            continue
        try:
            fit = fit_step(step, motion.time_s[samples], path[samples])
        except StridelabError:
            continue
        if fit.path.converged:
            fits.append(fit)
    return fits


def _curves_of_step(motion: WalkMotion, step: GaitStep, share: Series) -> dict[str, Series] | None:
    if not motion.covers(step.start_s, step.end_s):
        return None
    at_s = step.start_s + share * (step.end_s - step.start_s)
    com, velocity = (
        [np.interp(at_s, motion.time_s, track) for track in t.T] for t in (motion.com_m, motion.velocity_m_s)
    )
    standing = OTHER_SIDE[step.side]
    outwards = 1.0 if standing == "left" else -1.0
    margin = np.interp(at_s, motion.time_s, sideways_margin_m(motion, extrapolated_com(motion), standing))
    single = at_s <= step.strike_s
    return {
        "com_height_m": com[UP] - com[UP].mean(),
        "com_sideways_m": outwards * (com[LEFT] - 0.5 * (com[LEFT].max() + com[LEFT].min())),
        "com_speed_m_s": velocity[AHEAD] - velocity[AHEAD].mean(),
        "margin_m": np.where(single, margin, np.nan),
    }
