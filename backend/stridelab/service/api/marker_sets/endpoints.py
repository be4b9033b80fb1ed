"""Endpoints of users' marker sets: store, list, read, delete, and propose one for a recording."""

import uuid
from collections.abc import Mapping
from typing import Annotated, Any, Final

from fastapi import APIRouter, Body, Response
from sqlalchemy import delete, func, select
from sqlalchemy.dialects.postgresql import insert
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Conflict, Fault
from stridelab.recordings.marker_sets import marker_set_of_labels, marker_sets
from stridelab.schemas.base import Page
from stridelab.schemas.marker_sets import (
    AddedMarkerSet,
    MarkerSetInput,
    MarkerSetProposal,
    MarkerSetProposalInput,
    StoredMarkerSet,
)
from stridelab.service.api.dependencies import AppParts, CallerOf, require_id_form, required_row
from stridelab.service.api.marker_sets.fitting_recordings import fitting_recordings, parse_all_again
from stridelab.service.api.openapi import failure_responses
from stridelab.service.api.pagination import Cursor, Limit, Order, read_page
from stridelab.service.api.recordings.service import propose_landmarks
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.auth import audit
from stridelab.service.auth.callers import require_owner
from stridelab.service.storage.tables import marker_set

router = APIRouter(prefix="/marker-sets", tags=["recordings"], route_class=StrictRoute)

Row = Mapping[str, Any]
MAX_SETS: Final = 200
"""Maximum number of stored sets: all of them are considered for every recording."""
_LEGS: Final[Any] = {
    f"{side}_{landmark}": f"{side.upper()} {place}"
    for side in "lr"
    for landmark, place in {
        "asis": "hip front",
        "psis": "hip back",
        "knee_lateral": "knee out",
        "ankle_lateral": "ankle out",
    }.items()
}
_EXAMPLE: Final[Any] = {
    "legs": {"summary": "Pelvis and legs", "value": {"name": "example-lab", "landmarks": _LEGS}},
}
_PROPOSAL_EXAMPLE: Final[Any] = {
    "sample": {"summary": "The sample recording", "value": {"recording_id": "sample-walk"}},
}
_UNKNOWN: Final = failure_responses(s404="No marker set with this id (`marker-set-not-found`).")


@router.get("", summary="List marker sets")
async def list_marker_sets(parts: AppParts, limit: Limit = 50, cursor: Cursor = None) -> Page[StoredMarkerSet]:
    """List the marker sets that users stored, newest first. Shipped sets are not listed."""
    rows, following = await read_page(parts.engine, select(marker_set), Order(marker_set), limit, cursor)
    return Page[StoredMarkerSet](items=[_set_of(row) for row in rows], next=following)


@router.post(
    "",
    status_code=201,
    summary="Add a marker set",
    responses=failure_responses(
        s409="A set of this name exists (`marker-set-name-taken`), or there are too many (`too-many-marker-sets`).",
        s422="An entry is invalid (`marker-set-invalid`, `invalid-request`); `errors` names it.",
    ),
)
async def add_marker_set(
    parts: AppParts,
    caller: CallerOf,
    body: Annotated[MarkerSetInput, Body(openapi_examples=_EXAMPLE)],
    response: Response,
) -> AddedMarkerSet:
    """Store a marker set. It is used for all recordings whose labels fit, at upload and at each estimate.

    A shipped set is chosen instead only if it matches more markers of a recording; of several stored sets, the one
    that matches the most, then the recording owner's own, then the newest. `recordings` lists the stored recordings
    that fit: their files are parsed again.
    """
    known = marker_set_of_labels(body.name, body.labels_of(), body.required or ())
    async with parts.engine.begin() as connection:
        stored = _set_of(await _insert(connection, caller.name, body))
        await audit.record_action(connection, caller, "marker-set-added", stored.id)
        fitting = await fitting_recordings(connection, known)
    await parse_all_again(parts, fitting)
    response.headers["Location"] = f"/api/v1/marker-sets/{stored.id}"
    return AddedMarkerSet(**stored.model_dump(), recordings=fitting)


async def _insert(connection: AsyncConnection, owner: str | None, body: MarkerSetInput) -> Row:
    if (await connection.execute(select(func.count()).select_from(marker_set))).scalar_one() >= MAX_SETS:
        raise Conflict("too-many-marker-sets", f"{MAX_SETS} marker sets are stored; delete one that is not used.")
    row = {"id": uuid.uuid4().hex, "owner": owner, "name": body.name, "body": body.model_dump(mode="json")}
    new = insert(marker_set).values(row).on_conflict_do_nothing(index_elements=["name"]).returning(*marker_set.c)
    stored = None if body.name in marker_sets() else (await connection.execute(new)).mappings().one_or_none()
    if stored is None:
        message = f"There is a marker set named {body.name}; choose another name, or delete that set first."
        raise Conflict("marker-set-name-taken", message, [Fault("name", "taken")])
    return dict(stored)


@router.post(
    "/propose",
    summary="Propose a marker map",
    responses=failure_responses(s404="No recording with this id (`recording-not-found`)."),
)
async def propose_marker_map(
    parts: AppParts, body: Annotated[MarkerSetProposalInput, Body(openapi_examples=_PROPOSAL_EXAMPLE)]
) -> MarkerSetProposal:
    """Propose the landmark of each marker of a recording, from its label and from its position and motion.

    Nothing is stored. Check the proposal, then send it as the `marker_map` of the recording, or store it as a marker
    set.
    """
    return await propose_landmarks(parts, body.recording_id)


@router.get("/{marker_set_id}", summary="One marker set", responses=_UNKNOWN)
async def get_marker_set(parts: AppParts, marker_set_id: str) -> StoredMarkerSet:
    """One marker set: landmarks and labels."""
    async with parts.engine.connect() as connection:
        return _set_of(await _row(connection, marker_set_id))


@router.delete("/{marker_set_id}", status_code=204, summary="Delete a marker set", responses=_UNKNOWN)
async def delete_marker_set(parts: AppParts, caller: CallerOf, marker_set_id: str) -> None:
    """Delete one's own marker set.

    Results remain. Recordings whose markers it named have the warning `marker-set-deleted`; a new estimate of them
    uses the other sets.
    """
    async with parts.engine.begin() as connection:
        row = await _row(connection, marker_set_id)
        require_owner(caller, row["owner"], "marker set")
        await audit.record_action(connection, caller, "marker-set-deleted", marker_set_id)
        await connection.execute(delete(marker_set).where(marker_set.c.id == marker_set_id))


async def _row(connection: AsyncConnection, marker_set_id: str) -> Row:
    query = select(marker_set).where(marker_set.c.id == require_id_form(marker_set_id, "marker-set"))
    return await required_row(connection, query, "marker-set")


def _set_of(row: Row) -> StoredMarkerSet:
    return StoredMarkerSet.model_validate({**row["body"], **{n: row[n] for n in ("id", "created_at", "owner")}})
