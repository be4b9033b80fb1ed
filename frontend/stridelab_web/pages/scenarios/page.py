"""Scenarios: the list with pictures, and the page of one with its contacts, its check and its plans."""

from starlette.requests import Request
from starlette.responses import Response

from stridelab.schemas.scenarios import Scenario, StoredScenario
from stridelab_web.api_client import client_of
from stridelab_web.charts import intervals
from stridelab_web.charts.scenario_drawing import draw_scenario
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


async def scenarios_page(request: Request) -> Response:
    """``GET /scenarios?search=&sort=``."""
    listed = await client_of(request).scenarios(limit=MAX_CARDS, **list_query(request))
    return render_page(
        request,
        "pages/scenarios.html",
        section="Scenarios",
        scenarios=scenario_cards(listed.items),
        query=request.query_params,
        next=next_page(request, listed.next),
    )


async def scenario_page(request: Request) -> Response:
    """``GET /scenarios/{id}``."""
    client = client_of(request)
    scenario = await client.scenario(request.path_params["id"])
    bare = Scenario.model_validate(scenario.model_dump(include=set(Scenario.model_fields)))
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


def scenario_cards(scenarios: list[StoredScenario]) -> list[dict[str, object]]:
    """Template values of the cards of scenarios."""
    return [
        {
            "scenario": item,
            "side": draw_scenario(item, "side"),
            "duration_s": sum(phase.duration_s for phase in item.phases),
        }
        for item in scenarios
    ]


def contact_bars(placed: tuple[PlacedContact, ...], duration_s: float) -> dict[str, tuple[intervals.Bar, ...]]:
    """Contacts of each effector over time as bars of a strip."""
    effectors = dict.fromkeys(touch.effector for touch in placed)
    return {
        name: intervals.interval_bars([(t.start_s, t.end_s) for t in placed if t.effector == name], duration_s)
        for name in effectors
    }
