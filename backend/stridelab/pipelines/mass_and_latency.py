"""Body mass and latency that an estimate uses.

The mass is the stated one, unless the measured force contradicts it.

The latency is that of the force relative to the markers. ``apply`` (the default) corrects the estimated latency if it
is significant; ``report`` corrects nothing; a number is corrected as given. A remark records the correction together
with the estimate. If other trials of the session have an estimate, the latency is the session's pooled value.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.estimation.latency import MAX_LAG_S, Latency, estimate_latency, is_significant
from stridelab.pipelines.trial import Trial
from stridelab.recordings.body_mass import CALIBRATION_SHARE, ZERO_SD_KG, MassEstimate, best_mass, combined_mass
from stridelab.recordings.recording import Remark, WrenchTrack
from stridelab.schemas.sessions import SessionValues

STATED_SD_KG: Final = 0.3
STATED_SHARE: Final = 0.01
"""Relative standard deviation of a stated mass: clothing, day-to-day variation, rounding."""
UNMEASURED_FORCE_SHARE: Final = 0.03
"""Relative force that may go unmeasured in a movement without notice; it biases the measured mass downwards only."""
SIGNIFICANT_SD: Final = 3.0
"""Difference in standard deviations above which the measured mass replaces the stated one."""
MASS_REMARK_SHARE: Final = 0.05
"""Relative difference between stated and measured mass above which a remark is added."""
MAX_MASS_RATIO: Final = 1.5
"""Ratio of stated to measured mass (or its inverse) from which the stated mass is rejected."""

SESSION_SHARE: Final = 0.015
"""Relative difference from the mass of the session above which a trial gets a remark, if it exceeds its own error."""

NOMINAL_KG: Final = 70.0
"""Placeholder for an unknown mass when only the geometry is used; it does not affect any reported number."""

MassSource = Literal["stated", "file", "force"]
_SOURCE_LABELS: Final = {
    "stated": "stated",
    "file": "in the file",
    "standing": "standing on the plates",
    "impulse": "impulse of the vertical force",
    "whole_steps": "mean force over whole steps",
    "static": "standing in the static trial",
    "session": "over all trials of the session",
}


@dataclass(frozen=True)
class KnownMass:
    """One of the compared masses; ``source`` is ``stated``, ``file``, ``static`` or a MassKind."""

    source: str
    mass_kg: float
    sd_kg: float

    def __str__(self) -> str:
        return f"{self.mass_kg:.1f} ± {self.sd_kg:.1f} kg ({_SOURCE_LABELS[self.source]})"


@dataclass(frozen=True)
class BodyMass:
    """The selected mass, its source and the remarks on it.

    ``sd_kg`` is its standard deviation; for a measured mass it includes the calibration error of the plates.
    ``compared`` lists all available masses, including the selected one unless that is a mean. Without any mass,
    ``source`` and ``known_kg`` are None and ``mass_kg`` is ``NOMINAL_KG``.
    """

    mass_kg: float
    source: MassSource | None
    sd_kg: float
    compared: tuple[KnownMass, ...] = ()
    remarks: tuple[Remark, ...] = ()

    @property
    def stated_kg(self) -> float | None:
        """The user's mass, else the file's, whether or not it is selected."""
        stated = {known.source: known.mass_kg for known in self.compared}
        return stated.get("stated", stated.get("file"))

    @property
    def known_kg(self) -> float | None:
        """The mass in kilograms; None if no mass is available."""
        return None if self.source is None else self.mass_kg

    @property
    def known_sd_kg(self) -> float | None:
        """Standard deviation in kilograms; None if no mass is available."""
        return None if self.source is None else self.sd_kg


def body_mass(
    stated_kg: float | None,
    file_kg: float | None,
    measured: Sequence[MassEstimate],
    static: Sequence[MassEstimate] = (),
    *,
    required: bool = True,
) -> BodyMass:
    """Select the user's mass, else the file's, else the force plates'; the plates also win where they contradict it.

    ``measured`` are the estimates from this trial, ``static`` those from its static trial. Two masses contradict each
    other if they differ by more than ``SIGNIFICANT_SD`` standard deviations. Raises ``InvalidInput``
    (``mass-contradicts-force``) if the user's value is too large or too small by a factor of ``MAX_MASS_RATIO``, and
    ``NotEstimable`` (``mass-unknown``) if no mass is available and one is ``required``. Without a mass that is not
    required, the result is ``NOMINAL_KG`` with ``source`` None.
    """
    force = combined_mass([estimate for estimate in (best_mass(measured), best_mass(static)) if estimate is not None])
    weighed = (
        *(KnownMass(estimate.kind, estimate.mass_kg, estimate.total_sd_kg) for estimate in measured),
        *(KnownMass("static", estimate.mass_kg, estimate.total_sd_kg) for estimate in static),
    )
    stated: KnownMass | None = None
    source: MassSource = "force"
    for value_kg, origin in ((stated_kg, "stated"), (file_kg, "file")):
        if value_kg is not None and stated is None:
            source = "stated" if origin == "stated" else "file"
            stated = KnownMass(source, value_kg, float(np.hypot(STATED_SD_KG, STATED_SHARE * value_kg)))
    if stated is None:
        if force is None and not required:
            return BodyMass(NOMINAL_KG, None, 0.0)
        if force is None:
            raise NotEstimable(
                "mass-unknown",
                "The body mass is neither stated nor in the file, and no force is measured for long enough to weigh "
                "the person. The method geometry needs no mass.",
                [Fault("mass_kg", "missing")],
            )
        message = f"No mass is stated; {_format_force_mass(force)} follow from the plates: {_join_masses(weighed)}."
        remark = Remark("mass-from-force", message)
        return BodyMass(force.mass_kg, "force", force.total_sd_kg, weighed, (remark,))
    compared = (stated, *weighed)
    if force is None:
        return BodyMass(stated.mass_kg, source, stated.sd_kg, compared)
    absurd = not 1.0 / MAX_MASS_RATIO < stated.mass_kg / force.mass_kg < MAX_MASS_RATIO
    if absurd and source == "stated":
        raise InvalidInput(
            "mass-contradicts-force",
            f"The stated mass of {stated.mass_kg:g} kg contradicts the plates: {_join_masses(weighed)}.",
            [Fault("mass_kg", f"{stated.mass_kg:g} kg stated, {force.mass_kg:.1f} kg measured")],
        )
    if absurd or abs(stated.mass_kg - force.mass_kg) > SIGNIFICANT_SD * _sd_of_difference_kg(stated, force):
        code = "mass-contradicts-force" if absurd else "mass-disagrees-with-force"
        remark = Remark(code, _contradiction_message(stated, force, weighed))
        return BodyMass(force.mass_kg, "force", force.total_sd_kg, compared, (remark,))
    remarks: tuple[Remark, ...] = ()
    if abs(force.mass_kg / stated.mass_kg - 1.0) > MASS_REMARK_SHARE:
        message = (
            f"The mass of {stated.mass_kg:g} kg ({_SOURCE_LABELS[source]}) is used. It differs from what the "
            "plates carried, but "
            f"not by more than the errors explain: {_join_masses(weighed)}."
        )
        remarks = (Remark("mass-differs-from-force", message),)
    return BodyMass(stated.mass_kg, source, stated.sd_kg, compared, remarks)


def session_masses(session: SessionValues | None) -> tuple[MassEstimate, ...]:
    """The mass pooled over all trials of a session; empty if the session has none.

    The session's standard deviation includes the plates' calibration error; it is removed here because
    ``MassEstimate`` adds it again.
    """
    if session is None or session.mass_kg is None:
        return ()
    calibration_kg = CALIBRATION_SHARE * session.mass_kg
    own_kg = np.sqrt(max((session.mass_sd_kg or 0.0) ** 2 - calibration_kg**2, ZERO_SD_KG**2))
    return (MassEstimate(session.mass_kg, float(own_kg), "session", 0.0),)


def session_mass_remarks(session: SessionValues | None, measured: Sequence[MassEstimate]) -> tuple[Remark, ...]:
    """A remark where the plates weigh another mass in this trial than in the others of its session."""
    own = best_mass(measured)
    if own is None or session is None or session.mass_kg is None:
        return ()
    difference_kg = own.mass_kg - session.mass_kg
    if abs(difference_kg) <= max(SESSION_SHARE * session.mass_kg, 2.0 * own.sd_kg):
        return ()
    message = (
        f"The plates weigh {own.mass_kg:.1f} ± {own.sd_kg:.1f} kg in this trial and {session.mass_kg:.1f} kg over "
        f"{session.mass_n_trials} trials of its session, {difference_kg * GRAVITY_M_S2:+.0f} N apart: the plates have "
        "another zero here, a part of a foot stands beside them, or something else carries weight."
    )
    return (Remark("mass-differs-from-session", message),)


def standing_masses(static: Trial | None) -> tuple[MassEstimate, ...]:
    """Masses measured by the plates while the subject stands still in a static trial."""
    return () if static is None else tuple(estimate for estimate in static.masses if estimate.kind == "standing")


def _sd_of_difference_kg(stated: KnownMass, force: MassEstimate) -> float:
    """Standard deviation of stated minus measured mass; includes unmeasured force where the measured mass is lower."""
    hides = force.kind != "standing" and force.mass_kg < stated.mass_kg
    unseen_kg = UNMEASURED_FORCE_SHARE * force.mass_kg if hides else 0.0
    return float(np.sqrt(stated.sd_kg**2 + force.total_sd_kg**2 + unseen_kg**2))


def _contradiction_message(stated: KnownMass, force: MassEstimate, weighed: Sequence[KnownMass]) -> str:
    relative_error = force.mass_kg / stated.mass_kg - 1.0
    cause = "either this mass or the plates' calibration is wrong"
    if relative_error < 0.0:
        cause += ", or something beside the plates carries a part of the weight"
    return (
        f"The plates contradict the mass of {stated.mass_kg:g} kg ({_SOURCE_LABELS[stated.source]}) by "
        f"{relative_error:+.0%}: "
        f"{_join_masses(weighed)}; {cause}. {_format_force_mass(force)} are used, which explain the motion; "
        f"with {stated.mass_kg:g} kg the "
        f"vertical acceleration from the force would be wrong by {abs(relative_error) * GRAVITY_M_S2:.1f} m/s²."
    )


def _format_force_mass(force: MassEstimate) -> str:
    return f"{force.mass_kg:.1f} ± {force.total_sd_kg:.1f} kg"


def _join_masses(masses: Sequence[KnownMass]) -> str:
    return ", ".join(str(mass) for mass in masses)


SIGNIFICANT_DIFFERENCE_SD: Final = 3.0
"""Difference between a trial and its session, in standard deviations, above which a remark is added."""


@dataclass(frozen=True)
class LatencyChoice:
    """``applied_s`` is corrected before estimation; ``latency_s`` and ``sd_s`` are None without an estimate.

    ``trial_estimate`` is the estimate of this trial alone, None if it has no estimate; ``session`` is set if the
    latency is the session's.
    """

    trial_estimate: Latency | None
    applied_s: float
    remarks: tuple[Remark, ...] = ()
    session: SessionValues | None = None

    @property
    def latency_s(self) -> float | None:
        """The session's latency, else the trial's."""
        if self.session is not None:
            return self.session.latency_s
        return None if self.trial_estimate is None else self.trial_estimate.latency_s

    @property
    def sd_s(self) -> float | None:
        """Standard deviation of ``latency_s``."""
        if self.session is not None:
            return self.session.latency_sd_s
        return None if self.trial_estimate is None else self.trial_estimate.sd_s

    @property
    def remaining_sd_s(self) -> float | None:
        """Root mean square of what remains of the latency after ``applied_s``; None without an estimate.

        That of a session includes by how much its trials differ.
        """
        if self.latency_s is None or self.sd_s is None:
            return None
        excess_s = 0.0 if self.session is None else self.session.latency_excess_s or 0.0
        return math.hypot(self.sd_s, excess_s, self.latency_s - self.applied_s)

    @property
    def latency_source(self) -> Literal["session", "trial"]:
        """Whether the latency is the session's or the trial's."""
        return "trial" if self.session is None else "session"

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the pooling method, empty for a trial's own latency."""
        return () if self.session is None else ("huber1964", "paule1982")

    @property
    def n_trials(self) -> int:
        """Number of trials from which the latency is estimated."""
        return int(self.trial_estimate is not None) if self.session is None else self.session.latency_n_trials


def choose_latency(
    policy: Literal["report", "apply"] | float,
    geometric: GeometricCom,
    wrench_at: Callable[[float], WrenchTrack],
    mass_kg: float,
    session: SessionValues | None = None,
) -> LatencyChoice:
    """Estimate the latency and decide which value is applied.

    Raises ``InvalidInput`` (``latency-out-of-range`` for a number beyond ``MAX_LAG_S``, ``mass-out-of-range``,
    ``clock-mismatch``). If the trial allows no estimate, a remark says so and the session's or the given value is
    applied.
    """
    stated_s = None if isinstance(policy, str) else _require_latency_range(float(policy))
    remarks: tuple[Remark, ...] = ()
    of_trial = None
    try:
        of_trial = estimate_latency(geometric, wrench_at, mass_kg)
    except NotEstimable as error:
        remarks = (Remark(error.code, error.message),)
    of_session = session if session is not None and session.latency_s is not None else None
    estimated = LatencyChoice(of_trial, 0.0, remarks, of_session)
    if of_session is not None and of_trial is not None:
        remarks = (*remarks, *_session_difference_remarks(of_trial, of_session))
    latency_s, sd_s, description = estimated.latency_s, estimated.sd_s, _describe_choice(estimated)
    if stated_s is not None:
        why = "as requested." if latency_s is None else f"as requested; the estimate is {description}."
        return LatencyChoice(of_trial, stated_s, (*remarks, _applied_remark(stated_s, why)), of_session)
    if latency_s is None or sd_s is None:
        return LatencyChoice(of_trial, 0.0, remarks, of_session)
    significant = is_significant(latency_s, sd_s)
    if policy == "apply" and significant:
        where = "in this recording" if of_session is None else "in its session"
        remark = _applied_remark(latency_s, f"as estimated {where}: {description}.")
        return LatencyChoice(of_trial, latency_s, (*remarks, remark), of_session)
    if policy == "apply":
        message = f"The latency of the force, {description}, is not significant: the clocks are taken as recorded."
        return LatencyChoice(of_trial, 0.0, (*remarks, Remark("latency-not-significant", message)), of_session)
    if significant:
        message = (
            f"The force seems to be {1e3 * abs(latency_s):.0f} ms {_late_or_early(latency_s)} against the markers "
            f"({description}); this is not corrected unless the latency is applied."
        )
        remarks = (*remarks, Remark("latency-not-applied", message))
    return LatencyChoice(of_trial, 0.0, remarks, of_session)


def _session_difference_remarks(of_trial: Latency, session: SessionValues) -> tuple[Remark, ...]:
    """A remark if the latencies of the trial and of its session differ significantly."""
    mean_s, sd_s, excess_s = session.latency_s or 0.0, session.latency_sd_s or 0.0, session.latency_excess_s or 0.0
    if abs(of_trial.latency_s - mean_s) <= SIGNIFICANT_DIFFERENCE_SD * math.hypot(of_trial.sd_s, sd_s, excess_s):
        return ()
    message = (
        f"This trial alone gives {_describe_latency(of_trial)}, its session {1e3 * mean_s:.1f} ± "
        f"{1e3 * sd_s:.1f} ms: more than "
        f"{SIGNIFICANT_DIFFERENCE_SD:g} standard deviations apart."
    )
    return (Remark("latency-differs-from-session", message),)


def _require_latency_range(stated_s: float) -> float:
    if not abs(stated_s) <= MAX_LAG_S:
        raise InvalidInput(
            "latency-out-of-range",
            f"A latency of {stated_s:g} s is out of range: the clocks of force and markers may differ by at most "
            f"{MAX_LAG_S:g} s.",
            [Fault("latency", f"{stated_s:g} s")],
        )
    return stated_s


def _applied_remark(latency_s: float, why: str) -> Remark:
    if latency_s == 0.0:
        return Remark("latency-applied", f"Force and markers are taken as recorded, {why}")
    message = f"The force was read {1e3 * abs(latency_s):.1f} ms {'later' if latency_s > 0.0 else 'earlier'}, {why}"
    return Remark("latency-applied", message)


def _describe_choice(choice: LatencyChoice) -> str:
    """The latency as text, with its standard deviation and source."""
    alone = "" if choice.trial_estimate is None else _describe_latency(choice.trial_estimate)
    if choice.session is None or choice.latency_s is None or choice.sd_s is None:
        return alone
    trials = f"{choice.n_trials} trial{'' if choice.n_trials == 1 else 's'}"
    own = f"; this one alone: {alone}" if alone else ""
    return f"{1e3 * choice.latency_s:.1f} ± {1e3 * choice.sd_s:.1f} ms over {trials}{own}"


def _describe_latency(latency: Latency) -> str:
    axes = f"{1e3 * latency.along.lag_s:.0f} ms along the walk, {1e3 * latency.vertical.lag_s:.0f} ms vertically"
    return f"{1e3 * latency.latency_s:.1f} ± {1e3 * latency.sd_s:.1f} ms ({axes})"


def _late_or_early(latency_s: float) -> str:
    return "late" if latency_s > 0.0 else "early"
