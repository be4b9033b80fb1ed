"""Assigns a recording to a session: the recordings of one subject on one day.

The session id depends on the recording's own data alone, neither on the order of the uploads nor on other recordings.
The subject is identified, in this order, by the linked subject, by the stated pseudonym, or by height and mass (with
sex and age) where both are given. The day is the recording date in the file, else the upload date (UTC). A recording
whose subject cannot be identified, and a simulated one without a named subject, has no session. Sessions of different
owners are different.
"""

import uuid
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final

from stridelab.schemas.recordings import RecordingFacts

SESSION_NAMESPACE: Final = uuid.UUID("5e55105e-0000-5000-8000-57a1de1ab000")
"""UUID namespace of the session ids that the service derives."""


def session_id_of(row: Mapping[str, Any], created_at: datetime) -> str | None:
    """Session id of a recording's row that was uploaded at ``created_at``; None where the subject is not identified.

    ``row`` has ``owner``, ``facts``, ``subject_id`` and ``subject_fields``.
    """
    facts = RecordingFacts.model_validate(row["facts"])
    person = subject_key(facts, row.get("subject_id"), row["subject_fields"])
    if person is None:
        return None
    day = facts.recorded_on or created_at.astimezone(UTC).date()
    return uuid.uuid5(SESSION_NAMESPACE, repr((row.get("owner") or "", person, day.isoformat()))).hex


def subject_key(facts: RecordingFacts, subject_id: str | None, stated: Mapping[str, Any]) -> tuple[str, ...] | None:
    """What identifies the subject of a recording among those of its owner; None if nothing does."""
    if subject_id is not None:
        return ("subject", subject_id)
    if name := str(stated.get("name") or "").strip():
        return ("name", name)
    if facts.simulated:
        return None
    fields = facts.subject.model_dump(exclude={"name"}, exclude_none=True)
    fields.update({name: value for name, value in stated.items() if value is not None and name != "name"})
    if "height_m" not in fields or "mass_kg" not in fields:
        return None
    return ("body", *(f"{name}={fields[name]}" for name in sorted(fields)))
