"""Values of a session computed from its trials: pooled latency, pooled mass and the static trial.

Uses only the stored facts of the recordings and no numerical package, so that both the worker and the command line can
run it. The order of the trials does not matter; identical files count once.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from stridelab.estimation.random_effects import Pooled, pool_measurements
from stridelab.recordings.marker_sets import PROPOSED
from stridelab.schemas.recordings import RecordingFacts
from stridelab.schemas.sessions import SessionTrial, SessionValues

CORNER_RESOLUTION_M: Final = 0.001
"""Resolution at which plate corners are compared."""
PLATE_WEIGHT_SD_SHARE: Final = 0.011
"""Relative weight error common to all trials of a session: plates against scales, 6 adults (12 more: 1.15 %)."""
MASS_REPEATABILITY_SHARE: Final = 0.004
"""Relative standard deviation of the mass between the trials of one person: 0.36 to 0.45 % in 30 people."""
UNKNOWN_ZERO_SD_KG: Final = 1.0
"""Error that trials have in common whose plates are loaded all the time (``body_mass.UNCHECKED_ZERO_SD_KG``)."""
CONTACT_TYPE: Final = 0
"""Plate type of contacts read from a MOT file; their corners only bound the centre of pressure of that trial."""


@dataclass(frozen=True)
class TrialFacts:
    """A recording of a session: id, file name, hash and the facts read from its file."""

    recording_id: str
    filename: str
    sha256: str
    facts: RecordingFacts


@dataclass(frozen=True)
class SessionShare:
    """What a trial takes from its session: ``values``, None without any, and the ``static`` trial of the session."""

    values: SessionValues | None
    static: TrialFacts | None


def share_session(
    session_id: str, own: TrialFacts, others: Sequence[TrialFacts], *, static_stated: bool
) -> SessionShare:
    """Values and static trial of the session for the trial ``own``; a static trial that users stated is preferred.

    The values name the static trial of the session, not a stated one.
    """
    values = session_values(session_id, own, others)
    static = None if static_stated else select_static_trial(own, others)
    if static is not None:
        values = (values or SessionValues(session_id=session_id)).model_copy(
            update={"static_recording_id": static.recording_id}
        )
    return SessionShare(values, static)


def session_values(session_id: str, own: TrialFacts, others: Sequence[TrialFacts]) -> SessionValues | None:
    """Session values for the trial ``own``; None if no other trial has a latency, a mass or a zero that it lacks.

    Latency and mass are pooled over the trials measured with the same plates at the same rates.
    """
    same_setup = [one for one in _distinct_trials(own, others) if equipment_key(one.facts) == equipment_key(own.facts)]
    same_setup.sort(key=lambda one: one.recording_id)
    clocks = {one.recording_id: one.facts.clock for one in same_setup if one.facts.clock is not None}
    masses = _trial_masses(same_setup)
    zeros = _plate_zeros(own, same_setup)
    if not zeros and not (clocks.keys() | masses.keys()) - {own.recording_id}:
        return None
    latency = _pool_with_others(
        {name: (clock.latency_s, clock.sd_s) for name, clock in clocks.items()}, own.recording_id
    )
    mass = _pool_with_others(masses, own.recording_id, scaled=True)
    latency_weights = {} if latency is None else dict(zip(clocks, latency.weights, strict=True))
    mass_weights = {} if mass is None else dict(zip(masses, mass.weights, strict=True))
    trials = []
    for one in same_setup:
        clock, mass_kg = clocks.get(one.recording_id), masses.get(one.recording_id, (None, None))[0]
        if clock is not None or mass_kg is not None:
            trials.append(
                SessionTrial(
                    recording_id=one.recording_id,
                    filename=one.filename,
                    latency_s=None if clock is None else clock.latency_s,
                    latency_sd_s=None if clock is None else clock.sd_s,
                    latency_weight=latency_weights.get(one.recording_id),
                    mass_kg=mass_kg,
                    mass_sd_kg=None if mass_kg is None else one.facts.mass_from_force_sd_kg,
                    mass_weight=mass_weights.get(one.recording_id),
                )
            )
    return SessionValues(
        session_id=session_id,
        latency_s=None if latency is None else latency.mean,
        latency_sd_s=None if latency is None else latency.sd,
        latency_excess_s=None if latency is None else latency.excess_sd,
        latency_n_trials=0 if latency is None else latency.n,
        mass_kg=None if mass is None else mass.mean,
        mass_sd_kg=None if mass is None else math.hypot(mass.sd, PLATE_WEIGHT_SD_SHARE * mass.mean),
        mass_n_trials=0 if mass is None else mass.n,
        plate_zeros=zeros,
        trials=trials,
    )


def _plate_zeros(own: TrialFacts, same_setup: Sequence[TrialFacts]) -> dict[int, list[float]]:
    """Median wrench that the other trials subtracted from the plates that ``own`` never shows unloaded.

    A plate that reads exactly zero unloaded was cut off below a threshold, which hides its zero.
    """
    zeros: dict[int, list[float]] = {}
    others = [one for one in same_setup if one is not own and one.facts.up_axis == own.facts.up_axis]
    for index in (plate.index for plate in own.facts.plates if plate.zero is None and plate.type != CONTACT_TYPE):
        read = [plate.zero for one in others for plate in one.facts.plates if plate.index == index]
        known = [zero for zero in read if zero is not None and any(zero)]
        if known:
            zeros[index] = [statistics.median(values) for values in zip(*known, strict=True)]
    return zeros


def select_static_trial(own: TrialFacts, others: Sequence[TrialFacts]) -> TrialFacts | None:
    """The static trial of a session: of its motionless trials the one with most landmarks, then most shared labels.

    The caller has to handle an unknown marker set.
    """
    labels = {label.lower() for label in own.facts.labels}

    def selection_key(one: TrialFacts) -> tuple[int, int, str]:
        shared = len(labels & {label.lower() for label in one.facts.labels})
        return len(one.facts.landmarks), shared, one.sha256

    still = [one for one in _distinct_trials(own, others) if one.facts.still and one.sha256 != own.sha256]
    return max(still, key=selection_key, default=None)


def equipment_key(facts: RecordingFacts) -> tuple[object, ...]:
    """Key equal for trials with the same equipment: rates and plates; only the number of contacts of MOT files."""
    plates = []
    for plate in facts.plates:
        corners = [round(x / CORNER_RESOLUTION_M) for corner in plate.corners_m for x in corner]
        plates.append((plate.type, () if plate.type == CONTACT_TYPE else tuple(corners)))
    return facts.marker_rate_hz, facts.force_rate_hz, tuple(plates)


def _distinct_trials(own: TrialFacts, others: Sequence[TrialFacts]) -> list[TrialFacts]:
    """``own`` and the others; of identical files only the one with the smallest id.

    Others whose markers were named by a proposal are left out: a wrong name stays in one trial.
    """
    named = [one for one in others if one.facts.marker_set != PROPOSED]
    by_hash = {one.sha256: one for one in sorted(named, key=lambda one: one.recording_id, reverse=True)}
    return list({**by_hash, own.sha256: own}.values())


def _trial_masses(trials: Sequence[TrialFacts]) -> dict[str, tuple[float, float]]:
    """Mass by trial id with the standard deviation that it has in the mean.

    Trials whose plates never show their zero have its error in common: together they count as one of them.
    """
    weighed = [one for one in trials if None not in (one.facts.mass_from_force_kg, one.facts.mass_from_force_sd_kg)]
    hidden = {one.recording_id for one in weighed if _hides_zero(one.facts)}
    common_kg = UNKNOWN_ZERO_SD_KG * math.sqrt(max(len(hidden) - 1, 0))
    masses = {}
    for one in weighed:
        mass_kg, own_kg = one.facts.mass_from_force_kg or 0.0, one.facts.mass_from_force_sd_kg or 0.0
        zero_kg = common_kg if one.recording_id in hidden else 0.0
        masses[one.recording_id] = (mass_kg, math.hypot(own_kg, MASS_REPEATABILITY_SHARE * mass_kg, zero_kg))
    return masses


def _hides_zero(facts: RecordingFacts) -> bool:
    """Whether a plate in use is loaded from the first to the last sample and has no zero from elsewhere."""
    last_s = facts.duration_s - 1.5 / facts.marker_rate_hz
    return any(
        plate.use
        and plate.zero is None
        and any(start_s <= 1.5 / facts.marker_rate_hz and end_s >= last_s for start_s, end_s in plate.loaded_s)
        for plate in facts.plates
    )


def _pool_with_others(measured: dict[str, tuple[float, float]], own: str, *, scaled: bool = False) -> Pooled | None:
    """Pool the (value, sd) pairs by trial id; None unless a trial other than ``own`` has a value."""
    if not measured.keys() - {own}:
        return None
    values, sds = zip(*measured.values(), strict=True)
    return pool_measurements(values, sds, scaled=scaled)
