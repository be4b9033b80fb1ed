"""The home page: samples to start with, and the latest recordings and jobs.

The page of settings and tokens, which shows no secrets, the login page, and the page of live streams, which its script
fills.

The login form is sent to the HTTP interface, which sets the cookie.
"""

from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient
from stridelab.schemas.scenarios import StoredScenario
from stridelab.translations.catalogue import gettext
from stridelab_web.api_client import client_of, none_if_missing
from stridelab_web.config import WebConfig
from stridelab_web.pages.render import render_page
from stridelab_web.pages.scenarios.page import scenario_cards

SAMPLE_RECORDING: Final = "sample-walk"
SAMPLE_SCENARIO: Final = "six-stairs"
LATEST, SCENARIOS = 6, 4


async def home(request: Request) -> Response:
    """``GET /``."""
    client = client_of(request)
    recordings, jobs = await client.recordings(limit=LATEST), await client.jobs(limit=LATEST)
    scenarios = await _featured_scenarios(client)
    return render_page(
        request,
        "pages/home.html",
        section="Home",
        sample=await none_if_missing(client.recording(SAMPLE_RECORDING)),
        recordings=recordings.items,
        jobs=jobs.items,
        scenarios=await scenario_cards(client, scenarios),
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
