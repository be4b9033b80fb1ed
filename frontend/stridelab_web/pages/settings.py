"""The page of settings and tokens, which shows no secrets, and the login page.

The login form is sent to the HTTP interface, which sets the cookie.
"""

from starlette.requests import Request
from starlette.responses import Response

from stridelab_web.api_client import client_of
from stridelab_web.config import WebConfig
from stridelab_web.pages.render import render_page


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
    wrong = "This token is not valid." if "wrong" in query else ""
    return render_page(request, "pages/login.html", section="Login", next=query.get("next", "/"), wrong=wrong)
