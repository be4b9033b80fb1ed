"""Queries of recordings, and conversion of their rows to the ``Recording`` schema."""

from collections.abc import Mapping
from typing import Any, Final

from sqlalchemy import Select, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.recordings.marker_sets import WAYS_TO_NAME_MARKERS
from stridelab.schemas.base import Remark
from stridelab.schemas.recordings import Recording, RecordingFacts, SubjectFields
from stridelab.service.api.dependencies import require_id_form, required_row
from stridelab.service.estimable import estimate_offers
from stridelab.service.storage.tables import marker_set, recording, subject

Row = Mapping[str, Any]
STORED_FIELDS: Final = (
    *("id", "sha256", "filename", "bytes", "created_at", "subject_id", "marker_map", "static_recording_id"),
    *("session_id", "session_stated", "bundled", "truth_job_id", "owner"),
)
"""Fields of a ``Recording`` that are columns of its row."""
SEARCHED_COLUMNS: Final = (
    recording.c.filename,
    recording.c.session_id,
    recording.c.subject_fields["name"].astext,
    recording.c.facts["marker_set"].astext,
    subject.c.fields["name"].astext,
)
"""Texts of a row of ``recordings_with_subjects`` in which a search looks."""


def recordings_with_subjects() -> Select[Any]:
    """Select every recording with the fields of its linked subject, and the id of its marker set if that is stored."""
    linked = recording.outerjoin(subject, recording.c.subject_id == subject.c.id).outerjoin(
        marker_set, recording.c.facts["marker_set_id"].astext == marker_set.c.id
    )
    columns = (subject.c.fields.label("linked_fields"), marker_set.c.id.label("present_set_id"))
    return select(recording, *columns).select_from(linked)


async def recording_row(connection: AsyncConnection, recording_id: str, *, lock: bool = False) -> Row:
    """The row of one recording, optionally locked until the transaction ends.

    Raises ``NotFound`` (``recording-not-found``).
    """
    query = recordings_with_subjects().where(recording.c.id == require_id_form(recording_id, "recording"))
    if lock:
        query = query.with_for_update(of=recording)
    return await required_row(connection, query, "recording")


def merged_subject(facts: RecordingFacts, linked: Mapping[str, Any] | None, stated: Mapping[str, Any]) -> SubjectFields:
    """Merge the subject fields: those stated for this recording, else of the linked subject, else in the file.

    The name in the file is never used.
    """
    merged = facts.subject.model_dump(exclude={"name"}, exclude_none=True)
    for fields in (linked or {}, stated):
        merged.update({name: value for name, value in fields.items() if value is not None})
    return SubjectFields.model_validate(merged)


def _deleted_set_remark(facts: RecordingFacts) -> Remark:
    message = (
        f"The marker set {facts.marker_set}, which named these markers, has been deleted: a new estimate uses the "
        f"other sets. {WAYS_TO_NAME_MARKERS}"
    )
    return Remark(code="marker-set-deleted", message=message)


def recording_of(row: Row) -> Recording:
    """Convert a row of ``recordings_with_subjects`` to a ``Recording``."""
    facts = RecordingFacts.model_validate(row["facts"])
    if facts.marker_set_id is not None and row["present_set_id"] is None:
        facts = facts.model_copy(update={"warnings": [*facts.warnings, _deleted_set_remark(facts)]})
    subject = merged_subject(facts, row["linked_fields"], row["subject_fields"])
    static_stated = row["static_recording_id"] is not None
    alone = row["session_id"] is None and not static_stated
    return Recording(
        **facts.model_dump(exclude={"subject"}),
        **{name: row[name] for name in STORED_FIELDS},
        subject=subject,
        estimates=estimate_offers(facts, subject, no_other_mass_source=alone, static_stated=static_stated),
    )
