"""How numbers read on the pages."""

from datetime import datetime, timedelta, timezone

import pytest

from stridelab.robots.card import robot_card
from stridelab.schemas.base import FaultItem, Problem
from stridelab.schemas.methods import METHODS
from stridelab.schemas.robots import Capability
from stridelab.service.kinds.registry import KINDS
from stridelab_web import formatting
from stridelab_web.formatting import (
    capability_limit,
    capability_title,
    capability_value,
    count_text,
    faults_not_in_detail,
    fixed_decimals,
    job_kind_name,
    landmark_words,
    part_words,
    time_element,
    trial_reason,
    utc_text,
)
from stridelab_web.pages.results.comparison_plots import STYLES


@pytest.mark.parametrize(
    ("value", "text"), [(1.236, "1.24"), (-0.001, "0.00"), (-0.006, "-0.01"), (0.0, "0.00"), (None, "–")]
)
def test_fixed_digits_and_no_negative_zero(value: float | None, text: str) -> None:
    assert fixed_decimals(value) == text


@pytest.mark.parametrize(
    ("name", "value", "unit", "ended_by", "texts"),
    [
        ("turn", 0.349066, "rad", "fails", ("Turn per step, on the spot", "20°", "0.38 rad: shoes")),
        ("stair", 0.23, "m", "range", ("One stair, both feet", "at least 23 cm", "More was not tried.")),
        ("pace", 0.4, "m/s", "time", ("Level walk", "at least 0.4 m/s", "The time ended; more may be possible.")),
        ("push-left", 0.0, "N s", "fails", ("Push to the left", "none", "0.38 rad: shoes")),
        ("push-back", None, "N s", "not-tried", ("Push back", "–", "0.38 rad: shoes")),
    ],
)
def test_capabilities_read_as_on_a_card(
    name: str, value: float | None, unit: str, ended_by: str, texts: tuple[str, str, str]
) -> None:
    given = {"name": name, "value": value, "unit": unit, "resolution": 0.01, "ended_by": ended_by}
    capability = Capability.model_validate({**given, "reason": "0.38 rad: shoes"})
    assert (capability_title(name), capability_value(capability), capability_limit(capability)) == texts


def test_a_failed_value_says_why_in_the_words_of_a_plan_page() -> None:
    """Checks are named as in the table of a certificate, angles in degrees; the smallest value that fails decides."""
    reason = "certificate: com_error_max 0.0092 m; certificate: self_collisions 6; replay: The robot falls at 3.10 s."
    shown = "not certified (CoM error, largest: 9.2 mm, Self collisions: 6); in physics: The robot falls at 3.10 s."
    assert trial_reason(reason) == shown
    assert trial_reason("No path was found.") == "No path was found."
    assert trial_reason("certificate: torque_ratio_max 1.02; shoes") == (
        "not certified (Torque ratio, largest: 1.02); shoes"
    )
    attempts = [(0.6, reason), (0.384, "certificate: effort 2e-05 N s"), (0.349, "")]
    tried = [{"value": value, "passed": not why, "reason": why} for value, why in attempts]
    given = {"name": "turn", "value": 0.349, "unit": "rad", "resolution": 0.035, "ended_by": "fails"}
    capability = Capability.model_validate({**given, "reason": "0.384 rad: raw", "attempts": tried})
    assert capability_limit(capability) == "At 22°: not certified (Effort: 2e-05 N s)"


def test_every_estimator_has_a_name_and_a_line_of_its_own() -> None:
    assert set(METHODS) == set(formatting.METHODS)
    assert set(METHODS) <= set(STYLES)


@pytest.mark.parametrize("name", ["g1", "hrp2", "talos"])
def test_a_robot_has_the_title_of_its_card(name: str) -> None:
    assert formatting.robot_title(name) == robot_card(name).title


def test_a_robot_of_ones_own_has_the_name_that_it_was_given() -> None:
    assert formatting.robot_title("my-robot") == "my-robot"


def test_kinds_of_jobs_have_the_titles_of_the_service() -> None:
    assert {name: KINDS[name].title for name in formatting.KINDS} == formatting.KINDS


def test_a_new_kind_of_job_is_named_by_its_code() -> None:
    assert job_kind_name("weigh-recording") == "Weigh recording"


@pytest.mark.parametrize(
    ("number", "words_of", "text"),
    [
        (0, ("frame",), "0 frames"),
        (1, ("frame",), "1 frame"),
        (2, ("frame",), "2 frames"),
        (1, ("touch", "touches"), "1 touch"),
        (31, ("touch", "touches"), "31 touches"),
    ],
)
def test_one_is_counted_in_the_singular(number: int, words_of: tuple[str, ...], text: str) -> None:
    assert count_text(number, *words_of) == text


def test_a_failure_is_shown_once() -> None:
    progress = "last progress message: replay: 92 %"
    faults = [FaultItem(where="stage: replay", message=progress), FaultItem(where="plate 2", message="never loaded")]
    detail = "It took longer than 600 s. Last progress message: replay: 92 %."
    problem = Problem(title="Timeout", status=504, code="computation-timed-out", detail=detail, errors=faults)
    assert [item.where for item in faults_not_in_detail(problem)] == ["plate 2"]


def test_landmarks_are_in_words() -> None:
    assert landmark_words("l_head_front|r_knee|head_top") == "left head front or right knee or head top"


def test_an_element_for_a_time_holds_the_instant_and_the_utc_text() -> None:
    there = timezone(timedelta(hours=-5))
    assert time_element(datetime(2026, 11, 22, 23, 30, tzinfo=there)) == (
        '<time datetime="2026-11-23T04:30:00+00:00" title="2026-11-23 04:30 UTC">2026-11-23 04:30 UTC</time>'
    )


def test_a_time_says_that_it_is_utc_whatever_its_own_zone() -> None:
    there = timezone(timedelta(hours=-5))
    assert utc_text(datetime(2026, 11, 22, 23, 30, tzinfo=there)) == "2026-11-23 04:30 UTC"


@pytest.mark.parametrize(
    ("code", "words"),
    [("leg_left_4_link", "left leg 4"), ("left_foot", "left foot"), ("waist_yaw_joint", "waist yaw"), ("LLEG", "LLEG")],
)
def test_parts_of_a_robot_are_in_words(code: str, words: str) -> None:
    assert part_words(code) == words
