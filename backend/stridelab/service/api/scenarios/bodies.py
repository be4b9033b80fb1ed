"""Adds the whole-body check of each stance, which runs in a resident child process, to a scenario validation."""

from collections.abc import Awaitable, Callable
from typing import Any, Final

from stridelab.schemas.base import FaultItem, Remark
from stridelab.schemas.scenarios import PhaseBody, Scenario, ScenarioCheck
from stridelab.service.api.problems import MAX_FAULTS

Json = dict[str, Any]

UNFINISHED: Final = "body-unfinished"
STRAINED: Final = "body-strained"


async def add_body_checks(
    scenario: Scenario,
    validation: ScenarioCheck,
    ask_body: Callable[[str, Json], Awaitable[Json]],
    posture_of: int | None,
    within_s: float | None = None,
) -> ScenarioCheck:
    """Add the whole-body answers to ``validation.phases``; unreachable stances and shoes without room to its errors.

    Phases that are not reached ``within_s`` are not checked; ``posture_of`` is the first, and null is the limit of the
    child. The check is skipped for an unknown robot. ``ask_body`` takes the robot and the request; its errors are
    raised.
    """
    if any(fault.where == "robot" for fault in validation.errors):
        return validation
    request = _stance_request(scenario, validation, posture_of) | {"within_s": within_s}
    answer = await ask_body(scenario.robot, request)
    phases = [_phase_body(k, result) for k, result in enumerate(answer["phases"])]
    faults = [
        FaultItem(where=_contact_place(k, result["contact"]), message=result["reason"])
        for k, result in enumerate(answer["phases"])
        if result is not None and result["body"] == "unreachable"
    ]
    faults += [FaultItem(where=fault["where"], message=fault["message"]) for fault in answer["shoes"]]
    return validation.model_copy(
        update={
            "valid": validation.valid and not faults,
            "errors": [*validation.errors, *faults][:MAX_FAULTS],
            "warnings": [*validation.warnings, *_body_remarks(scenario, answer)],
            "phases": phases,
        }
    )


def _stance_request(scenario: Scenario, validation: ScenarioCheck, posture_of: int | None) -> Json:
    """Request for the stance and shoe checks; a phase has a support region only if the CoM can be at rest above it."""
    phases = []
    for phase, region_m, rest in zip(scenario.phases, validation.support_region_m, validation.support, strict=True):
        rests = rest.margin_m is not None and rest.margin_m >= 0.0
        contacts = [contact.model_dump(mode="json") for contact in phase.contacts]
        phases.append({"contacts": contacts, "region_m": region_m if rests else [], "com_m": rest.com_m})
    whole = scenario.model_dump(mode="json") if validation.valid else None
    request = {"ask": "stances", "robot": scenario.robot, "posture_of": posture_of, "phases": phases}
    return request | {"scenario": whole}


def _body_remarks(scenario: Scenario, answer: Json) -> list[Remark]:
    remarks, answers = [], answer["phases"]
    strained = [k for k, result in enumerate(answers) if result is not None and result["strained"]]
    if strained:
        named = f"phase {strained[0]}" if len(strained) == 1 else f"phases {', '.join(map(str, strained))}"
        message = f"the body reaches the stance of {named} only with stretched limbs; the plan may fail there"
        remarks.append(Remark(code=STRAINED, message=message))
    left = sum(result is None and bool(phase.contacts) for phase, result in zip(scenario.phases, answers, strict=True))
    if left:
        message = f"the body was not checked in {left} of {len(answers)} phases; repeat the check for more of them"
        remarks.append(Remark(code=UNFINISHED, message=message))
    elif answer["motion"] == "unfinished":
        message = "the motion between the stances was not checked completely; repeat the check for the rest"
        remarks.append(Remark(code=UNFINISHED, message=message))
    return remarks


def _phase_body(k: int, result: Json | None) -> PhaseBody:
    if result is None:
        return PhaseBody(phase=k, body="not-asked")
    return PhaseBody(phase=k, **{name: result[name] for name in ("body", "reason", "limits", "link_poses")})


def _contact_place(k: int, contact: str | None) -> str:
    return f"phases[{k}]" if contact is None else f"phases[{k}].contacts[{contact}]"
