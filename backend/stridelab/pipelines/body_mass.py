"""Which body mass is used: the stated one, unless mechanics contradicts it."""

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
"""Standard deviation of a stated mass, as a share of it: clothes, the day, rounding."""
UNSEEN_SHARE: Final = 0.03
"""Force that may be missing in a movement without being noticed: it only ever makes the measured mass too small."""
SIGNIFICANT: Final = 3.0
"""Difference in standard deviations from which on the plates are believed rather than the statement."""
MASS_NOTED: Final = 0.05
"""Relative difference between the stated mass and the plates from which on it is noted."""
MASS_REFUSED: Final = 1.5
"""Ratio between the two from which on the stated mass cannot be true."""

NOMINAL_KG: Final = 70.0
"""Stands in for an unknown mass where only the geometry is asked for; it enters no number of a result."""

MassSource = Literal["stated", "file", "force"]
_HOW: Final = {
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
    """One of the masses that were compared; ``source`` is a key of ``stated``, ``file``, ``static`` or a MassKind."""

    source: str
    mass_kg: float
    sd_kg: float

    def __str__(self) -> str:
        return f"{self.mass_kg:.1f} ± {self.sd_kg:.1f} kg ({_HOW[self.source]})"


@dataclass(frozen=True)
class BodyMass:
    """The mass that is used, where it comes from, and what should be known about it.

    ``sd_kg`` is its standard deviation, for a measured mass with that of the plates' calibration. ``compared`` are all
    masses that were known, the used one among them unless it is a mean. ``source`` is None where no mass is known;
    ``mass_kg`` is nominal then, and ``known_kg`` None.
    """

    mass_kg: float
    source: MassSource | None
    sd_kg: float
    compared: tuple[KnownMass, ...] = ()
    remarks: tuple[Remark, ...] = ()

    @property
    def stated_kg(self) -> float | None:
        """The user's mass, else the file's, whether it is used or not."""
        stated = {known.source: known.mass_kg for known in self.compared}
        return stated.get("stated", stated.get("file"))

    @property
    def known_kg(self) -> float | None:
        """The mass in kilograms, None where none is known."""
        return None if self.source is None else self.mass_kg

    @property
    def known_sd_kg(self) -> float | None:
        """Its standard deviation in kilograms, None where no mass is known."""
        return None if self.source is None else self.sd_kg


def body_mass(
    stated_kg: float | None,
    file_kg: float | None,
    measured: Sequence[MassEstimate],
    static: Sequence[MassEstimate] = (),
    *,
    required: bool = True,
) -> BodyMass:
    """The user's mass, else the file's, else the plates'; the plates' also where they contradict the former.

    ``measured`` are the estimates of this trial, ``static`` those of its static trial. The two masses contradict each
    other when they differ by more than three standard deviations. Raises ``InvalidInput`` (``mass-contradicts-force``)
    when the user's value is 1.5 times too large or too small, and ``NotEstimable`` (``mass-unknown``) when there is no
    value at all and one is ``required``; otherwise the mass is then nominal, with ``source`` None.
    """
    force = combined_mass([estimate for estimate in (best_mass(measured), best_mass(static)) if estimate is not None])
    weighed = (
        *(KnownMass(estimate.kind, estimate.mass_kg, estimate.total_sd_kg) for estimate in measured),
        *(KnownMass("static", estimate.mass_kg, estimate.total_sd_kg) for estimate in static),
    )
    said: KnownMass | None = None
    source: MassSource = "force"
    for value_kg, origin in ((stated_kg, "stated"), (file_kg, "file")):
        if value_kg is not None and said is None:
            source = "stated" if origin == "stated" else "file"
            said = KnownMass(source, value_kg, float(np.hypot(STATED_SD_KG, STATED_SHARE * value_kg)))
    if said is None:
        if force is None and not required:
            return BodyMass(NOMINAL_KG, None, 0.0)
        if force is None:
            raise NotEstimable(
                "mass-unknown",
                "The body mass is neither stated nor in the file, and no force is measured for long enough to weigh "
                "the person. The method geometry needs no mass.",
                [Fault("mass_kg", "missing")],
            )
        message = f"No mass is stated; {_used(force)} follow from the plates: {_listed(weighed)}."
        remark = Remark("mass-from-force", message)
        return BodyMass(force.mass_kg, "force", force.total_sd_kg, weighed, (remark,))
    compared = (said, *weighed)
    if force is None:
        return BodyMass(said.mass_kg, source, said.sd_kg, compared)
    absurd = not 1.0 / MASS_REFUSED < said.mass_kg / force.mass_kg < MASS_REFUSED
    if absurd and source == "stated":
        raise InvalidInput(
            "mass-contradicts-force",
            f"The stated mass of {said.mass_kg:g} kg contradicts the plates: {_listed(weighed)}.",
            [Fault("mass_kg", f"{said.mass_kg:g} kg stated, {force.mass_kg:.1f} kg measured")],
        )
    if absurd or abs(said.mass_kg - force.mass_kg) > SIGNIFICANT * _sd_of_difference_kg(said, force):
        code = "mass-contradicts-force" if absurd else "mass-disagrees-with-force"
        remark = Remark(code, _contradiction(said, force, weighed))
        return BodyMass(force.mass_kg, "force", force.total_sd_kg, compared, (remark,))
    remarks: tuple[Remark, ...] = ()
    if abs(force.mass_kg / said.mass_kg - 1.0) > MASS_NOTED:
        message = (
            f"The mass of {said.mass_kg:g} kg ({_HOW[source]}) is used. It differs from what the plates carried, but "
            f"not by more than the errors explain: {_listed(weighed)}."
        )
        remarks = (Remark("mass-differs-from-force", message),)
    return BodyMass(said.mass_kg, source, said.sd_kg, compared, remarks)


def session_masses(session: SessionValues | None) -> tuple[MassEstimate, ...]:
    """The mass that the plates show over all trials of a session; empty where the session has none.

    Its standard deviation is stated with that of the plates' calibration, which ``MassEstimate`` adds by itself.
    """
    if session is None or session.mass_kg is None:
        return ()
    calibration_kg = CALIBRATION_SHARE * session.mass_kg
    own_kg = np.sqrt(max((session.mass_sd_kg or 0.0) ** 2 - calibration_kg**2, ZERO_SD_KG**2))
    return (MassEstimate(session.mass_kg, float(own_kg), "session", 0.0),)


def standing_masses(static: Trial | None) -> tuple[MassEstimate, ...]:
    """What the plates weighed while the person stood still in a static trial."""
    return () if static is None else tuple(estimate for estimate in static.masses if estimate.kind == "standing")


def _sd_of_difference_kg(said: KnownMass, force: MassEstimate) -> float:
    """Of the stated minus the measured mass; a movement may hide missing force where it measures too little."""
    hides = force.kind != "standing" and force.mass_kg < said.mass_kg
    unseen_kg = UNSEEN_SHARE * force.mass_kg if hides else 0.0
    return float(np.sqrt(said.sd_kg**2 + force.total_sd_kg**2 + unseen_kg**2))


def _contradiction(said: KnownMass, force: MassEstimate, weighed: Sequence[KnownMass]) -> str:
    off = force.mass_kg / said.mass_kg - 1.0
    why = "either this mass or the plates' calibration is wrong"
    if off < 0.0:
        why += ", or something beside the plates carries a part of the weight"
    return (
        f"The plates contradict the mass of {said.mass_kg:g} kg ({_HOW[said.source]}) by {off:+.0%}: "
        f"{_listed(weighed)}; {why}. {_used(force)} are used, which explain the motion; with {said.mass_kg:g} kg the "
        f"vertical acceleration from the force would be wrong by {abs(off) * GRAVITY_M_S2:.1f} m/s²."
    )


def _used(force: MassEstimate) -> str:
    return f"{force.mass_kg:.1f} ± {force.total_sd_kg:.1f} kg"


def _listed(masses: Sequence[KnownMass]) -> str:
    return ", ".join(str(mass) for mass in masses)
