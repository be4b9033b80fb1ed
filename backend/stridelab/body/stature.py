"""Stature that the legs suggest, to notice that the subject's data in a file belong to another person."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from stridelab.body.joint_centres import shank_length_m
from stridelab.recordings.recording import Recording, Remark, Subject

SHANK_SHARE: Final = 0.246
"""Shank over stature (Drillis and Contini 1966; Winter 2009)."""
POSSIBLE: Final = (0.7, 1.4)
"""Stated stature over that of the legs: 1.4 is a shank of 0.34 of the stature, 0.7 one of 0.17."""


def without_foreign_subject(recording: Recording, landmarks: Mapping[str, str]) -> Recording:
    """``recording`` without height, mass, sex and age of its file if its legs cannot be those of that height."""
    stated_m = recording.subject.height_m
    tracks = {name: recording.markers_m[label] for name, label in landmarks.items() if label in recording.markers_m}
    legs_m = shank_length_m(tracks) / SHANK_SHARE
    if stated_m is None or not legs_m > 0.0 or POSSIBLE[0] < stated_m / legs_m < POSSIBLE[1]:
        return recording
    mass = "" if recording.subject.mass_kg is None else f" and {recording.subject.mass_kg:g} kg"
    message = (
        f"The file states a subject of {stated_m:.2f} m{mass}, and its markers show the legs of a person of about "
        f"{legs_m:.2f} m: height, mass, sex and age in the file are those of somebody else, or in another unit, and "
        "are not used."
    )
    remarks = (*recording.remarks, Remark("subject-of-another-body", message))
    return replace(recording, subject=Subject(), remarks=remarks)
