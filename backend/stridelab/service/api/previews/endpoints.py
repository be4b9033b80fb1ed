"""What is planned while somebody waits: the solvers that there are, and the motion of a scenario as it is now."""

from typing import Annotated, Any, Final

from fastapi import APIRouter, Body

from stridelab.schemas.previews import PlanPreview, PlanPreviewInput, Solvers
from stridelab.service.api.dependencies import AppParts
from stridelab.service.api.openapi import failures
from stridelab.service.api.scenarios.examples import ONE_STEP
from stridelab.service.api.scenarios.repository import scenario_of, scenario_row
from stridelab.service.api.strict_json import StrictRoute

router = APIRouter(tags=["plans"], route_class=StrictRoute)

_BODIES: Final[Any] = {
    "step": {"summary": "One step on a flat floor", "value": {"scenario": ONE_STEP}},
    "pushed": {
        "summary": "The same, pushed to the left",
        "value": {"scenario": ONE_STEP, "push": {"time_s": 1.5, "velocity_m_s": [0.0, 0.05, 0.0]}},
    },
}


@router.get("/solvers", summary="Solvers of the centroidal problem")
async def solvers(parts: AppParts) -> Solvers:
    """Which solvers there are on this machine, and why one is not."""
    return Solvers.model_validate(await parts.resident.ask({"ask": "solvers"}))


@router.post(
    "/plans/preview",
    summary="Plan at once",
    responses=failures(
        s404="No scenario with this id (`scenario-not-found`).",
        s422="It is no scenario (`invalid-request`), the C++ solver is not on this machine (`solver-unavailable`), or "
        "the push comes after the end (`push-too-late`).",
        s429="Too many wait (`preview-busy`); `Retry-After` says when to come back.",
        s503="The planner failed and was started anew (`preview-failed`, `preview-stuck`).",
    ),
)
async def preview(parts: AppParts, body: Annotated[PlanPreviewInput, Body(openapi_examples=_BODIES)]) -> PlanPreview:
    """The centroidal motion of a scenario, in milliseconds by the C++ solver; nothing is stored.

    The control are the contact forces in their exact cones. With a push, the motion is planned anew from the state that
    it leaves. What the robot cannot do is
    answered with `errors`, a motion that was not found with `converged` false and why.
    """
    scenario = body.scenario
    if scenario is None:
        async with parts.engine.connect() as connection:
            stored = scenario_of(await scenario_row(connection, str(body.scenario_id)))
        known = type(stored).model_fields.keys() - {"id", "created_at", "updated_at", "bundled", "owner"}
        wanted = stored.model_dump(mode="json", include=set(known))
    else:
        wanted = scenario.model_dump(mode="json")
    question = {**body.model_dump(mode="json", exclude={"scenario_id", "scenario"}), "scenario": wanted}
    return PlanPreview.model_validate(await parts.resident.ask({"ask": "preview", "input": question}))
