"""The answer of a plan in one sentence, and the check that is nearest to its limit."""

from dataclasses import dataclass

from stridelab.schemas.plans import CertificateCheck, PlanMotionSummary
from stridelab_web.formatting import check_name, count_text, with_unit


@dataclass(frozen=True)
class PlanAnswer:
    """``nearest`` describes the passed check that is nearest to its limit, empty without one, at ``nearest_s``."""

    sentence: str
    passed: bool
    nearest: str = ""
    nearest_s: float | None = None


def plan_answer(summary: PlanMotionSummary) -> PlanAnswer:
    """The answer of a plan."""
    if summary.stopped is not None:
        until, whole = summary.stopped.time_s, summary.duration_s
        return PlanAnswer(f"The body follows the plan for {until:.2f} s of {whole:.2f} s.", passed=False)
    if summary.certificate is None:
        text = f"The centre of mass has a motion of {summary.duration_s:.1f} s; the body was not planned."
        return PlanAnswer(text, passed=summary.converged)
    failed = [check_name(check.name) for check in summary.certificate.checks if not check.passed]
    number = len(summary.certificate.checks)
    text = f"Not certified: {', '.join(failed)}" if failed else f"Certified: {count_text(number, 'check')} passed"
    passed = not failed
    if (replay := summary.replay) is not None:
        passed = passed and replay.completed
        error_mm = 1000 * replay.com_error_max_m
        if replay.fall_time_s is not None:
            text += f"; in physics the robot falls at {replay.fall_time_s:.2f} s"
        elif replay.completed:
            text += f"; completed in physics, the centre of mass at most {error_mm:.1f} mm from the plan"
        else:
            text += f"; in physics the robot departs from the plan, by up to {error_mm:.0f} mm"
    shares = [(share, check) for check in summary.certificate.checks if (share := limit_share(check)) is not None]
    if not shares:
        return PlanAnswer(f"{text}.", passed)
    share, check = max(shares, key=lambda pair: pair[0])
    bound = "at least" if check.at_least else "at most"
    values = f"{with_unit(check.value, check.unit)}, {bound} {with_unit(check.limit, check.unit)}"
    return PlanAnswer(f"{text}.", passed, f"{check_name(check.name)}: {values} ({100 * share:.0f} %)", check.time_s)


def limit_share(check: CertificateCheck) -> float | None:
    """Share of its limit that a passed check uses; None where there is none (failed, or a limit of zero or less)."""
    if not check.passed or check.limit <= 0.0 or check.value <= 0.0:
        return None
    return check.limit / check.value if check.at_least else check.value / check.limit
