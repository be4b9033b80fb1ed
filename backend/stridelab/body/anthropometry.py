"""Joint-centre regressions and mean proportions of the body (``models/anthropometry.toml``)."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from stridelab.conventions import Vector3
from stridelab.recordings.recording import Sex
from stridelab.resources import models_dir


@dataclass(frozen=True)
class SagittalOffset:
    """A point in the median plane: angle above the line C7 -> jugular notch, distance per length of that line."""

    angle_deg: float
    scale: float


@dataclass(frozen=True)
class Anthropometry:
    """Joint-centre regressions and mean lengths of one sex, or the mean of both.

    ``lumbar`` and ``hip`` (right side) are in the pelvis frame from mid-ASIS, per distance between the ASIS.
    ``proportions`` are joint widths and lengths per length of the shank; the positions are explained in the data file.
    ``height_m`` is the stature of the subject, None if unknown.
    """

    lumbar: Vector3
    hip: Vector3
    cervical: SagittalOffset
    shoulder: SagittalOffset
    length_m: Mapping[str, float]
    proportions: Mapping[str, float]
    ankle_in_foot: Vector3
    shoulder_in_torso: Vector3
    cervical_from_acromia: Vector3
    shoulder_from_acromion: Vector3
    torso_per_stature: float
    references: tuple[str, ...]
    height_m: float | None = None


@cache
def load_anthropometry(sex: Sex | None) -> Anthropometry:
    """Load the regressions for one sex; without a sex, the mean of both."""
    data = _anthropometry_data()
    columns = [data[s] for s in (("female", "male") if sex is None else (sex,))]

    def mean_over_sexes(*path: str) -> Any:
        values: list[Any] = list(columns)
        for key in path:
            values = [value[key] for value in values]
        return np.mean(values, axis=0)

    def sagittal_offset(name: str) -> SagittalOffset:
        return SagittalOffset(float(mean_over_sexes(name, "angle_deg")), float(mean_over_sexes(name, "scale")))

    places = {name: np.array(place) for name, place in data["places"].items()}
    return Anthropometry(
        lumbar=mean_over_sexes("lumbar"),
        hip=mean_over_sexes("hip"),
        cervical=sagittal_offset("cervical"),
        shoulder=sagittal_offset("shoulder"),
        length_m={segment: float(mean_over_sexes("length_m", segment)) for segment in columns[0]["length_m"]},
        proportions=data["proportions"],
        ankle_in_foot=places["ankle_in_foot"],
        shoulder_in_torso=places["shoulder_in_torso"],
        cervical_from_acromia=places["cervical_from_acromia"],
        shoulder_from_acromion=places["shoulder_from_acromion"],
        torso_per_stature=float(data["torso_per_stature"]),
        references=tuple(data["references"]),
    )


@cache
def _anthropometry_data() -> Mapping[str, Any]:
    return tomllib.loads((models_dir() / "anthropometry.toml").read_text(encoding="utf-8"))
