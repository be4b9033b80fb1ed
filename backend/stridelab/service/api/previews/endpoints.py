"""Interactive planning: the available solvers, and a preview of the motion of a scenario."""

from typing import Annotated, Any, Final

from fastapi import APIRouter, Body

from stridelab.schemas.previews import PlanPreview, PlanPreviewInput, Solvers
from stridelab.service.api.dependencies import AppParts
from stridelab.service.api.openapi import failure_responses
from stridelab.service.api.scenarios.repository import scenario_of, scenario_row
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.samples.scenario_bodies import ONE_STEP

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
    """List the solvers, and for an unavailable one the reason."""
    return Solvers.model_validate(await parts.resident.ask({"ask": "solvers"}))


@router.post(
    "/plans/preview",
    summary="Plan at once",
    responses=failure_responses(
        s404="No scenario with this id (`scenario-not-found`).",
        s422="The scenario is malformed (`invalid-request`), the C++ solver is not available (`solver-unavailable`), "
        "or the push is after the end of the motion (`push-too-late`).",
        s429="Too many requests are waiting (`preview-busy`); `Retry-After` gives the time to wait.",
        s503="The planner failed and was restarted (`preview-failed`, `preview-stuck`).",
    ),
)
async def preview(parts: AppParts, body: Annotated[PlanPreviewInput, Body(openapi_examples=_BODIES)]) -> PlanPreview:
    """Compute the centroidal motion of a scenario with the C++ solver, within milliseconds. Nothing is stored.

    The controls are the contact forces within their exact friction cones. With a push, the motion is replanned from
    the state after the push. A scenario that the robot cannot perform is answered with `errors`; if the solver does
    not converge, `converged` is false and `status` gives the reason.
    """
    scenario = body.scenario
    if scenario is None:
        async with parts.engine.connect() as connection:
            stored = scenario_of(await scenario_row(connection, str(body.scenario_id)))
        names = type(stored).model_fields.keys() - {"id", "created_at", "updated_at", "bundled", "owner"}
        document = stored.model_dump(mode="json", include=set(names))
    else:
        document = scenario.model_dump(mode="json")
    question = {**body.model_dump(mode="json", exclude={"scenario_id", "scenario"}), "scenario": document}
    request = {"ask": "preview", "input": question}
    return PlanPreview.model_validate(await parts.own_planners.ask(document["robot"], request, parts.resident))
