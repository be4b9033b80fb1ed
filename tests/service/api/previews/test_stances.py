"""The parts into which the whole-body check of a drag is divided, so that its first answer comes soon."""

from typing import Any

import pytest

from stridelab.pipelines.motion_check import MotionCheck
from stridelab.schemas.scenarios import Scenario
from stridelab.service.api.previews import stances
from stridelab.service.api.scenarios.bodies import _stance_request
from stridelab.service.api.scenarios.validation import validate_sync
from support.robots.scenario_bodies import one_step

MOVED_M = 0.0147
"""A place of the feet that no other test has checked."""


def moved_step() -> dict[str, Any]:
    """The request for the body of a step whose stances are not known yet."""
    body = one_step()
    for phase in body["phases"]:
        for contact in phase["contacts"]:
            contact["position_m"][0] += MOVED_M
    scenario = Scenario.model_validate(body)
    return _stance_request(scenario, validate_sync(scenario), 0)


def test_the_motion_is_left_to_the_next_request_where_stances_took_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    checked: list[Any] = []
    genuine = MotionCheck.continue_check

    def count_answers(self: MotionCheck, *args: Any) -> Any:
        checked.append(args)
        return genuine(self, *args)

    monkeypatch.setattr(MotionCheck, "continue_check", count_answers)
    question = moved_step() | {"within_s": 0.03}
    answers = [stances.answer_request(question)]
    while not all(answers[-1]["phases"]):
        assert len(answers) < 20
        answers.append(stances.answer_request(question))
    assert (answers[-1]["motion"], checked) == ("unfinished", []), "the stances have used up this request"
    stances.answer_request(question)
    assert len(checked) == 1, "nothing else was done in the second one"


def test_a_request_without_a_limit_of_its_own_is_answered_completely() -> None:
    stances._check_of.cache_clear()
    answer = stances.answer_request(moved_step() | {"within_s": None})
    assert ([one["body"] for one in answer["phases"]], answer["motion"]) == (["reachable"] * 3, "checked")
