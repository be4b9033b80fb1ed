"""Endpoints and queries of subjects: pseudonymous persons, to whom several recordings may be linked."""

import uuid
from collections.abc import Mapping
from typing import Annotated, Any, Final

from fastapi import APIRouter, Body, Query, Response
from sqlalchemy import Select, delete, func, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.base import Page
from stridelab.schemas.recordings import Subject, SubjectInput
from stridelab.service.api.dependencies import AppParts, CallerOf, require_id_form, required_row
from stridelab.service.api.jobs import delete as deleting
from stridelab.service.api.openapi import failure_responses
from stridelab.service.api.pagination import Cursor, Limit, Order, Search, Sort, read_page
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.auth import audit
from stridelab.service.auth.callers import require_owner
from stridelab.service.storage.search import contains_words
from stridelab.service.storage.tables import recording, subject

router = APIRouter(prefix="/subjects", tags=["subjects"], route_class=StrictRoute)

_EXAMPLE: Final[Any] = {
    "adult": {
        "summary": "An adult",
        "value": {"name": "P07", "height_m": 1.71, "mass_kg": 60.4, "sex": "female", "age_years": 31},
    }
}
_TALLER: Final[Any] = {"height": {"summary": "Correct one field", "value": {"height_m": 1.72}}}
_UNKNOWN: Final = failure_responses(s404="No subject with this id (`subject-not-found`).")


@router.get("", summary="List subjects")
async def list_subjects(
    parts: AppParts, search: Search = None, sort: Sort = "newest", limit: Limit = 50, cursor: Cursor = None
) -> Page[Subject]:
    """List subjects, each with the number of its recordings. `search` looks in the pseudonym."""
    name, query = subject.c.fields["name"].astext, subjects_with_counts()
    if search is not None:
        query = query.where(contains_words(search, name))
    rows, following = await read_page(parts.engine, query, Order(subject, sort, name), limit, cursor)
    return Page[Subject](items=[subject_of(row) for row in rows], next=following)


@router.post("", status_code=201, summary="Add a subject")
async def add_subject(
    parts: AppParts,
    caller: CallerOf,
    body: Annotated[SubjectInput, Body(openapi_examples=_EXAMPLE)],
    response: Response,
) -> Subject:
    """Add a subject. `name` is a pseudonym of your choice; names inside uploaded files are never used."""
    subject_id = f"s{uuid.uuid4().hex[:12]}"
    async with parts.engine.begin() as connection:
        values = {"id": subject_id, "owner": caller.name, "fields": body.model_dump(mode="json")}
        await connection.execute(insert(subject).values(values))
        stored = subject_of(await subject_row(connection, subject_id))
    response.headers["Location"] = f"/api/v1/subjects/{stored.subject_id}"
    return stored


@router.get("/{subject_id}", summary="One subject", responses=_UNKNOWN)
async def get_subject(parts: AppParts, subject_id: str) -> Subject:
    """One subject."""
    async with parts.engine.connect() as connection:
        return subject_of(await subject_row(connection, subject_id))


@router.patch("/{subject_id}", summary="Change a subject", responses=_UNKNOWN)
async def change_subject(
    parts: AppParts, subject_id: str, body: Annotated[SubjectInput, Body(openapi_examples=_TALLER)]
) -> Subject:
    """Change the given fields; null clears a field. The change applies to all recordings linked to the subject."""
    async with parts.engine.begin() as connection:
        row = await subject_row(connection, subject_id, lock=True)
        fields = {**row["fields"], **body.model_dump(mode="json", exclude_unset=True)}
        await connection.execute(update(subject).where(subject.c.id == subject_id).values(fields=fields))
        return subject_of({**row, "fields": fields})


@router.delete("/{subject_id}", status_code=204, summary="Delete a subject", responses=_UNKNOWN)
async def delete_subject(
    parts: AppParts,
    caller: CallerOf,
    subject_id: str,
    response: Response,
    with_studies: Annotated[
        bool, Query(description="also delete one's own finished studies that contain data of the subject")
    ] = False,
) -> None:
    """Delete one's own subject. Its recordings and their results remain, without the link.

    Studies of several recordings contain the subject's name, height, mass and age. `with_studies` deletes them as well;
    the header `Stridelab-Kept-In` lists those that remain.
    """
    async with parts.engine.begin() as connection:
        row = await subject_row(connection, subject_id, lock=True)
        require_owner(caller, row["owner"], "subject")
        await audit.record_action(connection, caller, "subject-deleted", subject_id)
        linked = await connection.execute(select(recording.c.id).where(recording.c.subject_id == subject_id))
        recordings = list(linked.scalars())
        await connection.execute(delete(subject).where(subject.c.id == subject_id))
    studies = await deleting.studies_of(parts, recordings)
    if with_studies:
        studies = await deleting.delete_studies(parts, studies, caller)
    if studies:
        response.headers[deleting.REMAINING_JOBS_HEADER] = ", ".join(studies)


def subjects_with_counts() -> Select[Any]:
    """Select every subject with the number of recordings linked to it."""
    linked = select(func.count()).where(recording.c.subject_id == subject.c.id).scalar_subquery()
    return select(subject, linked.label("n_recordings"))


async def subject_row(connection: AsyncConnection, subject_id: str, *, lock: bool = False) -> Mapping[str, Any]:
    """The row of one subject. Raises ``NotFound`` (``subject-not-found``)."""
    query = subjects_with_counts().where(subject.c.id == require_id_form(subject_id, "subject"))
    if lock:
        query = query.with_for_update(of=subject)
    return await required_row(connection, query, "subject")


def subject_of(row: Mapping[str, Any]) -> Subject:
    """Convert a row to a ``Subject``."""
    return Subject(
        subject_id=row["id"], created_at=row["created_at"], n_recordings=row["n_recordings"], **row["fields"]
    )
