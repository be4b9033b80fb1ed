"""Merges the subject fields of all recordings of a study into one record per subject."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.recording import Remark
from stridelab.schemas.population import PersonFields
from stridelab.walking.population.population import Person, assign_group

SUBJECT_FIELDS: Final = ("height_m", "mass_kg", "sex", "age_years")
FIELD_TOLERANCES: Final[Mapping[str, float]] = {"height_m": 0.02, "mass_kg": 5.0, "age_years": 1.0}
"""Tolerances below which differing values of one subject cause no warning."""


@dataclass(frozen=True)
class RecordingSubject:
    """Subject fields of one recording; ``leg_m`` is the leg length measured in it."""

    filename: str
    fields: PersonFields
    leg_m: float | None = None

    @property
    def subject_name(self) -> str:
        """The pseudonym, else the file name: recordings without a pseudonym count as different subjects."""
        return self.fields.subject or self.filename


@dataclass(frozen=True)
class StudySubject:
    """A subject with all fields and recordings."""

    person: Person
    fields: PersonFields
    recordings: tuple[str, ...]


def merge_subjects(sheets: Sequence[RecordingSubject]) -> tuple[tuple[StudySubject, ...], tuple[Remark, ...]]:
    """One subject per name, in order of appearance; of conflicting values the first is used, with a remark.

    Raises ``InvalidInput`` (``subject-in-two-groups``) if a subject is in two groups.
    """
    names = dict.fromkeys(sheet.subject_name for sheet in sheets)
    remarks: list[Remark] = []
    people = []
    for name in names:
        own = [sheet for sheet in sheets if sheet.subject_name == name]
        groups = dict.fromkeys(sheet.fields.group for sheet in own if sheet.fields.group)
        if len(groups) > 1:
            raise InvalidInput(
                "subject-in-two-groups",
                f"{name} is in the groups {' and '.join(groups)}; a subject can be in one group only.",
                [Fault(sheet.filename, f"group {sheet.fields.group}") for sheet in own if sheet.fields.group],
            )
        merged: dict[str, Any] = {}
        for field in SUBJECT_FIELDS:
            values = [v for sheet in own if (v := getattr(sheet.fields, field)) is not None]
            merged[field] = values[0] if values else None
            if any(_values_differ(field, values[0], other) for other in values[1:]):
                listed = ", ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in dict.fromkeys(values))
                message = f"The recordings of {name} state different values of {field} ({listed}); the first is used."
                remarks.append(Remark("subject-differs", message))
        group, source = assign_group(next(iter(groups), None), merged["age_years"], merged["height_m"])
        legs = [sheet.leg_m for sheet in own if sheet.leg_m is not None]
        leg_m = float(np.median(legs)) if legs else None
        person = Person(name=name, group=group, height_m=merged["height_m"], leg_m=leg_m, group_source=source)
        fields = PersonFields(subject=name[:80], group=group, **merged)
        people.append(StudySubject(person, fields, tuple(sheet.filename for sheet in own)))
    unclaimed = [sheet.filename for sheet in sheets if sheet.fields.subject is None]
    if len(unclaimed) > 1:
        message = f"{len(unclaimed)} recordings have no subject; each counts as a separate subject."
        remarks.append(Remark("subjects-assumed", message))
    return tuple(people), tuple(remarks)


def _values_differ(field: str, one: Any, other: Any) -> bool:
    return one != other if field == "sex" else abs(float(one) - float(other)) > FIELD_TOLERANCES[field]
