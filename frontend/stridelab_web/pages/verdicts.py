"""The verdict on a result as the viewer shows it beside the time."""

from dataclasses import dataclass

from stridelab.schemas.jobs import Job
from stridelab.translations.catalogue import gettext


@dataclass(frozen=True)
class ShownVerdict:
    """``outcome`` is "passed", "doubtful" or "failed"; ``href`` is the page with the reasons."""

    outcome: str
    message: str
    href: str


def shown_verdict(job: Job, href: str, until_s: float | None = None) -> ShownVerdict | None:
    """The verdict on the result of ``job``; ``until_s`` is the end of an incomplete motion of a failed job."""
    if job.verdict is not None:
        return ShownVerdict(job.verdict.outcome, job.verdict.message, href)
    if job.state == "succeeded":
        return None
    if until_s is None:
        return ShownVerdict("failed", gettext("Failed"), href)
    return ShownVerdict("failed", f"Failed: the body cannot follow the plan beyond {until_s:.2f} s", href)
