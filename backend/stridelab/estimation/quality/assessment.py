"""Builds the checks of an estimate from its measures; each check names the sensors that it compares.

Result of one check, and the overall verdict of all checks.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.quality.channel_gain import ChannelGain
from stridelab.estimation.quality.limits import LEG_MASS_SHARE, THIGH_OVER_TRUNK, limit_of
from stridelab.estimation.quality.measures import Measures, Recorded, compute_measures
from stridelab.estimation.quality.plate_checks import PlatePressure
from stridelab.recordings.recording import Remark

Verdict = Literal["good", "doubtful", "contradicted"]
VERDICT_ORDER: Final[tuple[Verdict, ...]] = ("good", "doubtful", "contradicted")
CONTRADICTED: Final = "contradicted"
DOUBTFUL: Final = "doubtful"
"""Codes of the remarks, and verdicts."""


@dataclass(frozen=True)
class Check:
    """One value with its limits: it passes up to ``limit`` and contradicts above ``contradicted_above``.

    ``unit`` is "1" for a ratio. ``message`` is a sentence that names the compared sensors.
    """

    name: str
    value: float
    unit: str
    limit: float
    contradicted_above: float
    message: str

    @property
    def passed(self) -> bool:
        """Whether the value is within its limit."""
        return self.value <= self.limit

    @property
    def contradicts(self) -> bool:
        """Whether the compared sensors contradict each other."""
        return self.value > self.contradicted_above


@dataclass(frozen=True)
class Quality:
    """Results of all possible checks, and by name the reasons why others were not possible."""

    checks: tuple[Check, ...]
    not_checked: Mapping[str, str] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """Contradicted if a check contradicts, doubtful if a check does not pass or none was possible, else good."""
        if any(check.contradicts for check in self.checks):
            return "contradicted"
        return "good" if self.checks and all(check.passed for check in self.checks) else "doubtful"

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """One remark for the verdict, to be shown before all others; empty for a good verdict."""
        if self.verdict == "good":
            return ()
        wrong = [c for c in self.checks if (c.contradicts if self.verdict == CONTRADICTED else not c.passed)]
        reasons = " ".join(check.message for check in wrong) or "No check was possible."
        if self.verdict == CONTRADICTED:
            return (Remark(CONTRADICTED, f"The sensors contradict each other; do not use these numbers. {reasons}"),)
        return (Remark(DOUBTFUL, f"Not every check of this recording passes. {reasons}"),)


def worst_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """Worst of the verdicts; good if there are none."""
    return max(verdicts, key=VERDICT_ORDER.index, default="good")


MM: Final = 1e3
WITHOUT_FORCE: Final = "no force was used"
MARKER_CHECKS: Final = ("body_axis", "outside_body", "leg_length_change", "body_proportions", "model_leg_mass")
"""Checks that need no force."""


def assess_quality(recorded: Recorded, estimate: ComEstimate) -> Quality:
    """Run all checks that ``recorded`` allows on ``estimate``; the others are listed with the reason."""
    measures = compute_measures(recorded, estimate)
    return evaluate_checks(measures, recorded.mass_to_check_kg, recorded.geometric.sd_m, with_force=recorded.with_force)


def evaluate_checks(
    measures: Measures, mass_kg: float, geometry_sd_m: tuple[float, float, float], *, with_force: bool = True
) -> Quality:
    """Checks of the numbers ``measures``; ``mass_kg`` is the stated mass, else the used one."""
    checks, not_checked = [], {}
    for row in (*_force_rows(measures, mass_kg), *_plate_rows(measures), *_body_rows(measures, with_force=with_force)):
        if math.isnan(row.value):
            not_checked[row.name] = row.missing if with_force or row.name in MARKER_CHECKS else WITHOUT_FORCE
            continue
        limit = limit_of(row.name, geometry_sd_m, measures.force_share, measures.unmarked_share)
        ending = "agree" if row.value <= limit.passes else "agree poorly"
        if row.value > limit.contradicts:
            ending = "contradict each other"
        message = f"{row.finding}: {row.sensors} {ending}." if row.sensors else f"{row.finding}."
        checks.append(Check(row.name, row.value, limit.unit, limit.passes, limit.contradicts, message))
    return Quality(tuple(checks), not_checked)


@dataclass(frozen=True)
class _CheckRow:
    """Value of one check with its message parts: finding, compared sensors, and the reason for a missing value.

    Without sensors the finding is the whole message.
    """

    name: str
    value: float
    finding: str
    sensors: str
    missing: str


def _force_rows(measures: Measures, mass_kg: float) -> Iterator[_CheckRow]:
    motion, standing = abs(measures.motion_mass_kg / mass_kg - 1.0), abs(measures.standing_mass_kg / mass_kg - 1.0)
    times = math.sqrt(max(measures.normalised_innovations, 0.0))
    tilt_deg = math.degrees(math.asin(min(measures.force_tilt, 1.0)))
    yield _CheckRow(
        "force_tilt",
        measures.force_tilt,
        f"The mean force leans by {tilt_deg:.1f} degrees from the vertical of the file, more than the motion explains",
        "the vertical of the file, which an inclined treadmill may tilt, and the plates' horizontal force",
        "the interval with all force is shorter than 1 s",
    )
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
    gain = max(measures.gains, key=lambda one: one.deviation, default=None)
    yield _CheckRow(
        "channel_gain",
        math.nan if gain is None else gain.deviation,
        "" if gain is None else _gain_finding(gain),
        "a force channel (its scale, its sign, or the rate of the file) and the markers",
        "no force channel varies enough for half a second",
    )
    yield _CheckRow(
        "channel_exchange",
        measures.exchange_ratio,
        _exchange_finding(measures.exchange_ratio),
        "the two horizontal force channels and the markers",
        "the body does not walk for half a second, or its segments are hidden",
    )
    yield _CheckRow(
        "horizontal_bias",
        measures.horizontal_bias_m,
        f"The force puts the centre of mass {MM * measures.horizontal_bias_m:.0f} mm, horizontally, from where the "
        f"markers put it{_lean_part(measures)}",
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
        "largest_difference",
        measures.largest_difference_m,
        f"At one time the centre of mass of force and markers together is "
        f"{MM * measures.largest_difference_m:.0f} mm from that of the markers alone",
        "the plates' force (its zero or its centre of pressure) and the markers",
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
        "flight_acceleration",
        measures.flight_acceleration,
        f"In flight the centre of mass falls with an acceleration that differs by {measures.flight_acceleration:.1%} "
        "from that of gravity",
        "the plates, which read zero, and the markers",
        "no flight of 50 ms is in the interval with all force",
    )
    yield _CheckRow(
        "mass_from_standing",
        standing,
        f"The plates weigh {measures.standing_mass_kg:.1f} kg in the static trial, and the mass is {mass_kg:.1f} kg "
        f"({standing:.1%} apart)",
        "the static trial and the mass",
        "no static trial stands still on the plates",
    )
    yield _CheckRow(
        "mass_uncertainty",
        measures.mass_uncertainty,
        f"The mass that the plates measure has a standard deviation of {measures.mass_uncertainty:.1%}",
        "the mass and the precision that the force needs",
        "the mass is not measured by the plates",
    )


def _plate_rows(measures: Measures) -> Iterator[_CheckRow]:
    if measures.clipped_share > 0.0:
        yield _CheckRow(
            "force_clipped",
            measures.clipped_share,
            f"Plate {measures.clipped_plate} is overloaded for {measures.clipped_share:.1%} of the time in which it "
            "is loaded: one of its channels stays at its limit. These times are not used; the others may be wrong, too",
            f"the range of plate {measures.clipped_plate} and its load",
            "",
        )
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
        "body_axis",
        measures.body_angle_deg,
        f"From the ankles to the {measures.upper_end}, the body extends on average at {measures.body_angle_deg:.0f} "
        "degrees from the vertical",
        "the vertical of the file and the markers of a person who stands, walks or sits",
        "the ankles or the hips are not marked",
    )
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
    ratio = measures.thigh_over_trunk
    yield _CheckRow(
        "body_proportions",
        abs(math.log(ratio / THIGH_OVER_TRUNK)),
        f"The thighs are {ratio:.2f} times as long as the trunk from the hips to the neck, and in people about "
        f"{THIGH_OVER_TRUNK} times",
        "the markers of the pelvis (too high or too low) and those of the knees and the neck",
        "the neck or the legs are not marked",
    )
    if measures.names_proposed:
        yield _CheckRow(
            "proposed_names",
            1.0,
            "The labels belong to no known marker set: likeness to known labels and places on the body named the "
            "markers, and the names are not checked",
            "",
            "",
        )
    share = measures.model_leg_share
    if share is None:
        return
    lacks = (
        "the trunk or the other leg" if share > LEG_MASS_SHARE else "a leg, or has loads that are no part of the body"
    )
    yield _CheckRow(
        "model_leg_mass",
        abs(share - LEG_MASS_SHARE),
        f"The legs are {share:.0%} of the mass of the body model, and about {LEG_MASS_SHARE:.0%} of that of a person: "
        f"the model may lack {lacks}",
        "the bodies of the model and those of a person",
        "no body of the model has a known name",
    )


def _lean_part(measures: Measures) -> str:
    """The part of the sentence on the horizontal bias that names a constant force; empty if it explains less than half.

    A hand on a support and a wrong zero of a plate are the same for the plates.
    """
    if not measures.lean_bias_m > 0.5 * measures.horizontal_bias_m:
        return ""
    return (
        f", of which {MM * measures.lean_bias_m:.0f} mm follow from a constant horizontal force that the motion does "
        "not need (a hand on a support, or the zero of a plate)"
    )


def _gain_finding(gain: ChannelGain) -> str:
    """The sentence of a gain, without its end."""
    which = f"plate {gain.plate} measures" if gain.plate else "the plates together measure"
    if math.isinf(gain.gain):
        return f"The motion of the markers needs a force {gain.axis}, and {which} next to none"
    return (
        f"The motion of the markers needs {gain.gain:.2f} times (standard error {gain.sd:.2f}) the force {gain.axis} "
        f"that {which}"
    )


def _exchange_finding(ratio: float) -> str:
    """The sentence of ``exchange_ratio``, without its end; a ratio of 0 says that the exchange explains too little."""
    exchanged = "With the fore-aft and the lateral channel exchanged"
    if ratio == 0.0:
        return f"{exchanged}, more than half of the force that the motion of the markers needs is unexplained"
    return (
        f"{exchanged}, the force differs from the one that the motion of the markers needs by {1.0 / ratio:.2f} times "
        "as much as it does now"
    )


def _worst_plate(measures: Measures, name: str) -> PlatePressure:
    """Plate with the largest value of the attribute ``name``; a plate of NaN if all values are NaN."""
    known = [plate for plate in measures.plates if not math.isnan(getattr(plate, name))]
    nothing = PlatePressure(0, math.nan, math.nan)
    return max(known, key=lambda plate: float(getattr(plate, name)), default=nothing)
