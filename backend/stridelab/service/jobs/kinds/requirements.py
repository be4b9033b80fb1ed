"""What ``estimate-com`` needs before it can start, and the sentence for whoever did not bring it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.recordings import windows as measured
from stridelab.recordings.marker_sets import MarkerSetMatch
from stridelab.recordings.recording import Remark, Window
from stridelab.schemas.methods import METHODS
from stridelab.service.jobs.kinds.trial import Trial

MASS_NOTED: Final = 0.05
"""Relative difference between the stated mass and the weight on the plates from which on it is noted."""
MASS_DOUBTED: Final = 0.1
"""From here on one of the two must be wrong: the plates weigh within 3 % of the scales, 7 % in brisk walking."""
MASS_REFUSED: Final = 1.5
"""Ratio between the two from which on the stated mass cannot be true."""

MassSource = Literal["stated", "file", "force"]


@dataclass(frozen=True)
class BodyMass:
    """The mass that is used, where it comes from, and what should be known about it."""

    mass_kg: float
    source: MassSource
    remarks: tuple[Remark, ...] = ()


def require_method(method: str) -> str:
    """The method, if this version has it. Raises ``NotEstimable`` (``method-unavailable``) naming what exists."""
    if method not in METHODS:
        raise NotEstimable(
            "method-unavailable",
            f"This version has no {method} estimator; it has: {', '.join(METHODS)}.",
            [Fault("method", f"{method} is not available")],
        )
    return method


def require_marker_set(match: MarkerSetMatch, labels: Sequence[str]) -> None:
    """Raise ``NotEstimable`` (``unknown-marker-set``) that lists the labels found and what the nearest set lacks."""
    if match.name is not None:
        return
    nearest = ", ".join(f"{name} ({share:.0%} of what it requires)" for name, share in match.nearest)
    faults = [
        Fault(f"nearest set {name}", f"missing: {', '.join(match.needed.get(name, ()))}")
        for name, _ in match.nearest[:1]
    ]
    faults.append(Fault("labels found", ", ".join(labels) or "none"))
    raise NotEstimable(
        "unknown-marker-set",
        f"The {len(labels)} marker labels belong to no known marker set; nearest: {nearest or 'none'}. "
        "Map the labels to landmarks to use this recording.",
        faults,
    )


def require_windows(trial: Trial, window_s: tuple[float, float] | None, *, needs_force: bool) -> tuple[Window, ...]:
    """The windows to work on: the measured ones, or the part of one that was asked for.

    Raises ``NotEstimable`` (``single-frame``, ``no-plates``, ``plates-switched-off``, ``plates-unloaded``,
    ``forces-and-markers-apart``, ``no-measured-window``) where no force can be used, ``InvalidInput``
    (``window-outside-recording``, ``window-not-measured``) where the interval asked for is not inside the recording or
    a measured window.
    """
    if needs_force and not trial.windows:
        measured.require_windows(trial.recording, trial.match.landmarks)
    if window_s is None:
        return trial.windows
    start_s, end_s = window_s
    frame_s = 1.0 / trial.recording.marker_rate_hz
    duration_s = trial.recording.duration_s
    if not -frame_s <= start_s < end_s <= duration_s + frame_s:
        raise InvalidInput(
            "window-outside-recording",
            f"The recording lasts from 0 to {duration_s:.2f} s; there is no interval from {start_s:g} to {end_s:g} s.",
            [Fault("window_s", f"{start_s:g} to {end_s:g} s")],
        )
    whole = (Window(0.0, duration_s),)
    allowed = trial.windows if needs_force else whole
    if not any(w.start_s - frame_s <= start_s < end_s <= w.end_s + frame_s for w in allowed):
        listed = ", ".join(f"{w.start_s:.2f} to {w.end_s:.2f} s" for w in allowed)
        raise InvalidInput(
            "window-not-measured",
            f"The interval from {start_s:g} to {end_s:g} s is not inside a window in which all contact force is "
            f"measured; there is: {listed}.",
            [Fault("window_s", f"{start_s:g} to {end_s:g} s")],
        )
    return (Window(start_s, end_s),)


def body_mass(stated_kg: float | None, file_kg: float | None, force_kg: float | None) -> BodyMass:
    """The user's mass, else the file's, else the weight on the plates.

    Raises ``InvalidInput`` (``mass-contradicts-force``) when the user's value is 1.5 times too large or too small
    for what the plates carried, and ``NotEstimable`` (``mass-unknown``) when there is no value at all.
    """
    if stated_kg is not None and force_kg is not None and not _same_person(stated_kg, force_kg):
        raise InvalidInput(
            "mass-contradicts-force",
            f"The stated mass of {stated_kg:g} kg contradicts the plates, which carried {force_kg:.1f} kg on average.",
            [Fault("mass_kg", f"{stated_kg:g} kg stated, {force_kg:.1f} kg measured")],
        )
    if file_kg is not None and force_kg is not None and stated_kg is None and not _same_person(file_kg, force_kg):
        message = f"The file's mass of {file_kg:g} kg contradicts the plates ({force_kg:.1f} kg), which are believed."
        return BodyMass(force_kg, "force", (Remark("mass-contradicts-force", message),))
    for mass_kg, source in ((stated_kg, "stated"), (file_kg, "file")):
        if mass_kg is not None:
            return BodyMass(mass_kg, "stated" if source == "stated" else "file", _difference(mass_kg, force_kg))
    if force_kg is not None:
        message = f"No mass is stated; {force_kg:.1f} kg follow from the mean vertical force over whole steps."
        return BodyMass(force_kg, "force", (Remark("mass-from-force", message),))
    raise NotEstimable(
        "mass-unknown",
        "The body mass is neither stated nor in the file, and no whole step is measured to weigh the person.",
        [Fault("mass_kg", "missing")],
    )


def _difference(mass_kg: float, force_kg: float | None) -> tuple[Remark, ...]:
    if force_kg is None or abs(force_kg / mass_kg - 1.0) <= MASS_NOTED:
        return ()
    both = f"The mass of {mass_kg:g} kg differs from the {force_kg:.1f} kg that the plates carried on average"
    off = force_kg / mass_kg - 1.0
    if abs(off) <= MASS_DOUBTED:
        return (Remark("mass-differs-from-force", f"{both}."),)
    message = (
        f"{both}, by {off:+.0%}: either the mass or the plates' calibration is wrong. {mass_kg:g} kg is used, so that "
        f"the vertical acceleration from the force is wrong by {abs(off) * GRAVITY_M_S2:.1f} m/s²."
    )
    return (Remark("mass-disagrees-with-force", message),)


def _same_person(mass_kg: float, force_kg: float) -> bool:
    return 1.0 / MASS_REFUSED < mass_kg / force_kg < MASS_REFUSED
