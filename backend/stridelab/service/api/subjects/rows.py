"""Rows of subjects as the contract shows them."""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Select, func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.recordings import Subject
from stridelab.service.api.parts import known_form, not_found
from stridelab.service.storage.tables import recording, subject


def subjects_with_counts() -> Select[Any]:
    """Every subject with the number of recordings that are linked to it."""
    linked = select(func.count()).where(recording.c.subject_id == subject.c.id).scalar_subquery()
    return select(subject, linked.label("n_recordings"))


async def subject_row(connection: AsyncConnection, subject_id: str, *, lock: bool = False) -> Mapping[str, Any]:
    """The row of one subject. Raises ``NotFound`` (``subject-not-found``)."""
    query = subjects_with_counts().where(subject.c.id == known_form(subject_id, "subject"))
    if lock:
        query = query.with_for_update(of=subject)
    row = (await connection.execute(query)).mappings().one_or_none()
    if row is None:
        raise not_found("subject")
    return dict(row)


def subject_of(row: Mapping[str, Any]) -> Subject:
    """The subject of a row."""
    return Subject(
        subject_id=row["id"], created_at=row["created_at"], n_recordings=row["n_recordings"], **row["fields"]
    )
