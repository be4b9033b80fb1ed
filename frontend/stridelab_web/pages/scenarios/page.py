"""Scenarios: the list with pictures, and the page of one with its contacts, its check and its plans."""

from collections.abc import Sequence
from functools import lru_cache

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import Job
from stridelab.schemas.scenarios import Scenario, StoredScenario
from stridelab_web.api_client import client_of
from stridelab_web.charts import intervals
from stridelab_web.charts.scenario_drawing import Drawing, draw_scenario
from stridelab_web.pages.lists import list_query, next_page
from stridelab_web.pages.render import render_page
from stridelab_web.pages.scenarios.equilibrium_table import (
    equilibrium_bars,
    equilibrium_summary,
    phase_equilibria,
    tightest_phase,
)
from stridelab_web.scene.contacts import PlacedContact, placed_contacts

MAX_CARDS = 24
CACHED_DRAWINGS = 256
"""Number of drawings in the memory of a web server process: drawing takes two thirds of the time of the list."""


async def scenarios_page(request: Request) -> Response:
    """``GET /scenarios?search=&sort=``."""
    client = client_of(request)
    listed = await client.scenarios(limit=MAX_CARDS, **list_query(request))
    return render_page(
        request,
        "pages/scenarios.html",
        section="Scenarios",
        scenarios=await scenario_cards(client, listed.items),
        query=request.query_params,
        next=next_page(request, listed.next),
    )


async def scenario_page(request: Request) -> Response:
    """``GET /scenarios/{id}``."""
    client = client_of(request)
    scenario = await client.scenario(request.path_params["id"])
    bare = Scenario.model_validate(Scenario.readable_fields(scenario.model_dump()))
    check = await client.check_scenario(bare)
    kinds = [await client.jobs(scenario_id=scenario.id, kind=kind) for kind in ("plan-motion", "plan-receding")]
    plans = sorted((job for jobs in kinds for job in jobs.items), key=lambda job: job.created_at, reverse=True)
    placed = placed_contacts(bare)
    duration_s = sum(phase.duration_s for phase in scenario.phases)
    phases = phase_equilibria(bare, check)
    least = tightest_phase(phases)
    return render_page(
        request,
        "pages/scenario.html",
        section="Scenarios",
        scenario=scenario,
        check=check,
        plans=plans,
        touches=placed,
        duration_s=duration_s,
        side=draw_scenario(bare, "side"),
        above=draw_scenario(bare, "above", least.region_m if least else ()),
        phases=phases,
        least=least,
        summary=equilibrium_summary(phases),
        holding=equilibrium_bars(phases, duration_s),
        strip=contact_bars(placed, duration_s),
        ticks=intervals.time_ticks(duration_s),
    )


async def scenario_cards(client: AsyncClient, scenarios: Sequence[StoredScenario]) -> list[dict[str, object]]:
    """Template values of the cards of scenarios, with the newest plan of each, if it has a whole-body motion."""
    plans: Sequence[Job] = ()
    if scenario_ids := [item.id for item in scenarios]:
        listed = await client.jobs(
            len(scenario_ids),
            state="succeeded",
            kind="plan-motion",
            scenario_id=scenario_ids,
            one_per_scenario=True,
        )
        plans = listed.items
    motions = {plan.scenario_id: plan for plan in plans if plan.verdict is not None}  # others have no body
    return [
        {
            "scenario": item,
            "side": _side_drawing(item.model_dump_json(exclude=set(Scenario.ignored_fields))),
            "duration_s": sum(phase.duration_s for phase in item.phases),
            "plan": motions.get(item.id),
        }
        for item in scenarios
    ]


@lru_cache(maxsize=CACHED_DRAWINGS)
def _side_drawing(scenario: str) -> Drawing | None:
    return draw_scenario(Scenario.model_validate_json(scenario), "side")


def contact_bars(placed: tuple[PlacedContact, ...], duration_s: float) -> dict[str, tuple[intervals.Bar, ...]]:
    """Contacts of each effector over time as bars of a strip."""
    effectors = dict.fromkeys(touch.effector for touch in placed)
    return {
        name: intervals.interval_bars([(t.start_s, t.end_s) for t in placed if t.effector == name], duration_s)
        for name in effectors
    }
