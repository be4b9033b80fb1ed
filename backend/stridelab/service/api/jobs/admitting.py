"""What a job's input must hold before the job is accepted, beyond its schema; and what the job will work on."""

from collections.abc import Mapping
from dataclasses import dataclass

import anyio

from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.robots.card import EffectorCard, robot_card
from stridelab.schemas.base import Contract
from stridelab.schemas.plans import LearnReachabilityInput, PlanContactsInput, PlanMotionInput
from stridelab.schemas.population import StudyPopulationInput
from stridelab.schemas.receding import PlanRecedingInput
from stridelab.schemas.sweeps import SweepInput
from stridelab.service.api.parts import Parts, known_form
from stridelab.service.api.scenarios.judging import refuse_invalid
from stridelab.service.jobs.kinds.population_stage import require_recordings


@dataclass(frozen=True)
class Subject:
    """The stored things that a job works on; whether they exist is found out when the job is stored."""

    recording_id: str | None = None
    scenario_id: str | None = None


async def admit(parts: Parts, request: Contract) -> Subject:
    """What ``request`` refers to.

    Raises ``NotFound`` (``recording-not-found``, ``scenario-not-found``) for what cannot be an id, and
    ``InvalidInput``: ``scenario-invalid`` for a scenario that the robot cannot do, ``stance-invalid`` for a start or a
    goal where it cannot stand, ``invalid-request`` for a robot or an effector that there is not, ``recording-twice`` in
    a population.
    """
    if isinstance(request, PlanMotionInput | PlanRecedingInput | SweepInput) and request.scenario is not None:
        await refuse_invalid(request.scenario, parts.judges, parts.robots)
    if isinstance(request, PlanContactsInput):
        _effectors(request.robot)
        await anyio.to_thread.run_sync(_refuse_invalid_ends, request, limiter=parts.judges)
    if isinstance(request, LearnReachabilityInput):
        _refuse_unknown_effectors(request)
    if isinstance(request, StudyPopulationInput):
        for recording_id in request.recording_ids:
            known_form(recording_id, "recording")
        async with parts.engine.connect() as connection:
            await require_recordings(connection, request)
    return Subject(_identifier(request, "recording"), _identifier(request, "scenario"))


def _identifier(request: Contract, what: str) -> str | None:
    identifier: str | None = getattr(request, f"{what}_id", None)
    return None if identifier is None else known_form(identifier, what)


def _effectors(robot: str) -> Mapping[str, EffectorCard]:
    try:
        return robot_card(robot).effectors
    except NotFound as error:
        raise InvalidInput("invalid-request", error.message, [Fault("robot", "unknown")]) from error


def _refuse_invalid_ends(request: PlanContactsInput) -> None:
    # Imported with the first question, as in scenarios.judging: the service starts without numpy.
    from stridelab.contacts.shapes import effector_shapes
    from stridelab.contacts.task_ends import task_ends

    task_ends(request.model_dump(mode="json"), effector_shapes(request.robot))


def _refuse_unknown_effectors(request: LearnReachabilityInput) -> None:
    known = _effectors(request.robot)
    unknown = [index for index, name in enumerate(request.effectors or ()) if name not in known]
    if unknown:
        sentence = f"The effectors of {request.robot} are {', '.join(known)}."
        raise InvalidInput("invalid-request", sentence, [Fault(f"effectors.{index}", "unknown") for index in unknown])
