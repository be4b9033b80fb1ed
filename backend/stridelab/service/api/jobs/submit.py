"""``POST /jobs/{kind}``: one operation per job kind, each with its own schema and examples.

Inputs are validated beyond their schema before a job is accepted.
"""

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NoReturn

import anyio
import structlog
from fastapi import APIRouter, Body, Header, Query, Response
from sqlalchemy import select

from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.pipelines.replays.options import require_pushes
from stridelab.robots.card import robot_card, robot_names
from stridelab.schemas.base import Contract
from stridelab.schemas.comparison import ComBenchInput
from stridelab.schemas.jobs import Job, SimulateRecordingInput
from stridelab.schemas.measures import GaitMeasuresInput, GaitReportInput
from stridelab.schemas.plans import PlanContactsInput, PlanMotionInput, ReplayOptions
from stridelab.schemas.population import MAX_RECORDINGS, StudyPopulationInput
from stridelab.schemas.receding import PlanRecedingInput, PushBasinInput
from stridelab.schemas.robots import CommissionRobotInput, LearnReachabilityInput
from stridelab.schemas.scenarios import Scenario, ScenarioSource
from stridelab.schemas.sweeps import SweepInput
from stridelab.service.api.dependencies import AppParts, CallerOf, Parts, require_id_form
from stridelab.service.api.jobs.presentation import job_of
from stridelab.service.api.openapi import failure_responses
from stridelab.service.api.quotas import refuse_full
from stridelab.service.api.robots.own import required_robot
from stridelab.service.api.scenarios.validation import refuse_invalid
from stridelab.service.auth.callers import Caller, require_owner
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.registry import KINDS
from stridelab.service.kinds.staging import require_recordings
from stridelab.service.storage.tables import recording, scenario
from stridelab.service.stored_robots import find_robot


@dataclass(frozen=True)
class JobSubject:
    """Ids of the stored objects that a job works on; the job store checks whether they exist."""

    recording_id: str | None = None
    scenario_id: str | None = None


async def validate_request(parts: Parts, request: Contract, caller: Caller) -> JobSubject:
    """Validate ``request`` and return the objects that it refers to.

    Raises ``NotFound`` (``recording-not-found``, ``scenario-not-found``) for a malformed id, and ``InvalidInput``:
    ``scenario-invalid`` for a scenario that the robot cannot perform, ``stance-invalid`` for a start or goal where it
    cannot stand, ``replay-invalid`` for a push outside of the motion or on an unknown link, ``invalid-request`` for an
    unknown robot or effector, ``recording-twice`` in a population. For a robot to be commissioned ``NotFound``
    (``robot-not-found``), ``Conflict`` (``bundled-read-only``) and ``Forbidden`` (``not-owner``).
    """
    if isinstance(request, PlanMotionInput | PlanRecedingInput | SweepInput) and request.scenario is not None:
        await refuse_invalid(request.scenario, parts.validation_limiter, parts.robots)
    if isinstance(request, PushBasinInput):
        await _refuse_basin(parts, request)
    if isinstance(request, PlanMotionInput):
        await _refuse_pushes(parts, request)
    if isinstance(request, PlanContactsInput):
        own = (await _effectors_of(parts, request.robot)).own_shapes
        await anyio.to_thread.run_sync(_refuse_invalid_ends, request, own, limiter=parts.validation_limiter)
    if isinstance(request, CommissionRobotInput):
        async with parts.engine.connect() as connection:
            require_owner(caller, (await required_robot(connection, request.robot))["owner"], "robot")
    if isinstance(request, SimulateRecordingInput) and request.robot != "human":
        await _effectors_of(parts, request.robot)
    if isinstance(request, LearnReachabilityInput):
        _refuse_unknown_effectors(request, (await _effectors_of(parts, request.robot)).names)
    if isinstance(request, StudyPopulationInput | GaitMeasuresInput | GaitReportInput | ComBenchInput):
        async with parts.engine.connect() as connection:
            for name in ("recording_ids", "reference_recording_ids", "before_recording_ids"):
                ids = getattr(request, name, None) or []
                for recording_id in ids:
                    require_id_form(recording_id, "recording")
                await require_recordings(connection, ids, name)
    return JobSubject(_referenced_id(request, "recording"), _referenced_id(request, "scenario"))


async def _refuse_basin(parts: Parts, request: PushBasinInput) -> None:
    """Raise ``InvalidInput``: ``invalid-request`` for an unknown robot, ``scenario-invalid`` if it cannot walk."""
    if request.robot is not None:
        await _effectors_of(parts, request.robot)
    body = await _scenario_of(parts, request)
    if body is not None and (request.scenario is not None or request.robot is not None):
        one = body if request.robot is None else body.model_copy(update={"robot": request.robot})
        await refuse_invalid(one, parts.validation_limiter, parts.robots)


async def _refuse_pushes(parts: Parts, request: PlanMotionInput) -> None:
    """Raise as ``require_pushes`` does."""
    if isinstance(request.replay, ReplayOptions) and request.replay.pushes:
        body = await _scenario_of(parts, request)
        if body is not None:
            duration_s = math.fsum(phase.duration_s for phase in body.phases)
            require_pushes(request.replay, body.robot, duration_s, await _own_links(parts, body.robot))


async def _scenario_of(parts: Parts, request: ScenarioSource) -> Scenario | None:
    """The scenario of a request; None for a stored one that does not exist, which the job store refuses."""
    if request.scenario is not None:
        return request.scenario
    identifier = require_id_form(request.scenario_id or "", "scenario")
    async with parts.engine.connect() as connection:
        row = await connection.execute(select(scenario.c.body).where(scenario.c.id == identifier))
    stored = row.scalar_one_or_none()
    return None if stored is None else Scenario.model_validate(stored)


async def _with_recordings(parts: Parts, request: GaitReportInput, owner: str | None) -> GaitReportInput:
    """The request with the recordings of its session instead: those of ``owner``, except static trials.

    Raises ``NotFound`` (``session-not-found``), ``InvalidInput`` (``recording-twice``) if one of them is also in the
    reference group or among the earlier recordings.
    """
    if request.session_id is None:
        return request
    query = select(recording.c.id, recording.c.facts).order_by(recording.c.filename, recording.c.id)
    query = query.where(recording.c.session_id == request.session_id, recording.c.owner.is_not_distinct_from(owner))
    async with parts.engine.connect() as connection:
        rows = (await connection.execute(query.limit(MAX_RECORDINGS))).all()
    walks = [row.id for row in rows if not row.facts.get("still")]
    if not walks:
        message = f"None of your recordings of walks belongs to the session {request.session_id}."
        raise NotFound("session-not-found", message, [Fault("session_id", "unknown")])
    for name in ("reference_recording_ids", "before_recording_ids"):
        twice = [index for index, one in enumerate(getattr(request, name)) if one in walks]
        if twice:
            message = f"A recording of {name} is also one of the session."
            raise InvalidInput("recording-twice", message, [Fault(f"{name}.{k}", "in the session") for k in twice])
    given = request.model_dump(exclude_unset=True, exclude={"session_id"})
    return GaitReportInput(**given | {"recording_ids": walks})


def _referenced_id(request: Contract, what: str) -> str | None:
    identifier: str | None = getattr(request, f"{what}_id", None)
    return None if identifier is None else require_id_form(identifier, what)


@dataclass(frozen=True)
class _Effectors:
    """Names of the effectors of a robot, and the stored shapes of a user's robot."""

    names: tuple[str, ...]
    own_shapes: Mapping[str, Any] | None


async def _effectors_of(parts: Parts, robot: str) -> _Effectors:
    """Effectors of a bundled robot or of a user's. Raises ``InvalidInput`` (``invalid-request``) for another name."""
    own = await parts.robots.own_shapes(robot)
    if own is not None:
        return _Effectors(tuple(own), own)
    try:
        return _Effectors(tuple(robot_card(robot).effectors), None)
    except NotFound as error:
        raise InvalidInput("invalid-request", error.message, [Fault("robot", "unknown")]) from error


async def _own_links(parts: Parts, robot: str) -> tuple[str, ...] | None:
    """Moving links of a user's robot; None for a bundled one, whose description is installed."""
    if robot in robot_names():
        return None
    async with parts.engine.connect() as connection:
        row = await find_robot(connection, robot)
    return None if row is None else tuple(row["facts"]["links"])


def _refuse_invalid_ends(request: PlanContactsInput, own_shapes: Mapping[str, Any] | None) -> None:
    # imported on first use, as in scenarios.validation: the service starts without numpy
    from stridelab.contacts.effector_geometry import effector_shapes, stored_shapes
    from stridelab.contacts.planner.start_goal import task_ends

    shapes = effector_shapes(request.robot) if own_shapes is None else stored_shapes(own_shapes)
    task_ends(request.model_dump(mode="json"), shapes)


def _refuse_unknown_effectors(request: LearnReachabilityInput, known: Sequence[str]) -> None:
    unknown = [index for index, name in enumerate(request.effectors or ()) if name not in known]
    if unknown:
        sentence = f"The effectors of {request.robot} are {', '.join(known)}."
        raise InvalidInput("invalid-request", sentence, [Fault(f"effectors.{index}", "unknown") for index in unknown])


Priority = Annotated[
    int, Query(ge=-100, le=100, description="among the jobs of one owner, a higher priority runs earlier")
]
Key = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=200,
        pattern=r"^[\x21-\x7e]+$",
        description="the same key and body again return the same job instead of a second one",
    ),
]


def add_kinds(router: APIRouter) -> None:
    """Add a route for every registered kind to ``router``, and one that rejects all other names."""
    offered = [kind for kind in KINDS.values() if kind.offered]
    for kind in offered:
        _add_kind(router, kind)

    async def unknown_kind(kind: str) -> NoReturn:
        names = ", ".join(each.name for each in offered)
        raise NotFound("unknown-job-kind", f"There is no job kind of that name; there are {names}.")

    router.add_api_route("/{kind}", unknown_kind, methods=["POST"], include_in_schema=False, response_model=None)


def _add_kind(router: APIRouter, kind: JobKind) -> None:
    async def submit(
        parts: AppParts, caller: CallerOf, response: Response, body: Contract, priority: Priority = 0, key: Key = None
    ) -> Job:
        if isinstance(body, GaitReportInput):
            body = await _with_recordings(parts, body, caller.name)
        subject = await validate_request(parts, body, caller)
        await refuse_full(parts, caller.name)
        request = body.model_dump(mode="json", exclude_unset=True)
        submitted = await parts.store.submit(
            kind.name,
            request,
            owner=caller.name,
            priority=priority,
            idempotency_key=key,
            recording_id=subject.recording_id,
            scenario_id=subject.scenario_id,
        )
        structlog.contextvars.bind_contextvars(job_id=submitted.job_id)
        response.headers["Location"] = f"/api/v1/jobs/{submitted.job_id}"
        return job_of(await parts.store.get(submitted.job_id))

    body: Any = Annotated[kind.input_model, Body(openapi_examples=dict(kind.examples))]
    signature = inspect.signature(submit)
    parameters = [p.replace(annotation=body) if p.name == "body" else p for p in signature.parameters.values()]
    submit.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]  # read by FastAPI
    router.add_api_route(
        f"/{kind.name}",
        submit,
        methods=["POST"],
        status_code=202,
        response_model=Job,
        operation_id=f"submit_{kind.name.replace('-', '_')}",
        summary=f"Submit {kind.name}",
        description=f"{kind.title}. {kind.description} The job runs in a worker; the header "
        "`Location` of the response is its address.",
        responses=failure_responses(
            s404="The input names an unknown recording, scenario or robot (`recording-not-found`, "
            "`scenario-not-found`, `robot-not-found`).",
            s409="The idempotency key was used with another body before (`idempotency-key-reused`), or the robot is "
            "bundled (`bundled-read-only`).",
            s413="Your uploads and results exceed your storage limit (`storage-limit`).",
            s429="Too many jobs are queued (`queue-full`), or too many of yours (`user-queue-full`); `Retry-After` "
            "gives the time to wait.",
        ),
    )
