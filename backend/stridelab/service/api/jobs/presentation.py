"""Converts job records of the store to the ``Job`` schema."""

from collections.abc import Mapping
from typing import Any, Final

from stridelab.schemas.base import FaultItem, Problem
from stridelab.schemas.jobs import Job, JobState
from stridelab.service.jobs.progress_words import progress_of
from stridelab.service.jobs.store import JobRecord
from stridelab.service.jobs.verdict import verdict_of

_NAMED_BY: Final = ("robot", "item", "session_id")
"""Fields of an input that say what a job is about."""
_ENDED: Final[Mapping[JobState, tuple[int, str]]] = {
    "failed": (422, "Job failed"),
    "timed_out": (504, "Job timed out"),
    "cancelled": (409, "Job cancelled"),
}


def job_of(record: JobRecord) -> Job:
    """Convert a record to a ``Job``."""
    return Job.from_object(
        record,
        n_recordings=len(pooled) if isinstance(pooled := record.input.get("recording_ids"), list) else None,
        about=record.subject_name or _subject_of(record.input),
        progress=progress_of(record.fraction, record.message),
        error=_problem_of(record),
        verdict=None if record.verdict_parts is None else verdict_of(record.verdict_parts),
    )


def _subject_of(job_input: Mapping[str, Any]) -> str | None:
    """Name of the scenario in the body of a job, else of its robot, item or session; None if it has none of them."""
    scenario = job_input.get("scenario")
    names = (
        scenario.get("name") if isinstance(scenario, Mapping) else None,
        *(job_input.get(field) for field in _NAMED_BY),
    )
    return next((name for name in names if isinstance(name, str) and name), None)


def _problem_of(record: JobRecord) -> Problem | None:
    if record.error is None:
        return None
    status, title = _ENDED.get(record.state, (500, "Job error"))
    return Problem(
        title=title,
        status=status,
        code=record.error["code"],
        detail=record.error["detail"],
        instance=f"/api/v1/jobs/{record.id}",
        errors=[FaultItem(**item) for item in record.error.get("errors", [])],
    )
