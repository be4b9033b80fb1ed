"""Which session a recording belongs to: one person, one day.

The id of a session follows from what is known of the recording alone, so that neither the order of the uploads nor
other recordings matter. Who the person is, in this order: the subject that the recording is linked to; the pseudonym
that was stated; height and mass (with sex and age) where both are known. The day is that of the recording where the
file states it, else that of the upload (UTC). A recording of which neither is known, and a simulated one of nobody in
particular, is in no session. Sessions of different owners are different.
"""

import uuid
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final

from stridelab.schemas.recordings import RecordingFacts

NAMESPACE: Final = uuid.UUID("5e55105e-0000-5000-8000-57a1de1ab000")
"""Of the ids of sessions that the service finds."""


def session_id_of(row: Mapping[str, Any], created_at: datetime) -> str | None:
    """The session of a recording's row that was uploaded at ``created_at``; None where the person is not known.

    ``row`` has ``owner``, ``facts``, ``subject_id`` and ``subject_fields``.
    """
    facts = RecordingFacts.model_validate(row["facts"])
    person = _person(facts, row.get("subject_id"), row["subject_fields"])
    if person is None:
        return None
    day = facts.recorded_on or created_at.astimezone(UTC).date()
    return uuid.uuid5(NAMESPACE, repr((row.get("owner") or "", person, day.isoformat()))).hex


def _person(facts: RecordingFacts, subject_id: str | None, stated: Mapping[str, Any]) -> tuple[str, ...] | None:
    if subject_id is not None:
        return ("subject", subject_id)
    if name := str(stated.get("name") or "").strip():
        return ("name", name)
    if facts.simulated:
        return None
    known = facts.subject.model_dump(exclude={"name"}, exclude_none=True)
    known.update({name: value for name, value in stated.items() if value is not None and name != "name"})
    if "height_m" not in known or "mass_kg" not in known:
        return None
    return ("body", *(f"{name}={known[name]}" for name in sorted(known)))
