"""Predicts from the stored facts of a recording which methods can estimate its centre of mass.

A method that is refused here is refused by ``estimate-com`` with the same code. The reverse does not hold: gaps of
markers, or a static trial, are detected only when the body model is fitted. Needs no numeric package.
"""

from typing import Final

from stridelab.recordings.marker_sets import WAYS_TO_NAME_MARKERS
from stridelab.schemas.methods import METHODS
from stridelab.schemas.recordings import EstimateOffer, RecordingFacts, SubjectFields

SHORTEST_WINDOW_S: Final = 0.4
"""Same value as in ``stridelab.estimation.differentiation``, which needs a numeric package."""
MIN_WINDOW_S: Final = 0.25
"""Same value as in ``stridelab.recordings.force_windows``."""
MIN_FRAMES: Final = 6
"""Same value as in ``stridelab.recordings.force_windows``."""
_GEOMETRY_HINT: Final = "The method geometry gives the centre of mass from the markers alone."

Refusal = tuple[str, str]
"""Error code and message."""


def estimate_offers(
    facts: RecordingFacts, subject: SubjectFields, *, no_other_mass_source: bool, static_stated: bool = False
) -> list[EstimateOffer]:
    """Every method, with code and reason where it refuses the recording.

    ``subject`` holds the subject's fields as stated or read from the file. ``no_other_mass_source``: no other recording
    of the session and no static trial can supply the body mass. ``static_stated``: a user named the static trial, which
    may name the labels of an unknown marker set.
    """
    labels = None if static_stated else _label_refusal(facts)
    sides = next(((one.code, one.message) for one in facts.warnings if one.code == "sides-swapped"), None)
    geometry = labels or sides or _geometry_refusal(facts)
    force = (
        labels
        or _force_refusal(facts, subject)
        or _mass_refusal(facts, subject, no_other_mass_source=no_other_mass_source)
        or sides
    )
    return [_estimate_offer(method, geometry if method == "geometry" else force) for method in METHODS]


def _estimate_offer(method: str, refusal: Refusal | None) -> EstimateOffer:
    code, reason = refusal or (None, None)
    return EstimateOffer.model_validate({"method": method, "possible": code is None, "code": code, "reason": reason})


def _label_refusal(facts: RecordingFacts) -> Refusal | None:
    if facts.marker_set is not None:
        return None
    message = f"The {len(facts.labels)} marker labels belong to no known marker set."
    return "unknown-marker-set", f"{message} {WAYS_TO_NAME_MARKERS}"


def _geometry_refusal(facts: RecordingFacts) -> Refusal | None:
    if facts.duration_s < SHORTEST_WINDOW_S:
        message = f"The recording lasts {facts.duration_s:.2f} s; at least {SHORTEST_WINDOW_S} s are needed."
        return "window-too-short", message
    return _frames_refusal(facts)


def _frames_refusal(facts: RecordingFacts) -> Refusal | None:
    if facts.n_frames < MIN_FRAMES:
        message = (
            f"The recording has {facts.n_frames} frames in a row; at least {MIN_FRAMES} are needed for the velocity."
        )
        return "recording-too-short", f"{message} It can serve as a static trial."
    return None


def _force_refusal(facts: RecordingFacts, subject: SubjectFields) -> Refusal | None:
    """Check the requirements of the methods that fuse force with markers, in the same order as the job."""
    if facts.n_frames < 2:
        return "single-frame", "The recording has only one frame: it can serve as a static trial."
    if not facts.plates:
        message = "The recording has no force plate, so no force can be fused with the markers."
        return "no-plates", f"{message} {_GEOMETRY_HINT}"
    if (few := _frames_refusal(facts)) is not None:
        return few
    if facts.duration_s < MIN_WINDOW_S:
        message = f"The recording lasts {1000.0 * facts.duration_s:.0f} ms; at least {MIN_WINDOW_S:g} s are needed."
        return "recording-too-short", message
    remarks = {remark.code: remark.message for remark in facts.warnings}
    used = [plate for plate in facts.plates if plate.use]
    if not used and "cop-never-on-plate" in remarks:
        message = (
            "No force plate of this recording can be used: under no unit does a centre of pressure lie on its plate."
        )
        return "cop-off-all-plates", f"{message} {_GEOMETRY_HINT}"
    if not used:
        return "plates-switched-off", "All force plates of this recording are switched off."
    if not any(plate.loaded_s for plate in used):
        return "plates-unloaded", "The force plates of this recording are never loaded."
    if "force-missing" in remarks and subject.mass_kg != facts.subject.mass_kg:
        return None  # the intervals of missing force depend on the mass, which has changed since the file was read
    clipped = "".join(f"{remark.message} " for remark in facts.warnings if remark.code == "force-clipped")
    if not facts.windows_s:
        message = f"At no time is all contact force measured. {clipped}{remarks.get('force-missing', '')}".strip()
        return "no-measured-window", f"{message} {_GEOMETRY_HINT}"
    longest_s = max(end_s - start_s for start_s, end_s in facts.windows_s)
    if longest_s + 1.0 / facts.marker_rate_hz < SHORTEST_WINDOW_S:
        message = (
            f"All contact force is measured for {longest_s:.2f} s at a time; at least {SHORTEST_WINDOW_S} s are needed."
        )
        return "window-too-short", f"{message} {clipped}{_GEOMETRY_HINT}"
    return None


def _mass_refusal(facts: RecordingFacts, subject: SubjectFields, *, no_other_mass_source: bool) -> Refusal | None:
    if subject.mass_kg is not None or facts.mass_from_force_kg is not None or not no_other_mass_source:
        return None
    message = (
        "The body mass is neither stated nor in the file, and no force is measured for long enough to weigh "
        "the person. The method geometry needs no mass."
    )
    return "mass-unknown", message
