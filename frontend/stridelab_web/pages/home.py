"""The home page: samples to start with, and the latest recordings and jobs.

The page of settings and tokens, which shows no secrets, the login page, and the page of live streams, which its script
fills.

The login form is sent to the HTTP interface, which sets the cookie.
"""

from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import Job
from stridelab.schemas.scenarios import StoredScenario
from stridelab.translations.catalogue import gettext
from stridelab_web.api_client import client_of, none_if_missing
from stridelab_web.config import WebConfig
from stridelab_web.pages.lists import subjects_of_jobs
from stridelab_web.pages.render import render_page
from stridelab_web.pages.scenarios.page import scenario_cards

SAMPLE_RECORDING: Final = "sample-walk"
SAMPLE_SCENARIO: Final = "six-stairs"
LATEST, SCENARIOS = 6, 4


async def home(request: Request) -> Response:
    """``GET /``."""
    client = client_of(request)
    recordings, jobs = await client.recordings(limit=LATEST), await client.jobs(limit=LATEST)
    shown = await _featured_scenarios(client)
    return render_page(
        request,
        "pages/home.html",
        section="Home",
        sample=await none_if_missing(client.recording(SAMPLE_RECORDING)),
        recordings=recordings.items,
        jobs=jobs.items,
        names=await subjects_of_jobs(client, jobs.items),
        scenarios=[
            {**card, "plan": await _motion_of(client, item.id)}
            for card, item in zip(scenario_cards(shown), shown, strict=True)
        ],
    )


async def live_page(request: Request) -> Response:
    """``GET /live``."""
    return render_page(request, "pages/live.html", section="Live")


async def _featured_scenarios(client: AsyncClient) -> list[StoredScenario]:
    """The sample scenario first, then the newest."""
    stairs = await none_if_missing(client.scenario(SAMPLE_SCENARIO))
    newest = (await client.scenarios(limit=SCENARIOS)).items
    first = [] if stairs is None else [stairs]
    return [*first, *(item for item in newest if item.id != SAMPLE_SCENARIO)][:SCENARIOS]


async def _motion_of(client: AsyncClient, scenario_id: str) -> Job | None:
    """The newest plan of a scenario, if it has a whole-body motion."""
    plans = (await client.jobs(1, state="succeeded", kind="plan-motion", scenario_id=scenario_id)).items
    if not plans or (await client.result(plans[0].id)).summary.get("certificate") is None:
        return None
    return plans[0]


async def settings_page(request: Request) -> Response:
    """``GET /settings``."""
    config: WebConfig = request.app.state.config
    client = client_of(request)
    return render_page(
        request,
        "pages/settings.html",
        section="Settings",
        health=await client.health(),
        solvers=await client.solvers(),
        settings=config.settings,
        viewer=config.viewer_url is not None,
        address=str(request.base_url).rstrip("/"),
    )


async def login_page(request: Request) -> Response:
    """``GET /login``."""
    query = request.query_params
    wrong = gettext("This token is not valid.") if "wrong" in query else ""
    return render_page(request, "pages/login.html", section="Login", next=query.get("next", "/"), wrong=wrong)
