"""The judge's answer with that of the whole body: asked of a resident child, one stance per phase."""

from typing import Any, Final

from stridelab.schemas.base import FaultItem, Remark
from stridelab.schemas.scenarios import PhaseBody, Scenario, ScenarioCheck
from stridelab.service.api.problems import SHOWN_FAULTS
from stridelab.service.processes.resident import Resident

Json = dict[str, Any]

UNFINISHED: Final = "body-unfinished"
STRAINED: Final = "body-strained"


async def with_bodies(
    scenario: Scenario, found: ScenarioCheck, bodies: Resident, posture_of: int | None
) -> ScenarioCheck:
    """``found`` with the body's answer in ``phases``; what it cannot do is among the errors.

    A robot that is not known is not asked. Raises as ``Resident.ask``.
    """
    if any(fault.where == "robot" for fault in found.errors):
        return found
    answer = await bodies.ask(_question(scenario, found, posture_of))
    phases = [_phase(k, said) for k, said in enumerate(answer["phases"])]
    faults = [
        FaultItem(where=_where(k, said["contact"]), message=said["reason"])
        for k, said in enumerate(answer["phases"])
        if said is not None and said["body"] == "unreachable"
    ]
    return found.model_copy(
        update={
            "valid": found.valid and not faults,
            "errors": [*found.errors, *faults][:SHOWN_FAULTS],
            "warnings": [*found.warnings, *_remarks(scenario, answer["phases"])],
            "phases": phases,
        }
    )


def _question(scenario: Scenario, found: ScenarioCheck, posture_of: int | None) -> Json:
    """The CoM is held above the support region only where the judge says that it can rest there."""
    phases = []
    for phase, region_m, rest in zip(scenario.phases, found.support_region_m, found.support, strict=True):
        rests = rest.margin_m is not None and rest.margin_m >= 0.0
        contacts = [contact.model_dump(mode="json") for contact in phase.contacts]
        phases.append({"contacts": contacts, "region_m": region_m if rests else [], "com_m": rest.com_m})
    return {"ask": "stances", "robot": scenario.robot, "posture_of": posture_of, "phases": phases}


def _remarks(scenario: Scenario, answers: list[Json | None]) -> list[Remark]:
    remarks = []
    strained = [k for k, said in enumerate(answers) if said is not None and said["strained"]]
    if strained:
        named = f"phase {strained[0]}" if len(strained) == 1 else f"phases {', '.join(map(str, strained))}"
        message = f"the body takes the stance of {named} only with its limbs pushed apart; the plan may fail there"
        remarks.append(Remark(code=STRAINED, message=message))
    left = sum(said is None and bool(phase.contacts) for phase, said in zip(scenario.phases, answers, strict=True))
    if left:
        message = f"the body was not asked in {left} of {len(answers)} phases; ask again for more of them"
        remarks.append(Remark(code=UNFINISHED, message=message))
    return remarks


def _phase(k: int, said: Json | None) -> PhaseBody:
    if said is None:
        return PhaseBody(phase=k, body="not-asked")
    return PhaseBody(phase=k, **{name: said[name] for name in ("body", "reason", "limits", "link_poses")})


def _where(k: int, contact: str | None) -> str:
    return f"phases[{k}]" if contact is None else f"phases[{k}].contacts[{contact}]"
