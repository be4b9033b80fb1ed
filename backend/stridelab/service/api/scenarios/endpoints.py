"""Endpoints of scenarios: check, store, list, read, replace, delete."""

from typing import Annotated, Any, Final

from fastapi import APIRouter, Body, Header, Query, Response
from sqlalchemy import delete, func, insert, update
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.pipelines.scenarios.scaled_scenes import scene_for_robot
from stridelab.schemas.base import Page
from stridelab.schemas.plans import PlanContactsInput
from stridelab.schemas.scenarios import Course, ScaledScene, Scenario, ScenarioCheck, StoredScenario
from stridelab.service.api.dependencies import AppParts, CallerOf
from stridelab.service.api.openapi import failure_responses
from stridelab.service.api.pagination import Cursor, Limit, Search, Sort
from stridelab.service.api.scenarios.bodies import add_body_checks
from stridelab.service.api.scenarios.repository import (
    check_if_match,
    lock_changeable_row,
    scenario_of,
    scenario_row,
    scenarios_page,
)
from stridelab.service.api.scenarios.validation import compose_task, refuse_invalid, validate_scenario
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.auth import audit
from stridelab.service.auth.callers import Caller, require_owner
from stridelab.service.samples.scenario_bodies import IN_THE_AIR, ONE_STEP
from stridelab.service.samples.scenarios import new_id
from stridelab.service.storage.tables import scenario

router = APIRouter(prefix="/scenarios", tags=["scenarios"], route_class=StrictRoute)

_COURSE: Final[Any] = {
    "stairs": {
        "summary": "Four stairs with a handrail on the right",
        "value": {"robot": "talos", "handrails": ["right"], "elements": [{"kind": "stairs", "number": 4}]},
    }
}
_SCENE: Final[Any] = {
    "stairs": {"summary": "Six stairs for G1", "value": {"robot": "g1", "scene": "six-stairs"}},
}
_STEP: Final[Any] = {"step": {"summary": "One step on a flat floor", "value": ONE_STEP}}
_CHECKED: Final[Any] = {**_STEP, "air": {"summary": "A foot without a surface under it", "value": IN_THE_AIR}}
_UNKNOWN: Final = failure_responses(s404="No scenario with this id (`scenario-not-found`).")
_READ_ONLY: Final = failure_responses(s409="The scenario is bundled and read-only (`scenario-read-only`).")
_CHANGED: Final = failure_responses(s412="The `ETag` of the scenario differs from `If-Match` (`scenario-changed`).")
_INVALID: Final = failure_responses(
    s422="The scenario is malformed (`invalid-request`), or the robot cannot perform it (`scenario-invalid`); `errors` "
    "names phase, effector and field."
)


@router.get("", summary="List scenarios")
async def list_scenarios(
    parts: AppParts, search: Search = None, sort: Sort = "newest", limit: Limit = 50, cursor: Cursor = None
) -> Page[StoredScenario]:
    """List scenarios, including bundled ones. `search` looks in the name and the robot.

    A page of very long scenarios may contain fewer than `limit`; `next` is null on the last page.
    """
    async with parts.engine.connect() as connection:
        return await scenarios_page(connection, limit, cursor, search, sort)


@router.post("", status_code=201, summary="Add a scenario", responses=_INVALID)
async def add_scenario(
    parts: AppParts, caller: CallerOf, body: Annotated[Scenario, Body(openapi_examples=_STEP)], response: Response
) -> StoredScenario:
    """Validate and store a scenario. One that the robot cannot perform is refused, naming phase and effector.

    The whole body is checked afterwards, see `GET /scenarios/{scenario_id}/check`.
    """
    await refuse_invalid(body, parts.validation_limiter, parts.robots)
    async with parts.engine.begin() as connection:
        scenario_id = new_id()
        values = {"id": scenario_id, "owner": caller.name, "body": body.model_dump(mode="json")}
        await connection.execute(insert(scenario).values(values))
        stored = scenario_of(await scenario_row(connection, scenario_id))
    await parts.stored_checks.start(stored)
    response.headers["Location"] = f"/api/v1/scenarios/{stored.id}"
    return stored


@router.post(
    "/check",
    summary="Check a scenario",
    responses=failure_responses(
        s429="Too many whole-body checks are waiting (`preview-busy`); `Retry-After` gives the time to wait.",
        s503="The whole-body check failed and was restarted (`preview-failed`, `preview-stuck`).",
    ),
)
async def check_scenario(
    parts: AppParts,
    body: Annotated[Scenario, Body(openapi_examples=_CHECKED)],
    body_checked: Annotated[bool, Query(description="also check whether the whole body can reach each stance")] = False,
    posture_of: Annotated[
        int | None, Query(ge=0, le=1000, description="phase whose posture is returned, with `body_checked`")
    ] = None,
    within_s: Annotated[
        float | None,
        Query(
            gt=0.0,
            le=4.0,
            description="time for phases that are not cached; a search may take 40 ms more; 4 s if omitted",
        ),
    ] = None,
) -> ScenarioCheck:
    """Check, without storing anything, whether the robot can perform a scenario.

    `errors` lists the faults by place, `margins` the distance of each contact to its limits, and `support_region_m` the
    horizontal region in which the centre of mass can be at rest in each phase. The limits are learned per contact.

    With `body_checked`, the inverse kinematics of the whole body computes a posture for each phase: `phases[].body` is
    `reachable` or `unreachable` (with a `reason`, and `limits` that name the joint or the contact), and `valid` is
    false if a phase is unreachable. `errors` then also names shoes that overlap with each other or come nearer to a
    step than the certificate allows. Otherwise `phases[].body` is `not-asked`. If all stances are reachable, the body
    then follows the plan of the changed phases at a reduced rate: a phase that it cannot move through is `unreachable`,
    too. The full check of a motion is the certificate of a plan.
    """
    validation = await validate_scenario(body, parts.validation_limiter, parts.robots)
    if not body_checked:
        return validation

    async def ask_body(robot: str, request: dict[str, Any]) -> dict[str, Any]:
        return await parts.own_planners.ask(robot, request, parts.stance_checker)

    return await add_body_checks(body, validation, ask_body, posture_of, within_s)


@router.post(
    "/compose",
    summary="Compose a terrain",
    responses=failure_responses(
        s404="No robot with this name (`robot-not-found`).",
        s422="The course is malformed (`invalid-request`), longer than can be planned at once (`course-too-long`), or "
        "the robot lacks a sole or a hand for it (`course-without-feet`, `course-without-hand`).",
    ),
)
async def compose_scenario(
    parts: AppParts, body: Annotated[Course, Body(openapi_examples=_COURSE)]
) -> PlanContactsInput:
    """Compose stairs, ramps, stones and other obstacles in a row to a terrain. Nothing is stored.

    The response is the body of `POST /jobs/plan-contacts`, which places the feet, and the hands on the handrails, from
    the platform at the start to that at the end. Handrails are at the height of the robot's hands.
    """
    return await compose_task(body, parts.validation_limiter, parts.robots)


@router.post(
    "/scaled",
    summary="Scale a bundled scene to a robot",
    responses=failure_responses(
        s404="No robot with this name (`robot-not-found`).",
        s422="The request is malformed (`invalid-request`), or the robot has no two soles on legs "
        "(`robot-not-scalable`).",
    ),
)
async def scale_scene(parts: AppParts, body: Annotated[ScaledScene, Body(openapi_examples=_SCENE)]) -> Scenario:
    """Scale a bundled scene to any robot, one's own included. Nothing is stored.

    Lengths are scaled by the length of the legs, times by its square root; treads are deeper where the shoes need it,
    and a hand holds where the arm of the robot reaches.
    The response is the body of `POST /scenarios`, which checks it for the robot.
    """
    facts = await parts.robots.any_facts(body.robot)
    return scene_for_robot(body.scene, facts.name, facts.walker)


@router.get("/{scenario_id}", summary="One scenario", responses=_UNKNOWN)
async def get_scenario(parts: AppParts, scenario_id: str, response: Response) -> StoredScenario:
    """One scenario: robot, terrain and contact phases. `ETag` is its `updated_at` in quotes."""
    async with parts.engine.connect() as connection:
        stored = scenario_of(await scenario_row(connection, scenario_id))
    response.headers["ETag"] = stored.etag
    return stored


@router.get(
    "/{scenario_id}/check",
    summary="Check a stored scenario",
    responses={
        **_UNKNOWN,
        **failure_responses(s503="The whole-body check failed (`preview-failed`, `preview-stuck`)."),
    },
)
async def check_stored_scenario(parts: AppParts, scenario_id: str) -> ScenarioCheck:
    """The check of a stored scenario, as by `POST /scenarios/check` with `body_checked`.

    The whole body is checked in the background from the time when the scenario is stored, or from the first request
    for a bundled one. Until it is complete, `phases[].body` is `not-asked`, and a warning has the code
    `body-unfinished`.
    """
    async with parts.engine.connect() as connection:
        stored = scenario_of(await scenario_row(connection, scenario_id))
    return await parts.stored_checks.check(stored)


@router.put(
    "/{scenario_id}", summary="Replace a scenario", responses={**_UNKNOWN, **_READ_ONLY, **_CHANGED, **_INVALID}
)
async def put_scenario(
    parts: AppParts,
    caller: CallerOf,
    scenario_id: str,
    body: Annotated[Scenario, Body(openapi_examples=_STEP)],
    response: Response,
    if_match: Annotated[
        str | None, Header(description="replace the scenario only if this is its current `ETag`")
    ] = None,
) -> StoredScenario:
    """Replace one's own scenario completely; it is validated like a new one.

    Running jobs continue with the previous version. With `If-Match`, concurrent changes are not overwritten.
    """
    async with parts.engine.connect() as connection:
        await _lock_replaceable(connection, caller, scenario_id, if_match)
    await refuse_invalid(body, parts.validation_limiter, parts.robots)
    async with parts.engine.begin() as connection:
        await _lock_replaceable(connection, caller, scenario_id, if_match)
        await audit.record_action(connection, caller, "scenario-replaced", scenario_id)
        values = {"body": body.model_dump(mode="json"), "updated_at": func.now()}
        await connection.execute(update(scenario).where(scenario.c.id == scenario_id).values(values))
        stored = scenario_of(await scenario_row(connection, scenario_id))
    await parts.stored_checks.start(stored)
    response.headers["ETag"] = stored.etag
    return stored


async def _lock_replaceable(
    connection: AsyncConnection, caller: Caller, scenario_id: str, if_match: str | None
) -> None:
    """Lock a scenario; raise unless ``caller`` may replace it and ``if_match`` contains its current ETag."""
    row = await lock_changeable_row(connection, scenario_id)
    require_owner(caller, row["owner"], "scenario")
    check_if_match(row, if_match)


@router.delete("/{scenario_id}", status_code=204, summary="Delete a scenario", responses={**_UNKNOWN, **_READ_ONLY})
async def delete_scenario(parts: AppParts, caller: CallerOf, scenario_id: str) -> None:
    """Delete one's own scenario. Its jobs and their results remain, without the link."""
    async with parts.engine.begin() as connection:
        row = await lock_changeable_row(connection, scenario_id)
        require_owner(caller, row["owner"], "scenario")
        await audit.record_action(connection, caller, "scenario-deleted", scenario_id)
        await connection.execute(delete(scenario).where(scenario.c.id == scenario_id))
