"""The answer of a plan: certified or not, what happens in physics, and the check that is nearest to its limit."""

from typing import Any

import pytest

from stridelab.schemas.plans import (
    CertificateCheck,
    CertificateSummary,
    PlanMotionSummary,
    ReplaySummary,
    StoppedMotion,
)
from stridelab_web.pages.plans.answer import limit_share, plan_answer


def check(name: str, value: float, limit: float, **more: Any) -> CertificateCheck:
    given = {"unit": "m", "at_least": False, "passed": True, "time_s": 2.5, **more}
    return CertificateCheck(name=name, value=value, limit=limit, **given)


def summary(*checks: CertificateCheck, **more: Any) -> PlanMotionSummary:
    certificate = CertificateSummary(passed=all(one.passed for one in checks), checks=list(checks)) if checks else None
    return PlanMotionSummary.model_construct(
        certificate=certificate, duration_s=24.0, converged=True, **{"replay": None, "stopped": None, **more}
    )


def replay(*, completed: bool, fall_time_s: float | None = None) -> ReplaySummary:
    measured = dict.fromkeys(
        ("com_error_rms_m", "foot_slip_max_m", "landing_error_max_m", "torque_ratio_max", "real_time_factor"), 0.001
    )
    return ReplaySummary(completed=completed, fall_time_s=fall_time_s, com_error_max_m=0.0042, **measured)


CHECKS = (
    check("torque_ratio_max_arms", 0.76, 0.95, unit="1"),
    check("terrain_distance_min", 0.02, 0.01, at_least=True),
)


def test_the_passed_check_that_uses_most_of_its_limit_is_named() -> None:
    answer = plan_answer(summary(*CHECKS))
    assert answer.sentence == "Certified: 2 checks passed."
    assert answer.nearest == "Torque ratio max arms: 0.76, at most 0.95 (80 %)"
    assert answer.nearest_s == 2.5


@pytest.mark.parametrize(
    ("physics", "text", "passed"),
    [
        (replay(completed=True), "completed in physics, the centre of mass at most 4.2 mm from the plan", True),
        (replay(completed=False), "in physics the robot departs from the plan, by up to 4 mm", False),
        (replay(completed=False, fall_time_s=7.9), "in physics the robot falls at 7.90 s", False),
    ],
)
def test_a_certified_plan_that_falls_has_not_passed(physics: ReplaySummary, text: str, passed: bool) -> None:
    answer = plan_answer(summary(*CHECKS, replay=physics))
    assert answer.sentence == f"Certified: 2 checks passed; {text}."
    assert answer.passed is passed


def test_failed_checks_are_named() -> None:
    answer = plan_answer(summary(*CHECKS, check("self_collision_pairs", 6.0, 0.0, passed=False)))
    assert answer.sentence == "Not certified: Self collision pairs."
    assert not answer.passed


def test_a_plan_without_a_body_is_no_certified_motion() -> None:
    assert plan_answer(summary()).sentence == "The centre of mass has a motion of 24.0 s; the body was not planned."
    stopped = StoppedMotion(time_s=7.92, phase=5, level=2, level_name="centre of mass", names=[])
    assert plan_answer(summary(stopped=stopped)).sentence == "The body follows the plan for 7.92 s of 24.00 s."


@pytest.mark.parametrize(
    ("one", "share"),
    [
        (check("a", 0.5, 1.0), 0.5),
        (check("b", 4.0, 1.0, at_least=True), 0.25),
        (check("c", 2.0, 1.0, passed=False), None),
        (check("d", 0.3, 0.0, at_least=True), None),
        (check("e", 2.9, -3.8, at_least=True), None),
    ],
)
def test_limits_of_zero_or_less_have_no_share(one: CertificateCheck, share: float | None) -> None:
    assert limit_share(one) == share
