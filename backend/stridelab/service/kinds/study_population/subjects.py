"""Who is who in a study: the subject table, what users stated, and what the files say, brought to one person each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.recording import Remark
from stridelab.schemas.population import PersonFields
from stridelab.walking.population.population import Person, group_of

FIELDS: Final = ("height_m", "mass_kg", "sex", "age_years")
SAME: Final[Mapping[str, float]] = {"height_m": 0.02, "mass_kg": 5.0, "age_years": 1.0}
"""Differences between recordings of one person that are not worth a word."""


@dataclass(frozen=True)
class Sheet:
    """What is known of the person on one recording; ``leg_m`` was measured on it."""

    filename: str
    fields: PersonFields
    leg_m: float | None = None

    @property
    def name(self) -> str:
        """The pseudonym, else the file's name: recordings that nobody claims are of different people."""
        return self.fields.subject or self.filename


@dataclass(frozen=True)
class Someone:
    """A person with everything that is shown of them."""

    person: Person
    fields: PersonFields
    recordings: tuple[str, ...]


def people_of(sheets: Sequence[Sheet]) -> tuple[tuple[Someone, ...], tuple[Remark, ...]]:
    """One person per name, in the order in which they come; of contradicting values the first counts, and it is said.

    Raises ``InvalidInput`` (``subject-in-two-groups``) where a person is stated to be in two groups.
    """
    names = dict.fromkeys(sheet.name for sheet in sheets)
    remarks: list[Remark] = []
    found = []
    for name in names:
        own = [sheet for sheet in sheets if sheet.name == name]
        groups = dict.fromkeys(sheet.fields.group for sheet in own if sheet.fields.group)
        if len(groups) > 1:
            raise InvalidInput(
                "subject-in-two-groups",
                f"{name} is stated to be in the groups {' and '.join(groups)}; a person is in one.",
                [Fault(sheet.filename, f"group {sheet.fields.group}") for sheet in own if sheet.fields.group],
            )
        known: dict[str, Any] = {}
        for field in FIELDS:
            values = [v for sheet in own if (v := getattr(sheet.fields, field)) is not None]
            known[field] = values[0] if values else None
            if any(_differ(field, values[0], other) for other in values[1:]):
                said = ", ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in dict.fromkeys(values))
                message = f"The recordings of {name} state different values of {field} ({said}); the first is used."
                remarks.append(Remark("subject-differs", message))
        group, source = group_of(next(iter(groups), None), known["age_years"], known["height_m"])
        legs = [sheet.leg_m for sheet in own if sheet.leg_m is not None]
        leg_m = float(np.median(legs)) if legs else None
        person = Person(name=name, group=group, height_m=known["height_m"], leg_m=leg_m, group_source=source)
        fields = PersonFields(subject=name[:80], group=group, **known)
        found.append(Someone(person, fields, tuple(sheet.filename for sheet in own)))
    unclaimed = [sheet.filename for sheet in sheets if sheet.fields.subject is None]
    if len(unclaimed) > 1:
        message = f"{len(unclaimed)} recordings do not say whose they are; each counts as a person of its own."
        remarks.append(Remark("subjects-assumed", message))
    return tuple(found), tuple(remarks)


def _differ(field: str, one: Any, other: Any) -> bool:
    return one != other if field == "sex" else abs(float(one) - float(other)) > SAME[field]
