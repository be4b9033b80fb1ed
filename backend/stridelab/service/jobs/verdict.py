"""Derives the verdict on a job's result from its summary.

The verdict depends on the parts of the summary (certificate, replay, quality, replans), not on the kind of the job, so
new kinds with one of these parts are covered. The table of jobs holds results of all versions, so a summary that lacks
a field has no verdict and is not an error.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from stridelab.schemas.jobs import JobVerdict

VERDICT_FIELDS: Final = ("certificate", "replay", "quality", "replans", "carried_on")
"""Fields of a summary that its verdict depends on."""
MAX_LISTED_CHECKS: Final = 3
"""Maximum number of checks that a message names; the rest is counted."""


def verdict_of(summary: Mapping[str, Any]) -> JobVerdict | None:
    """Verdict on the result with this ``summary``; None if the summary contains no checks."""
    for derive in (_motion_verdict, _quality_verdict, _replanning_verdict):
        verdict = derive(summary)
        if verdict is not None:
            return verdict
    return None


def _motion_verdict(summary: Mapping[str, Any]) -> JobVerdict | None:
    """Precedence: a fall in the replay, then a failed check, then an incomplete replay."""
    certificate, replay = _sub_mapping(summary, "certificate"), _sub_mapping(summary, "replay")
    if not isinstance(certificate.get("passed"), bool):
        return None
    certified = certificate["passed"]
    failed = _failed_checks(certificate)
    message = "Certified" if certified else f"Not certified{_list_checks(failed)}"
    completed = replay.get("completed")
    fall_time_s = replay.get("fall_time_s")
    # earlier versions stored no reasons: not completed meant that the robot fell
    if isinstance(fall_time_s, int | float) or (completed is False and replay.get("remarks") is None):
        when = f" at {fall_time_s:.1f} s" if isinstance(fall_time_s, int | float) else ""
        message = f"{message}{', but' if certified else ';'} the robot falls{when} in the replay"
        return JobVerdict(outcome="failed", code="replay-fell", message=message, failed_checks=failed)
    if completed is False:
        codes = [
            str(remark["code"]).removeprefix("replay-")
            for remark in _mapping_rows(replay, "remarks")
            if "code" in remark
        ]
        message = f"{message}; replay not completed{_list_checks(codes)}"
    elif completed:
        message = f"{message}; replay completed"
    if not certified:
        return JobVerdict(outcome="failed", code="not-certified", message=message, failed_checks=failed)
    if completed is False:
        return JobVerdict(outcome="failed", code="replay-not-completed", message=message)
    return JobVerdict(outcome="passed", code="certified", message=message)


def _quality_verdict(summary: Mapping[str, Any]) -> JobVerdict | None:
    quality = _sub_mapping(summary, "quality")
    failed = _failed_checks(quality)
    match quality.get("verdict"):
        case "good":
            return JobVerdict(outcome="passed", code="sensors-agree", message="Sensors agree")
        case "doubtful":
            message = f"Doubtful{_list_checks(failed)}"
            return JobVerdict(outcome="doubtful", code="sensors-doubtful", message=message, failed_checks=failed)
        case "contradicted":
            message = f"Sensors contradict each other{_list_checks(_contradicted_checks(quality) or failed)}"
            return JobVerdict(outcome="failed", code="sensors-contradict", message=message, failed_checks=failed)
        case _:
            return None


def _replanning_verdict(summary: Mapping[str, Any]) -> JobVerdict | None:
    """Receding-horizon walk: a period without a solution continues with the previous plan."""
    replans, unsolved = summary.get("replans"), summary.get("carried_on")
    if not isinstance(replans, int) or not isinstance(unsolved, int):
        return None
    if unsolved == 0:
        return JobVerdict(outcome="passed", code="every-replan-solved", message="Every replan found a solution")
    message = f"No solution in {unsolved} of {replans} replans"
    return JobVerdict(outcome="doubtful", code="replan-failed", message=message)


def _sub_mapping(summary: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    part = summary.get(name)
    return part if isinstance(part, Mapping) else {}


def _mapping_rows(part: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    rows = part.get(name)
    return [row for row in rows if isinstance(row, Mapping)] if isinstance(rows, list) else []


def _failed_checks(part: Mapping[str, Any]) -> list[str]:
    return [str(row["name"]) for row in _mapping_rows(part, "checks") if row.get("passed") is False and "name" in row]


def _contradicted_checks(quality: Mapping[str, Any]) -> list[str]:
    """Names of the checks whose two sensors contradict each other."""
    names: list[str] = []
    for row in _mapping_rows(quality, "checks"):
        value, limit = row.get("value"), row.get("contradicted_above")
        if isinstance(value, int | float) and isinstance(limit, int | float) and value > limit and "name" in row:
            names.append(str(row["name"]))
    return names


def _check_label(name: str) -> str:
    """Readable name of a check: ``com_error_max`` becomes ``CoM error``."""
    label = name.removesuffix("_max").removesuffix("_min").replace("_", " ").replace("-", " ")
    return f"CoM {label.removeprefix('com ')}" if label.startswith("com ") else label


def _list_checks(names: Sequence[str]) -> str:
    """``: a, b, c and 2 more`` with readable names; empty without names."""
    if not names:
        return ""
    text = ", ".join(_check_label(name) for name in names[:MAX_LISTED_CHECKS])
    more = f" and {len(names) - MAX_LISTED_CHECKS} more" if len(names) > MAX_LISTED_CHECKS else ""
    return f": {text}{more}"
