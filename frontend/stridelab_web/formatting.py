"""Formatting of values on the pages, and the filters of the templates."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Final

from markupsafe import Markup

from stridelab.schemas.base import FaultItem, Problem, Remark
from stridelab.schemas.jobs import FINAL_STATES, Job
from stridelab.schemas.robots import Capability
from stridelab.translations.catalogue import ENGLISH, current_language, gettext, ngettext, translate_sentence


def fixed_decimals(value: float | None, digits: int = 2) -> str:
    """``value`` with a fixed number of decimals; a dash for None."""
    return "–" if value is None else f"{value:z.{digits}f}"


def plain_number(value: float | None) -> str:
    """The shortest decimal form of ``value`` to six digits, for form fields; empty for None."""
    return "" if value is None else f"{value:.6g}"


def with_unit(value: float, unit: str) -> str:
    """A measured value with its unit, to three digits: short lengths and times in thousandths, a ratio as a number."""
    if unit in ("m", "s") and 0 < abs(value) < 0.1:
        value, unit = 1000 * value, f"m{unit}"
    text = f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e6 else f"{value:.3g}"
    return f"{text} {unit}" if unit not in ("", "1") else text


_FAILED_CHECK: Final = re.compile(r"certificate: (\w+) (-?[\d.]+(?:e[+-]?\d+)?)(?: (.+))?")
_REPLAYED: Final = re.compile("^replay: ")
CAPABILITY_TITLES: Final = {
    "stair": "One stair, both feet",
    "pace": "Level walk",
    "turn": "Turn per step, on the spot",
    "push-ahead": "Push ahead",
    "push-back": "Push back",
    "push-left": "Push to the left",
    "push-right": "Push to the right",
}


def capability_title(name: str) -> str:
    """What a capability of a robot is, in words."""
    return CAPABILITY_TITLES.get(name, name)


def capability_value(capability: Capability) -> str:
    """The value of a capability, with *at least* where more may pass, or *none* where not even the smallest passes."""
    if not capability.value:
        return "–" if capability.value is None else "none"
    more = "at least " if capability.ended_by in ("range", "time") else ""
    return f"{more}{_of_capability(capability, capability.value)}"


def capability_limit(capability: Capability) -> str:
    """Why a capability is not larger: what becomes of the smallest value that fails."""
    ends = {"range": "More was not tried.", "time": "The time ended; more may be possible."}
    if (text := ends.get(capability.ended_by)) is not None:
        return text
    failed = min((one for one in capability.attempts if not one.passed), key=lambda one: one.value, default=None)
    if failed is None:
        return capability.reason
    return f"At {_of_capability(capability, failed.value)}: {trial_reason(failed.reason)}"


def _of_capability(capability: Capability, value: float) -> str:
    """A value of a capability in the units of the page."""
    shown = {"rad": (math.degrees(value), "°"), "m": (100 * value, " cm")}
    number, unit = shown.get(capability.unit, (value, f" {capability.unit}"))
    return f"{number:.3g}{unit}"


def trial_reason(reason: str) -> str:
    """Why a motion does not pass, with the checks of its certificate named as on the page of a plan."""
    parts = reason.split("; ")
    checks = [match for part in parts if (match := _FAILED_CHECK.fullmatch(part))]
    others = [_REPLAYED.sub("in physics: ", part) for part in parts if not _FAILED_CHECK.fullmatch(part)]
    if checks:
        failed = (f"{check_name(match[1])}: {with_unit(float(match[2]), match[3] or '1')}" for match in checks)
        others.insert(0, f"not certified ({', '.join(failed)})")
    return "; ".join(others)


def utc_text(value: datetime) -> str:
    """A time stamp in UTC to the minute, as plain text."""
    return value.astimezone(UTC).strftime("%Y-%m-%d %H:%M UTC")


def time_element(value: datetime) -> Markup:
    """A ``<time>`` element in UTC; ``static/js/shared/local_times.js`` replaces it by the local time with its zone."""
    text = utc_text(value)
    return Markup('<time datetime="{}" title="{}">{}</time>').format(value.astimezone(UTC).isoformat(), text, text)


def count_text(number: int, noun: str, plural: str = "") -> str:
    """``1 frame``, ``2 frames``, as static/js/shared/plurals.js; ``plural`` defaults to ``noun`` with an s."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def size_text(count: int) -> str:
    """A size in kB or MB of 10^3 and 10^6 bytes."""
    return f"{count / 1e6:.1f} MB" if count >= 1e5 else f"{count / 1e3:.1f} kB"


def total_s(intervals: Iterable[Sequence[float]]) -> float:
    """Sum of the lengths of the intervals."""
    return sum((end - start for start, end in intervals), 0.0)


def code_words(code: str) -> str:
    """``l_head_front|head_top`` as ``l head front or head top``: the readable form of a code."""
    return code.replace("|", " or ").replace("-", " ").replace("_", " ")


def robot_title(name: str) -> str:
    """Name of a robot as people write it; of one's own robot, the name that it was given."""
    return _ROBOTS.get(name, name)


def landmark_words(code: str) -> str:
    """``l_head_front|head_top`` as ``left head front or head top``: landmarks that can stand for one another."""
    return re.sub(r"\bl ", "left ", re.sub(r"\br ", "right ", code_words(code)))


def part_words(code: str) -> str:
    """Effector, joint or link in words: ``leg_left_4_link`` as ``left leg 4``."""
    bare = re.sub(r"_(?:joint|link)$", "", code)
    return code_words(re.sub(r"^(leg|arm)_(left|right)_(\d)$", r"\2 \1 \3", bare))


def check_name(code: str) -> str:
    """Name of a check of a certificate."""
    name = code_words(code).replace("com ", "CoM ")
    for ending, text in ((" max", ", largest"), (" min", ", smallest")):
        if name.endswith(ending):
            name = name.removesuffix(ending) + text
    return name[:1].upper() + name[1:]


def job_kind_name(code: str) -> str:
    """Name of a kind of job; of one without an entry in ``KINDS``, its code in words."""
    return gettext(KINDS.get(code, code_words(code).capitalize()))


def item_name(code: str) -> str:
    """Name of a reproduction item: ``fig-2.6`` is Figure 2.6; other tables have a name in words."""
    kind_of, _, number = code.partition("-")
    return f"{_ITEMS[kind_of]} {number}" if kind_of in _ITEMS else _TABLES.get(code, code_words(code).capitalize())


def verdict_text(code: str) -> str:
    """Text of a verdict on a claim of the thesis, or of what became of our own aim."""
    return _VERDICTS.get(code, code_words(code))


def first_upper(text: str) -> str:
    """``text`` with a capital at its beginning; the rest is unchanged, as in RTS."""
    return text[:1].upper() + text[1:]


def method_name(code: str) -> str:
    """Name of an estimator; the suffix ``-thesis`` stands for the settings of the thesis."""
    name = code.removesuffix("-thesis")
    named = gettext(METHODS.get(name, code_words(name)))
    return named if name == code else gettext("%(method)s, thesis", method=named)


def job_headline(job: Job) -> str:
    """Text beside the state of a job; the same sentence as in static/js/shared/api.js.

    The verdict is shown separately, in its own colour.
    """
    if job.state == "queued":
        place = job.queue_position
        return gettext("waiting") if place is None else gettext("place %(place)s in the queue", place=place)
    if job.error is not None:
        return job.error.detail
    return "" if job.state in FINAL_STATES else job.progress.text or job.progress.message


def job_subject(job: Job) -> str:
    """What a job is about; the beginning of its id if nothing says it."""
    if job.n_recordings is not None:
        return ngettext("%(num)s recording", "%(num)s recordings", job.n_recordings)
    if job.about is None:
        return job.id[:8]
    return item_name(job.about) if job.kind == "reproduce" else job.about


METHODS = {
    "smoother": "smoother",
    "complementary": "complementary filter",
    "rts": "RTS smoother",
    "kalman": "Kalman filter",
    "geometry": "markers only",
}
STATES = ("queued", "running", "succeeded", "failed", "cancelled", "timed out", "cancelling")
"""The states of a job in words."""
_ROBOTS = {"g1": "G1", "hrp2": "HRP-2", "talos": "TALOS"}
_ITEMS = {"fig": "Figure", "table": "Table", "numbers": "Numbers of chapter"}
_TABLES = {
    "errors": "Errors of all methods",
    "lag": "Lag of all methods",
    "coverage": "Coverage of the band",
    "partial-force": "One second of force in two",
    "flight": "Free fall in running",
    "occupancy": "Velocity and rate of momentum beside the densities",
}
_VERDICTS = {
    "met": "as the thesis says",
    "beaten": "better than the thesis",
    "not_met": "not confirmed here",
    "thesis_in_error": "cannot hold as printed",
    "undecided": "undecided",
    "aim_reached": "our aim: reached",
    "aim_undecided": "our aim: undecided",
    "aim_missed": "our aim: missed",
}
KINDS = {
    "estimate-com": "Centre of mass",
    "compare-estimators": "Comparison of methods",
    "reproduce": "Reproduction",
    "simulate-recording": "Simulated recording",
    "plan-contacts": "Contact plan",
    "plan-motion": "Motion plan",
    "plan-receding": "Receding horizon",
    "push-basin": "Pushes",
    "imitate": "Imitation",
    "sweep": "Sweep",
    "learn-reachability": "Reachability",
    "fit-cycloid": "Rolling wheel",
    "study-population": "Population",
    "gait-measures": "Gait measures",
    "gait-report": "Gait report",
    "com-bench": "Estimators over many recordings",
    "read-batch": "Bulk upload",
}
"""Titles of the kinds of jobs that are not their codes in words."""

VERDICT_CODES = frozenset({"doubtful", "contradicted"})
"""Codes of the remark that states the verdict: lists of remarks leave it out."""
_MARKS = {"failed": "✗ ", "doubtful": "! ", "passed": "✓ "}

_SOLVERS = {"native": "C++, exact cones", "ipopt": "CasADi with ipopt", "fatrop": "CasADi with fatrop"}


def tab_mark(job: Job) -> str:
    """Mark of a job's outcome before the title, visible in background tabs."""
    if job.state in ("failed", "timed_out"):
        return "✗ "
    if job.state != "succeeded":
        return ""
    return "✓ " if job.verdict is None else _MARKS[job.verdict.outcome]


def other_remarks(remarks: Iterable[Remark | Mapping[str, str]]) -> list[Remark | Mapping[str, str]]:
    """The remarks of a result, as objects or in JSON, without the one that states the verdict on its sensors."""
    codes = ((one["code"] if isinstance(one, Mapping) else one.code, one) for one in remarks)
    return [one for code, one in codes if code not in VERDICT_CODES]


def faults_not_in_detail(problem: Problem) -> list[FaultItem]:
    """Faults of a problem, without those that its detail already contains; as static/js/shared/api.js."""
    detail = problem.detail.casefold()
    remaining = []
    for item in problem.errors:
        message = "" if item.message.casefold() in detail else item.message
        if message or item.where.rpartition(": ")[2].casefold() not in detail:
            remaining.append(FaultItem(where=item.where, message=message))
    return remaining


def solver_name(name: str) -> str:
    """Display name of a solver of the centroidal problem."""
    return _SOLVERS.get(name, name)


def short_time(seconds: float) -> str:
    """A duration in milliseconds below a tenth of a second, else in seconds."""
    return f"{1e3 * seconds:.1f} ms" if seconds < 0.1 else f"{seconds:.2f} s"


def served_text(message: str) -> Markup | str:
    """A sentence of the service: translated if the catalogue knows it, else marked as English.

    Of a progress message, "stage: activity", each part is a sentence; it is translated if all of them are.
    """
    if current_language() == ENGLISH or not message:
        return message
    translated = translate_sentence(message)
    if translated is None:
        parts = [translate_sentence(part) for part in message.split(": ")]
        translated = None if None in parts else ": ".join(filter(None, parts))
    return translated if translated is not None else Markup('<span lang="en">{}</span>').format(message)


FILTERS = {
    "fixed": fixed_decimals,
    "capability_title": capability_title,
    "capability_value": capability_value,
    "capability_limit": capability_limit,
    "trial_reason": trial_reason,
    "plain": plain_number,
    "robot_title": robot_title,
    "measured": with_unit,
    "moment": utc_text,
    "when": time_element,
    "served": served_text,
    "counted": count_text,
    "megabytes": size_text,
    "total_s": total_s,
    "words": code_words,
    "landmark": landmark_words,
    "check_name": check_name,
    "kind": job_kind_name,
    "item": item_name,
    "verdict": verdict_text,
    "first_upper": first_upper,
    "method": method_name,
    "headline": job_headline,
    "job_subject": job_subject,
    "part_words": part_words,
    "tab_mark": tab_mark,
    "not_in_detail": faults_not_in_detail,
    "other_remarks": other_remarks,
    "solver": solver_name,
    "short_time": short_time,
}
"""Filters of the templates."""
