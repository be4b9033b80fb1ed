"""Segment tables: mass fraction of each segment and position of its centre of mass in the segment's frame.

    c = sum_s m_s p_s,   p_s = o_s + L_s R_s k_s,   sum_s m_s = 1

``m_s`` is ``SegmentRow.mass_fraction``, ``k_s`` is ``SegmentRow.com`` (forwards, upwards, rightwards, as a fraction of
the segment length ``L_s``); origin ``o_s``, rotation ``R_s`` and ``L_s`` come from ``stridelab.body.segment_model``. A
table is keyed by frame names: unpaired ones (``pelvis``, ``torso``, ``head``) and sided ones (``l_thigh``,
``r_thigh``). A file may give a paired segment once, without side, as measured on the right: the left one is its mirror
image.

Published fractions sum to one only up to rounding (0.998 to 1.004); they are divided by their sum on loading.

Joint-centre regressions and mean proportions of the body (``models/anthropometry.toml``).
"""

import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np

from stridelab.conventions import Vector3
from stridelab.errors import InvalidInput
from stridelab.machine.models_folder import models_dir
from stridelab.recordings.recording import Sex

PAIRED: Final = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot", "whole_foot")
"""Segments that exist on both sides; all others lie in the median plane."""

DEFAULT_SD_M: Final = (0.008, 0.004, 0.020)
"""Prior error of a table that does not state its own: forwards, sideways (bodies are nearly symmetric), upwards."""


@dataclass(frozen=True)
class SegmentRow:
    """Mass fraction and CoM in the segment's frame (forwards, upwards, rightwards) per segment length."""

    mass_fraction: float
    com: tuple[float, float, float]

    def mirror_image(self) -> "SegmentRow":
        """The same segment on the other side of the body."""
        x, y, z = self.com
        return SegmentRow(self.mass_fraction, (x, y, -z))


@dataclass(frozen=True)
class SegmentTable:
    """Table of one body: rows by frame name, mass fractions summing to one, and the table's error.

    ``sd_m`` is forwards, sideways and upwards of the body.
    """

    name: str
    segments: Mapping[str, SegmentRow]
    sd_m: tuple[float, float, float] = DEFAULT_SD_M
    references: tuple[str, ...] = ()


def load_table(name: str, sex: Sex | None) -> SegmentTable:
    """Table ``models/segment_tables/<name>.toml`` for one sex; without a sex, the mean of both.

    Raises ``InvalidInput`` (``segment-table-unknown``) for a name that is not shipped.
    """
    data = _table_data(name)
    sexes: tuple[Sex, ...] = ("female", "male") if sex is None else (sex,)
    segments = {
        segment: {
            "mass_fraction": sum(columns[s]["mass_fraction"] for s in sexes) / len(sexes),
            "com": [sum(columns[s]["com"][axis] for s in sexes) / len(sexes) for axis in range(3)],
        }
        for segment, columns in data["segments"].items()
    }
    return parse_table({"name": name, "segments": segments, "sd_m": data["sd_m"], "references": data["references"]})


def parse_table(data: Mapping[str, Any]) -> SegmentTable:
    """Validate the plain form ``{"name", "segments": {segment: {"mass_fraction", "com"}}, "sd_m"?, "references"?}``.

    Raises ``InvalidInput`` (``segment-table-invalid``) naming the segment with invalid numbers.
    """
    try:
        rows = dict(_parse_rows(data["segments"]))
        sd = _finite_triple(data.get("sd_m", DEFAULT_SD_M))
        name, references = str(data["name"]), tuple(str(key) for key in data.get("references", ()))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InvalidInput("segment-table-invalid", f"The segment table cannot be read: {error}.") from error
    total = sum(row.mass_fraction for row in rows.values())
    if not 0.95 < total < 1.05:
        raise InvalidInput(
            "segment-table-invalid", f"The mass fractions of table {name!r} sum to {total:.3f} instead of 1."
        )
    if math.isclose(total, 1.0, rel_tol=1e-12):  # so that a round trip through JSON is exact
        total = 1.0
    normalised = {segment: SegmentRow(row.mass_fraction / total, row.com) for segment, row in rows.items()}
    return SegmentTable(name, normalised, sd, references)


def from_json(text: str) -> SegmentTable:
    """Parse the table embedded in a recording (``Recording.carried["segment_table"]``).

    Raises ``InvalidInput`` (``segment-table-invalid``) if the text is not such a table.
    """
    try:
        data = json.loads(text)
    except ValueError as error:
        raise InvalidInput("segment-table-invalid", "The segment table of the recording is not JSON.") from error
    if not isinstance(data, dict):
        raise InvalidInput("segment-table-invalid", "The segment table of the recording is not a JSON object.")
    return parse_table(data)


def to_json(table: SegmentTable) -> str:
    """Inverse of ``from_json``."""
    segments = {name: {"mass_fraction": row.mass_fraction, "com": row.com} for name, row in table.segments.items()}
    plain = {"name": table.name, "segments": segments, "sd_m": table.sd_m, "references": table.references}
    return json.dumps(plain)


@cache
def _table_data(name: str) -> Mapping[str, Any]:
    shipped = {path.stem: path for path in (models_dir() / "segment_tables").glob("*.toml")}
    if name not in shipped:
        known = ", ".join(sorted(shipped))
        raise InvalidInput("segment-table-unknown", f"There is no segment table {name!r}; available are {known}.")
    return tomllib.loads(shipped[name].read_text(encoding="utf-8"))


def _parse_rows(segments: Mapping[str, Any]) -> Iterator[tuple[str, SegmentRow]]:
    for name, values in segments.items():
        row = SegmentRow(float(values["mass_fraction"]), _finite_triple(values["com"]))
        if not 0.0 < row.mass_fraction < 1.0:
            raise ValueError(f"segment {name} has mass fraction {row.mass_fraction}")
        if name in PAIRED:
            yield f"l_{name}", row.mirror_image()
            yield f"r_{name}", row
        else:
            yield name, row


def _finite_triple(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    if not all(math.isfinite(value) for value in (x, y, z)):
        raise ValueError(f"{[x, y, z]} is not finite")
    return x, y, z


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
