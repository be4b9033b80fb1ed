"""``PATCH /recordings/{id}``: which columns change, and whether the file must be read again."""

import tempfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from sqlalchemy import update

from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.schemas.recordings import PlateSwitch, Recording, RecordingFacts, RecordingPatch
from stridelab.service.api.parts import Parts
from stridelab.service.api.recordings.parsing import Switches, parse
from stridelab.service.api.recordings.rows import recording_of, recording_row
from stridelab.service.api.recordings.storing import refuse_bundled, replace_facts
from stridelab.service.api.subjects.rows import subject_row
from stridelab.service.jobs.kinds.session_rows import session_of
from stridelab.service.sessions import session_id_of
from stridelab.service.storage.tables import recording


async def change_recording(parts: Parts, recording_id: str, patch: RecordingPatch) -> Recording:
    """Change the fields that were given in ``patch``; changed switches make the file be read again.

    Raises ``NotFound`` (``recording-not-found``), ``Conflict`` (``bundled-read-only``, ``changed-meanwhile``),
    ``InvalidInput`` (``invalid-request``) naming a field that cannot hold, and what reading the file may raise.
    """
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
    refuse_bundled(row)
    links = await _links(parts, row, patch)
    elsewhere = await _static_labels(parts, {**row, **links})
    switches = _switches(row, patch, elsewhere)
    unread = "session_id" in patch.model_fields_set and "clock" not in row["facts"]
    if switches != Switches.of_row(row) or unread:
        with tempfile.TemporaryDirectory(dir=parts.spool) as name:
            await parts.blobs.get_file(row["blob_key"], Path(name) / "trial", row["sha256"])
            parsed = await parse(parts, Path(name), "trial", row["filename"], switches, elsewhere)
            await replace_facts(parts, row, switches, parsed, lambda locked: _changes(locked, patch, links))
    elif patch.model_fields_set:
        async with parts.engine.begin() as connection:
            locked = await recording_row(connection, recording_id, lock=True)
            changes = _changes(locked, patch, links)
            if changes:
                await connection.execute(update(recording).where(recording.c.id == recording_id).values(changes))
    async with parts.engine.connect() as connection:
        return recording_of(await recording_row(connection, recording_id))


def _subject_fields(row: Mapping[str, Any], patch: RecordingPatch) -> dict[str, Any]:
    """The column of stated subject fields, if it changes: given fields are set, null clears one, or all."""
    if "subject" not in patch.model_fields_set:
        return {}
    if patch.subject is None:
        return {"subject_fields": {}}
    merged = {**row["subject_fields"], **patch.subject.model_dump(mode="json", exclude_unset=True)}
    return {"subject_fields": {name: value for name, value in merged.items() if value is not None}}


async def _links(parts: Parts, row: Mapping[str, Any], patch: RecordingPatch) -> dict[str, Any]:
    """Changed links to a subject and to a static trial, which must exist."""
    changes: dict[str, Any] = {}
    async with parts.engine.connect() as connection:
        try:
            if "subject_id" in patch.model_fields_set:
                changes["subject_id"] = patch.subject_id
                if patch.subject_id is not None:
                    await subject_row(connection, patch.subject_id)
            if "static_recording_id" in patch.model_fields_set:
                changes["static_recording_id"] = patch.static_recording_id
                if patch.static_recording_id == row["id"]:
                    raise _invalid("static_recording_id", "a recording cannot be its own static trial")
                if patch.static_recording_id is not None:
                    await recording_row(connection, patch.static_recording_id)
        except NotFound as error:
            where = "static_recording_id" if error.code == "recording-not-found" else "subject_id"
            raise _invalid(where, error.message) from error
    return changes


def _changes(row: Mapping[str, Any], patch: RecordingPatch, links: Mapping[str, Any]) -> dict[str, Any]:
    """The columns that change: a session that is not stated follows the person."""
    changes = {**links, **_subject_fields(row, patch)}
    if "session_id" in patch.model_fields_set and patch.session_id is not None:
        return {**changes, "session_id": patch.session_id, "session_stated": True}
    if not patch.model_fields_set or (row["session_stated"] and "session_id" not in patch.model_fields_set):
        return changes
    return {**changes, "session_id": session_id_of({**row, **changes}, row["created_at"]), "session_stated": False}


async def _static_labels(parts: Parts, row: Mapping[str, Any]) -> tuple[str, ...]:
    """Labels of the recording's static trial, which its marker map may name, too."""
    async with parts.engine.connect() as connection:
        static = (await session_of(connection, row)).static
    return () if static is None else tuple(RecordingFacts.model_validate(static["facts"]).labels)


def _switches(row: Mapping[str, Any], patch: RecordingPatch, elsewhere: Collection[str]) -> Switches:
    """The switches after ``patch``: the marker map is replaced, plates are changed one by one; null resets all.

    ``elsewhere`` are the labels of the static trial.
    """
    present = Switches.of_row(row)
    facts = RecordingFacts.model_validate(row["facts"])
    marker_map, plates = dict(present.marker_map), dict(present.plates)
    if "marker_map" in patch.model_fields_set:
        marker_map = dict(patch.marker_map or {})
        unknown = [label for label in marker_map.values() if label not in {*facts.labels, *elsewhere}]
        if unknown:
            raise _invalid(
                "marker_map",
                f"neither the file nor its static trial has a marker {', '.join(label[:40] for label in unknown[:5])}",
            )
    if "plates" in patch.model_fields_set:
        known = {plate.index for plate in facts.plates}
        if patch.plates is None:
            plates = {}
        for index, switch in (patch.plates or {}).items():
            if index not in known:
                raise _invalid(f"plates.{index}", f"the file has the plates {sorted(known)}")
            before = plates.get(index, PlateSwitch()).model_dump(exclude_none=True)
            plates[index] = PlateSwitch.model_validate({**before, **switch.model_dump(exclude_unset=True)})
    return Switches(marker_map, plates)


def _invalid(where: str, message: str) -> InvalidInput:
    return InvalidInput("invalid-request", f"The change is not possible: {where}: {message}.", [Fault(where, message)])
