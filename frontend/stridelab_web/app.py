"""The web app: pages, their assets, and the door to the viewer."""

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from stridelab_web import assets
from stridelab_web.backend import Backend, BackendProblem
from stridelab_web.config import WebConfig
from stridelab_web.pages import errors, job, login, overview, recording
from stridelab_web.pages.render import make_environment


def create_web(config: WebConfig) -> Starlette:
    """The ASGI app of all pages. It holds no state of its own, so any number of processes may serve it."""
    app = Starlette(
        routes=routes(),
        exception_handlers={BackendProblem: errors.on_problem, HTTPException: errors.on_http},
    )
    app.state.config = config
    app.state.backend = Backend(config)
    app.state.environment = make_environment(config)
    return app


def routes() -> list[BaseRoute]:
    """All addresses of the web app."""
    return [
        Route("/", overview.home),
        Route("/recordings", overview.recordings),
        Route("/recordings/{id}", recording.recording),
        Route("/jobs", overview.jobs),
        Route("/jobs/{id}", job.job),
        Route("/jobs/{id}/plots.json", job.plots),
        Route("/login", login.login),
        Route("/static/plotly.min.js", assets.plotly_js),
        Mount("/static", StaticFiles(directory=assets.STATIC)),
    ]
