"""Computes the session values of a job from the rows of the session's recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.pipelines.session_values import TrialFacts, equipment_key, share_session
from stridelab.schemas.recordings import EventDelays, RecordingFacts
from stridelab.schemas.sessions import SessionValues
from stridelab.service.storage.tables import recording

Row = Mapping[str, Any]


@dataclass(frozen=True)
class StagedSession:
    """``values`` of the session, None if it has one recording only; ``static`` is the row of its static trial."""

    values: SessionValues | None = None
    static: Row | None = None


async def session_of(connection: AsyncConnection, row: Row) -> StagedSession:
    """The session of a recording's row: the other recordings of its owner with the same ``session_id``.

    The static trial is the stated one, which is then not part of the session values, else that of the session.
    """
    stated = await _recording_row(connection, row["static_recording_id"])
    others = await other_recordings(connection, row)
    trials = [_trial_facts(one) for one in others]
    share = share_session(row["session_id"] or "", _trial_facts(row), trials, static_stated=stated is not None)
    if share.static is None:
        return StagedSession(share.values, stated)
    return StagedSession(share.values, next(one for one in others if one["id"] == share.static.recording_id))


def session_delays(row: Row, others: Sequence[Row], latency_s: float | None) -> list[EventDelays]:
    """Delays of the marker events in other recordings of the session of ``row``, without the latency of the force.

    That is ``latency_s`` with the equipment of ``row``, if it is known, else the one of each file. Identical files
    count once.
    """
    equipment = equipment_key(RecordingFacts.model_validate(row["facts"]))
    delays = []
    for facts in {one["sha256"]: RecordingFacts.model_validate(one["facts"]) for one in others}.values():
        force_late_s = latency_s
        if force_late_s is None or equipment_key(facts) != equipment:
            force_late_s = 0.0 if facts.clock is None else facts.clock.latency_s
        strike, lift_off = (
            None if one is None else one.model_copy(update={"late_s": one.late_s + force_late_s})
            for one in (facts.event_delays.strike, facts.event_delays.lift_off)
        )
        delays.append(EventDelays(strike=strike, lift_off=lift_off))
    return delays


async def other_recordings(connection: AsyncConnection, row: Row) -> list[Row]:
    """Rows of the other recordings of the session of a recording's row."""
    if row["session_id"] is None:
        return []
    same = select(recording).where(
        recording.c.session_id == row["session_id"],
        recording.c.owner.is_not_distinct_from(row["owner"]),
        recording.c.id != row["id"],
    )
    return [dict(one) for one in (await connection.execute(same.order_by(recording.c.id))).mappings().all()]


async def _recording_row(connection: AsyncConnection, recording_id: str | None) -> Row | None:
    if recording_id is None:
        return None
    result = await connection.execute(select(recording).where(recording.c.id == recording_id))
    row = result.mappings().one_or_none()
    return None if row is None else dict(row)


def _trial_facts(row: Row) -> TrialFacts:
    return TrialFacts(row["id"], row["filename"], row["sha256"], RecordingFacts.model_validate(row["facts"]))
