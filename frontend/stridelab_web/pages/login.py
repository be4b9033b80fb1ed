"""The login page; the form is answered by the interface, which sets the cookie."""

from starlette.requests import Request
from starlette.responses import Response

from stridelab_web.pages.render import page


async def login(request: Request) -> Response:
    """``GET /login``."""
    query = request.query_params
    wrong = "That is not the token." if "wrong" in query else ""
    return page(request, "login.html", section="Login", next=query.get("next", "/"), wrong=wrong)
