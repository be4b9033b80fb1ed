"""The verdict on a result, derived from its summary.

It goes by what the summary holds (a certificate, a replay, a quality, replans), not by the kind of the job: a new
kind whose summary has one of these needs nothing here. Results of every version are in the table of jobs, so a
summary that lacks a field has no verdict, and is no error.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from stridelab.schemas.verdicts import JobVerdict

LISTED: Final = 3
"""Checks that a message names before it counts the rest."""


def verdict_of(summary: Mapping[str, Any]) -> JobVerdict | None:
    """The verdict on the result with this ``summary``; None where nothing in it was checked."""
    for found in (_of_motion, _of_quality, _of_replans):
        verdict = found(summary)
        if verdict is not None:
            return verdict
    return None


def _of_motion(summary: Mapping[str, Any]) -> JobVerdict | None:
    """A fall in the replay outweighs a failed check, and a failed check a replay that is not completed."""
    certificate, replay = _part(summary, "certificate"), _part(summary, "replay")
    if not isinstance(certificate.get("passed"), bool):
        return None
    certified = certificate["passed"]
    failed = _failed(certificate)
    said = "Certified" if certified else f"Not certified{_listed(failed)}"
    completed = replay.get("completed")
    fall_time_s = replay.get("fall_time_s")
    # earlier versions gave no reasons: not completed meant that the robot fell
    if isinstance(fall_time_s, int | float) or (completed is False and replay.get("remarks") is None):
        when = f" at {fall_time_s:.1f} s" if isinstance(fall_time_s, int | float) else ""
        said = f"{said}{', but' if certified else ';'} the robot falls{when} in the replay"
        return JobVerdict(outcome="failed", code="replay-fell", message=said, failed_checks=failed)
    if completed is False:
        codes = [str(remark["code"]).removeprefix("replay-") for remark in _rows(replay, "remarks") if "code" in remark]
        said = f"{said}; replay not completed{_listed(codes)}"
    elif completed:
        said = f"{said}; replay completed"
    if not certified:
        return JobVerdict(outcome="failed", code="not-certified", message=said, failed_checks=failed)
    if completed is False:
        return JobVerdict(outcome="failed", code="replay-not-completed", message=said)
    return JobVerdict(outcome="passed", code="certified", message=said)


def _of_quality(summary: Mapping[str, Any]) -> JobVerdict | None:
    quality = _part(summary, "quality")
    failed = _failed(quality)
    match quality.get("verdict"):
        case "good":
            return JobVerdict(outcome="passed", code="sensors-agree", message="Sensors agree")
        case "doubtful":
            message = f"Doubtful{_listed(failed)}"
            return JobVerdict(outcome="doubtful", code="sensors-doubtful", message=message, failed_checks=failed)
        case "contradicted":
            message = f"Sensors contradict each other{_listed(_contradicted(quality) or failed)}"
            return JobVerdict(outcome="failed", code="sensors-contradict", message=message, failed_checks=failed)
        case _:
            return None


def _of_replans(summary: Mapping[str, Any]) -> JobVerdict | None:
    """A walk with a receding horizon: a period without a solution is carried on with the plan before."""
    replans, unsolved = summary.get("replans"), summary.get("carried_on")
    if not isinstance(replans, int) or not isinstance(unsolved, int):
        return None
    if unsolved == 0:
        return JobVerdict(outcome="passed", code="every-replan-solved", message="Every replan found a solution")
    message = f"No solution in {unsolved} of {replans} replans"
    return JobVerdict(outcome="doubtful", code="replan-failed", message=message)


def _part(summary: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    part = summary.get(name)
    return part if isinstance(part, Mapping) else {}


def _rows(part: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    rows = part.get(name)
    return [row for row in rows if isinstance(row, Mapping)] if isinstance(rows, list) else []


def _failed(part: Mapping[str, Any]) -> list[str]:
    return [str(row["name"]) for row in _rows(part, "checks") if row.get("passed") is False and "name" in row]


def _contradicted(quality: Mapping[str, Any]) -> list[str]:
    """The checks whose two sensors cannot both be right, the reason of the verdict."""
    found: list[str] = []
    for row in _rows(quality, "checks"):
        value, limit = row.get("value"), row.get("contradicted_above")
        if isinstance(value, int | float) and isinstance(limit, int | float) and value > limit and "name" in row:
            found.append(str(row["name"]))
    return found


def _in_words(name: str) -> str:
    """``com_error_max`` as ``CoM error``: which extreme of it was checked is in the certificate."""
    said = name.removesuffix("_max").removesuffix("_min").replace("_", " ").replace("-", " ")
    return f"CoM {said.removeprefix('com ')}" if said.startswith("com ") else said


def _listed(names: Sequence[str]) -> str:
    """``: a, b, c and 2 more``, in words; empty where there is no name."""
    if not names:
        return ""
    said = ", ".join(_in_words(name) for name in names[:LISTED])
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return f": {said}{more}"
