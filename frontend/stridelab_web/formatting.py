"""How values are written on the pages."""

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime

from markupsafe import Markup

from stridelab.schemas.base import FaultItem, Problem
from stridelab.schemas.jobs import FINAL_STATES, Job


def fixed(value: float | None, digits: int = 2) -> str:
    """``value`` with a fixed number of decimals; a dash where there is none."""
    return "–" if value is None else f"{value:z.{digits}f}"


def plain(value: float | None) -> str:
    """The shortest decimal form of ``value`` to six digits; empty where there is none (forms are filled with it)."""
    return "" if value is None else f"{value:.6g}"


def measured(value: float, unit: str) -> str:
    """A measured value with its unit, to three digits: short lengths and times in thousandths, a ratio as a number."""
    if unit in ("m", "s") and 0 < abs(value) < 0.1:
        value, unit = 1000 * value, f"m{unit}"
    text = f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e6 else f"{value:.3g}"
    return f"{text} {unit}" if unit not in ("", "1") else text


def moment(value: datetime) -> str:
    """A time stamp to the minute, in UTC, which it says; for places that hold text alone."""
    return value.astimezone(UTC).strftime("%Y-%m-%d %H:%M UTC")


def when(value: datetime) -> Markup:
    """A ``<time>`` element in UTC; ``static/js/shared/local_times.js`` replaces it by the local time with its zone."""
    text = moment(value)
    return Markup('<time datetime="{}" title="{}">{}</time>').format(value.astimezone(UTC).isoformat(), text, text)


def counted(number: int, noun: str, plural: str = "") -> str:
    """``1 frame``, ``2 frames``, as static/js/shared/plurals.js; ``plural`` where it is not ``noun`` with an s."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def megabytes(count: int) -> str:
    """A size in kB or MB of 10^3 and 10^6 bytes."""
    return f"{count / 1e6:.1f} MB" if count >= 1e5 else f"{count / 1e3:.1f} kB"


def total_s(intervals: Iterable[Sequence[float]]) -> float:
    """Sum of the lengths of the intervals."""
    return sum((end - start for start, end in intervals), 0.0)


def words(code: str) -> str:
    """``l_head_front|head_top`` as ``l head front or head top``: codes as people read them."""
    return code.replace("|", " or ").replace("-", " ").replace("_", " ")


def check_name(code: str) -> str:
    """Name of a check of a certificate."""
    name = words(code).replace("com ", "CoM ")
    for ending, said in ((" max", ", largest"), (" min", ", smallest")):
        if name.endswith(ending):
            name = name.removesuffix(ending) + said
    return name[:1].upper() + name[1:]


def kind(code: str) -> str:
    """Name of a kind of job."""
    return KINDS.get(code, words(code).capitalize())


def item(code: str) -> str:
    """Name of what can be reproduced: ``fig-2.6`` is figure 2.6; a table of our own has a name in words."""
    kind_of, _, number = code.partition("-")
    return f"{_ITEMS[kind_of]} {number}" if kind_of in _ITEMS else _TABLES.get(code, words(code).capitalize())


def verdict(code: str) -> str:
    """What a verdict on a claim of the thesis means."""
    return _VERDICTS.get(code, words(code))


def method(code: str) -> str:
    """Name of an estimator; ``-thesis`` says that it has the settings of the thesis."""
    name = code.removesuffix("-thesis")
    return _METHODS.get(name, words(name)) + (", thesis" if name != code else "")


def headline(job: Job) -> str:
    """What to say beside the state of a job; the same sentence as in static/js/shared/api.js.

    A verdict is shown apart from it, in its own colour.
    """
    if job.state == "queued":
        return "waiting" if job.queue_position is None else f"place {job.queue_position} in the queue"
    if job.error is not None:
        return job.error.detail
    return "" if job.state in FINAL_STATES else job.progress.message


_METHODS = {
    "smoother": "smoother",
    "complementary": "complementary filter",
    "rts": "RTS smoother",
    "kalman": "Kalman filter",
    "geometry": "markers only",
}
_ITEMS = {"fig": "Figure", "table": "Table", "numbers": "Numbers of chapter"}
_TABLES = {
    "errors": "Errors of all methods",
    "lag": "Lag of all methods",
    "coverage": "Coverage of the band",
    "partial-force": "One second of force in two",
    "flight": "Free fall in running",
}
_VERDICTS = {
    "met": "as the thesis says",
    "beaten": "better, or our aim reached",
    "not_met": "not reached here",
    "thesis_in_error": "cannot hold as printed",
}
KINDS = {
    "estimate-com": "Centre of mass",
    "compare-estimators": "Comparison of methods",
    "reproduce": "Reproduction",
    "simulate-recording": "Simulated recording",
    "plan-contacts": "Contact plan",
    "plan-motion": "Motion plan",
    "plan-receding": "Receding horizon",
    "sweep": "Sweep",
    "learn-reachability": "Reachability",
    "fit-cycloid": "Rolling wheel",
    "study-population": "Population",
    "read-batch": "Bulk upload",
}

_MARKS = {"failed": "✗ ", "doubtful": "! ", "passed": "✓ "}

_SOLVERS = {"native": "C++, exact cones", "ipopt": "CasADi with ipopt", "fatrop": "CasADi with fatrop"}


def tab_mark(job: Job) -> str:
    """How a finished job ended, as a mark before the title: what a tab in the background shows."""
    if job.state in ("failed", "timed_out"):
        return "✗ "
    if job.state != "succeeded":
        return ""
    return "✓ " if job.verdict is None else _MARKS[job.verdict.outcome]


def not_in_detail(problem: Problem) -> list[FaultItem]:
    """The places of a problem, without what its sentence says already."""
    left = []
    for item in problem.errors:
        message = "" if item.message in problem.detail else item.message
        if message or item.where not in problem.detail:
            left.append(FaultItem(where=item.where, message=message))
    return left


def solver(name: str) -> str:
    """A solver of the centroidal problem, for people."""
    return _SOLVERS.get(name, name)


def short_time(seconds: float) -> str:
    """Milliseconds below a tenth of a second."""
    return f"{1e3 * seconds:.1f} ms" if seconds < 0.1 else f"{seconds:.2f} s"


FILTERS = {
    f.__name__: f
    for f in (
        fixed,
        plain,
        measured,
        moment,
        when,
        counted,
        megabytes,
        total_s,
        words,
        check_name,
        kind,
        item,
        verdict,
        method,
        headline,
        tab_mark,
        not_in_detail,
        solver,
        short_time,
    )
}
"""Filters of the templates."""
