"""The verdict on a result: what was certified, what fell, which sensors disagree; and old summaries are no error."""

from typing import Any

import pytest

from stridelab.schemas.jobs import JobVerdict
from stridelab.service.jobs.verdict import verdict_of


def certificate(*failed: str) -> dict[str, Any]:
    names = ("com_error_max", "leg_clearance_min", "self_collisions", "torque_ratio_max_arms", *failed)
    checks = [{"name": name, "passed": name not in failed} for name in dict.fromkeys(names)]
    return {"passed": not failed, "checks": checks}


def replay(completed: bool, fall_time_s: float | None = None, *codes: str) -> dict[str, Any]:
    remarks = [{"code": code, "message": "Why."} for code in codes]
    return {"completed": completed, "fall_time_s": fall_time_s, "remarks": remarks}


def quality(verdict: str, **values: float) -> dict[str, Any]:
    rows = [
        {"name": name, "value": value, "limit": 1.0, "contradicted_above": 5.0, "passed": value <= 1.0}
        for name, value in values.items()
    ]
    return {"verdict": verdict, "checks": rows, "not_checked": {}}


def verdict_parts(summary: dict[str, Any]) -> tuple[str, str, str, list[str]]:
    verdict = verdict_of(summary)
    assert isinstance(verdict, JobVerdict)
    return verdict.outcome, verdict.code, verdict.message, verdict.failed_checks


@pytest.mark.parametrize(
    ("summary", "expected"),
    [
        ({"certificate": certificate(), "replay": None}, ("passed", "certified", "Certified", [])),
        (
            {"certificate": certificate(), "replay": replay(True)},
            ("passed", "certified", "Certified; replay completed", []),
        ),
        (
            {"certificate": certificate("leg_clearance_min"), "replay": replay(True)},
            (
                "failed",
                "not-certified",
                "Not certified: leg clearance; replay completed",
                ["leg_clearance_min"],
            ),
        ),
        (
            {"certificate": certificate(), "replay": replay(False, 7.92, "replay-fell")},
            ("failed", "replay-fell", "Certified, but the robot falls at 7.9 s in the replay", []),
        ),
        (
            {"certificate": certificate(), "replay": replay(False, None, "replay-slipped", "replay-hand-off")},
            ("failed", "replay-not-completed", "Certified; replay not completed: slipped, hand off", []),
        ),
    ],
)
def test_a_motion_is_judged_by_its_certificate_and_its_replay(
    summary: dict[str, Any], expected: tuple[str, str, str, list[str]]
) -> None:
    assert verdict_parts(summary) == expected


def test_a_fall_outweighs_failed_checks_of_which_three_are_named() -> None:
    failed = ("leg_clearance_min", "self_collisions", "torque_ratio_max_arms", "com_error_max", "hand_load")
    _, code, message, names = verdict_parts(
        {"certificate": certificate(*failed), "replay": replay(False, 2.0, "replay-fell")}
    )
    assert code == "replay-fell"
    assert "CoM error, leg clearance, self collisions and 2 more; the robot falls at 2.0 s" in message
    assert set(names) == set(failed)


def test_a_replay_of_an_earlier_version_without_reasons_fell_where_it_was_not_completed() -> None:
    outcome, code, message, _ = verdict_parts({"certificate": certificate(), "replay": {"completed": False}})
    assert (outcome, code) == ("failed", "replay-fell")
    assert message == "Certified, but the robot falls in the replay"


@pytest.mark.parametrize(
    ("summary", "expected"),
    [
        (quality("good", vertical_bias=0.2), ("passed", "sensors-agree", "Sensors agree", [])),
        (
            quality("doubtful", vertical_bias=0.2, force_residual=2.0),
            ("doubtful", "sensors-doubtful", "Doubtful: force residual", ["force_residual"]),
        ),
        (
            quality("contradicted", force_residual=2.0, vertical_bias=9.0),
            (
                "failed",
                "sensors-contradict",
                "Sensors contradict each other: vertical bias",
                ["force_residual", "vertical_bias"],
            ),
        ),
    ],
)
def test_a_recording_is_judged_by_its_sensors(
    summary: dict[str, Any], expected: tuple[str, str, str, list[str]]
) -> None:
    assert verdict_parts({"quality": summary}) == expected


def test_a_walk_with_a_receding_horizon_is_doubtful_where_a_replan_failed() -> None:
    assert verdict_parts({"replans": 40, "carried_on": 0})[:2] == ("passed", "every-replan-solved")
    assert verdict_parts({"replans": 40, "carried_on": 3})[:3] == (
        "doubtful",
        "replan-failed",
        "No solution in 3 of 40 replans",
    )


@pytest.mark.parametrize(
    "summary",
    [
        {},
        {"certificate": None, "replay": None},
        {"certificate": {}},
        {"quality": None},
        {"quality": {"verdict": "unheard-of"}},
        {"quality": "good"},
        {"replans": 4},
        {"recording_id": "x"},
    ],
)
def test_a_result_without_checks_has_no_verdict(summary: dict[str, Any]) -> None:
    assert verdict_of(summary) is None


@pytest.mark.parametrize(
    "broken",
    [
        {"certificate": {"passed": False, "checks": [None, {"passed": False}, "x"]}},
        {"certificate": {"passed": False}},
        {"certificate": {"passed": True}, "replay": {"completed": False, "remarks": [{}], "fall_time_s": "soon"}},
        {"quality": {"verdict": "contradicted", "checks": [{"name": "a", "value": None, "contradicted_above": 1}]}},
        {"quality": {"verdict": "contradicted", "checks": "none"}},
    ],
)
def test_a_summary_of_another_form_still_has_its_verdict(broken: dict[str, Any]) -> None:
    outcome, _, message, names = verdict_parts(broken)
    assert outcome == "failed"
    assert message
    assert names == []
