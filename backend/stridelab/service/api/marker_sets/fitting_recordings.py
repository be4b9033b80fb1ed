"""Recordings whose labels fit a new marker set: they are selected by their stored labels and parsed again."""

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any, Final

import structlog
from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import StridelabError
from stridelab.recordings.marker_sets import MarkerSet, identify
from stridelab.service.api.dependencies import Parts
from stridelab.service.api.recordings.service import parse_again
from stridelab.service.storage.tables import recording

log = structlog.get_logger(__name__)

ANSWER_WITHIN_S: Final = 10.0
"""Maximum time that a request waits for recordings to be parsed again; the others are parsed after the response."""
_running: set[asyncio.Task[None]] = set()


async def fitting_recordings(connection: AsyncConnection, known: MarkerSet) -> list[str]:
    """Ids of the recordings that ``known`` fits better than the shipped sets do, newest first; without samples."""
    columns = (recording.c.id, recording.c.marker_map, recording.c.facts["labels"].label("labels"))
    query = select(*columns).where(~recording.c.bundled).order_by(recording.c.created_at.desc(), recording.c.id)
    rows = [dict(row) for row in (await connection.execute(query)).mappings()]
    return await asyncio.to_thread(lambda: [row["id"] for row in rows if _fits(known, row)])


def _fits(known: MarkerSet, row: Mapping[str, Any]) -> bool:
    labels: list[str] = row["labels"]
    stated = {landmark: label for landmark, label in row["marker_map"].items() if label in labels}
    try:
        return identify(labels, stated, [known]).name == known.name
    except StridelabError:  # a stored map that this version refuses
        return False


async def parse_all_again(parts: Parts, recording_ids: Sequence[str]) -> None:
    """Parse recordings again, one after the other; returns when all are done or after ``ANSWER_WITHIN_S``."""

    async def work() -> None:
        for recording_id in recording_ids:
            if parts.closing.is_set():
                return
            try:
                await parse_again(parts, recording_id)
            except StridelabError as error:  # deleted or changed in the meantime, or its file is damaged
                log.warning("recording not parsed again", recording=recording_id, code=error.code)

    task = asyncio.create_task(work())
    _running.add(task)
    task.add_done_callback(_finished)
    await asyncio.wait({task}, timeout=ANSWER_WITHIN_S)


def _finished(task: asyncio.Task[Any]) -> None:
    _running.discard(task)
    if not task.cancelled() and (error := task.exception()) is not None:
        log.error("recordings not parsed again", error=repr(error))
