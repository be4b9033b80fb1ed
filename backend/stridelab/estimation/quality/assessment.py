"""Builds the checks of an estimate from its measures; each check names the sensors that it compares."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.quality.checks import Check, Quality
from stridelab.estimation.quality.limits import limit_of
from stridelab.estimation.quality.measures import Measures, Recorded, compute_measures
from stridelab.estimation.quality.pressure import PlatePressure

MM: Final = 1e3
WITHOUT_FORCE: Final = "no force was used"
MARKER_CHECKS: Final = ("outside_body", "leg_length_change")
"""Checks that need no force."""


def assess_quality(recorded: Recorded, estimate: ComEstimate) -> Quality:
    """Run all checks that ``recorded`` allows on ``estimate``; the others are listed with the reason."""
    measures = compute_measures(recorded, estimate)
    return evaluate_checks(measures, recorded.mass_to_check_kg, recorded.geometric.sd_m, with_force=recorded.with_force)


def evaluate_checks(
    measures: Measures, mass_kg: float, geometry_sd_m: tuple[float, float, float], *, with_force: bool = True
) -> Quality:
    """Checks of the numbers ``found``; ``mass_kg`` is the stated mass, else the used one."""
    checks, not_checked = [], {}
    for row in (*_force_rows(measures, mass_kg), *_plate_rows(measures), *_body_rows(measures, with_force=with_force)):
        if math.isnan(row.value):
            not_checked[row.name] = row.missing if with_force or row.name in MARKER_CHECKS else WITHOUT_FORCE
            continue
        limit = limit_of(row.name, geometry_sd_m)
        ending = "agree" if row.value <= limit.passes else "agree poorly"
        if row.value > limit.contradicts:
            ending = "contradict each other"
        message = f"{row.finding}: {row.sensors} {ending}."
        checks.append(Check(row.name, row.value, limit.unit, limit.passes, limit.contradicts, message))
    return Quality(tuple(checks), not_checked)


@dataclass(frozen=True)
class _CheckRow:
    """Value of one check with its message parts: finding, compared sensors, and the reason for a missing value."""

    name: str
    value: float
    finding: str
    sensors: str
    missing: str


def _force_rows(measures: Measures, mass_kg: float) -> Iterator[_CheckRow]:
    motion, standing = abs(measures.motion_mass_kg / mass_kg - 1.0), abs(measures.standing_mass_kg / mass_kg - 1.0)
    times = math.sqrt(max(measures.normalised_innovations, 0.0))
    yield _CheckRow(
        "normalised_innovations",
        measures.normalised_innovations,
        f"Force and markers differ by {times:.1f} times the errors that the smoother expects "
        f"(normalised innovations {measures.normalised_innovations:.2f})",
        "the plates and the markers",
        "only the smoother has innovations",
    )
    yield _CheckRow(
        "force_residual",
        measures.force_residual,
        f"The motion of the centre of mass needs a force that differs by {measures.force_residual:.1%} of the "
        "body weight "
        "from the measured one",
        "the plates' force and the markers or the mass",
        "the interval with all force is too short",
    )
    yield _CheckRow(
        "acceleration_difference",
        measures.acceleration_difference,
        f"The accelerations of the markers need a force that differs {measures.axis} by "
        f"{measures.acceleration_difference:.1%} of the body weight from the measured one",
        "the plates' force (a channel, its sign or its clock) and the markers",
        "the interval with all force is too short",
    )
    yield _CheckRow(
        "horizontal_bias",
        measures.horizontal_bias_m,
        f"The force puts the centre of mass {MM * measures.horizontal_bias_m:.0f} mm, horizontally, from where the "
        "markers put it",
        "the plates' centre of pressure (their moments or their place) and the markers",
        "no frame has both force and geometry",
    )
    yield _CheckRow(
        "vertical_bias",
        measures.vertical_bias_m,
        f"The force puts the centre of mass {MM * measures.vertical_bias_m:.0f} mm above or below the markers'",
        "the plates' vertical force and the markers",
        "no frame has both force and geometry",
    )
    yield _CheckRow(
        "mass_from_motion",
        motion,
        f"The plates' force moves the body as if it weighed {measures.motion_mass_kg:.1f} kg, and its mass is "
        f"{mass_kg:.1f} kg ({motion:.1%} apart)",
        "the plates' vertical force and the mass",
        "no stretch has both force and geometry",
    )
    yield _CheckRow(
        "mass_from_standing",
        standing,
        f"The plates weigh {measures.standing_mass_kg:.1f} kg in the static trial, and the mass is {mass_kg:.1f} kg "
        f"({standing:.1%} apart)",
        "the static trial and the mass",
        "no static trial stands still on the plates",
    )


def _plate_rows(measures: Measures) -> Iterator[_CheckRow]:
    feet, off = _worst_plate(measures, "from_feet_m"), _worst_plate(measures, "off_plate")
    yield _CheckRow(
        "pressure_from_feet",
        feet.from_feet_m,
        f"The centre of pressure of plate {feet.index} lies {MM * feet.from_feet_m:.0f} mm from the markers of the "
        "nearest standing foot",
        f"plate {feet.index} (its place, its moments or its channels) and the foot markers",
        "the feet are not marked, or no plate carries them",
    )
    yield _CheckRow(
        "pressure_off_plate",
        off.off_plate,
        f"The centre of pressure of plate {off.index} lies outside its corners for {off.off_plate:.0%} of the loaded "
        "time",
        f"the moments and the corners of plate {off.index}",
        "no plate with corners of its own is loaded",
    )


def _body_rows(measures: Measures, *, with_force: bool) -> Iterator[_CheckRow]:
    yield _CheckRow(
        "outside_body",
        measures.outside_body_m,
        f"The centre of mass lies {MM * measures.outside_body_m:.0f} mm outside the body that the markers bound",
        "the plates and the markers" if with_force else "the markers and the segment model",
        "too few markers are seen to bound a body",
    )
    yield _CheckRow(
        "leg_length_change",
        measures.leg_length_change,
        f"The length of the {measures.leg} changes by {measures.leg_length_change:.0%}",
        "the markers of that leg",
        "no thigh or shank has both its joints",
    )


def _worst_plate(measures: Measures, name: str) -> PlatePressure:
    """Plate with the largest value of the attribute ``name``; a plate of NaN if all values are NaN."""
    known = [plate for plate in measures.plates if not math.isnan(getattr(plate, name))]
    nothing = PlatePressure(0, math.nan, math.nan)
    return max(known, key=lambda plate: float(getattr(plate, name)), default=nothing)
