"""The web app: pages, static files, and the proxy to the viewer."""

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute

from stridelab.client import ProblemError, Unreachable
from stridelab_web import assets
from stridelab_web.api_client import make_client
from stridelab_web.config import WebConfig
from stridelab_web.pages import errors, home, job, lists, recording, reproduction, robot, settings, subject
from stridelab_web.pages.plans import page
from stridelab_web.pages.render import make_environment
from stridelab_web.pages.results import comparison, population, reachability, sweep
from stridelab_web.pages.scenarios import page as scenario
from stridelab_web.pages.viewer import page as view
from stridelab_web.pages.viewer import planner
from stridelab_web.scene import proxy
from stridelab_web.scene.frame_cache import KeptFrames
from stridelab_web.viser_client import FOLDER


def create_web(config: WebConfig) -> Starlette:
    """The ASGI app of all pages. Processes share no state: any number of them may serve it."""
    app = Starlette(
        routes=routes(),
        exception_handlers={
            ProblemError: errors.on_problem,
            Unreachable: errors.on_unreachable,
            HTTPException: errors.on_http,
        },
    )
    app.state.config = config
    app.state.client = make_client(config)
    app.state.environment = make_environment(config)
    app.state.packed = KeptFrames()
    return app


def routes() -> list[BaseRoute]:
    """All routes of the web app."""
    scene = "/view/scene/{kind}/{id}/{job}"
    return [
        Route("/", home.home),
        Route("/recordings", lists.recordings),
        Route("/recordings/{id}", recording.recording),
        Route("/subjects", subject.subjects),
        Route("/subjects/{id}", subject.subject),
        Route("/scenarios", scenario.scenarios),
        Route("/scenarios/{id}", scenario.scenario),
        Route("/plans/{id}", page.plan),
        Route("/plans/{id}/plots.json", page.plots),
        Route("/robots", robot.robots),
        Route("/robots/{name}", robot.robot),
        Route("/robots/{name}/reach.json", robot.reach),
        Route("/sweeps", sweep.sweeps),
        Route("/settings", settings.settings),
        Route("/jobs", lists.jobs),
        Route("/reproduction", reproduction.reproduction),
        Route("/jobs/{id}", job.job),
        Route("/jobs/{id}/plots.json", job.plots),
        Route("/jobs/{id}/figures/{name}.json", comparison.figure),
        Route("/jobs/{id}/reach.json", reachability.reach),
        Route("/population", population.new),
        Route("/population/{id}", population.population),
        Route("/view/", view.view),
        Route(f"{scene}/", proxy.page),
        Route(f"{scene}/open", proxy.open_scene, methods=["POST"]),
        Route(f"{scene}/frames.bin", view.values),
        Route(f"{scene}/motion.{{form}}", proxy.player),
        Route("/view/scene/scenario/{id}/-/touches.json", planner.footholds),
        WebSocketRoute(scene, proxy.pump),
        Route("/login", settings.login),
        Route("/static/plotly.min.js", assets.plotly_script),
        Route(f"{FOLDER}{{name}}", assets.viser_file),
        Mount("/static", assets.OwnFiles(directory=assets.STATIC)),
    ]
