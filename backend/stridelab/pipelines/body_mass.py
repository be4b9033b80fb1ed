"""Selection of the body mass: the stated mass, unless the measured force contradicts it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.pipelines.trial import Trial
from stridelab.recordings.body_mass import CALIBRATION_SHARE, ZERO_SD_KG, MassEstimate, best_mass, combined_mass
from stridelab.recordings.recording import Remark
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
