"""The web app: pages, static files, and the proxy to the viewer."""

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.responses import RedirectResponse
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute

from stridelab.client import ProblemError, Unreachable
from stridelab_web import assets
from stridelab_web.api_client import make_client
from stridelab_web.config import WebConfig
from stridelab_web.languages import LanguageMiddleware, in_english, script_file
from stridelab_web.pages import book, errors, home, job, lists, recording, reproduction, robot
from stridelab_web.pages.plans import page
from stridelab_web.pages.render import make_environment
from stridelab_web.pages.results import comparison, population, reachability, sweep
from stridelab_web.pages.scenarios import new_scenario
from stridelab_web.pages.scenarios import page as scenario
from stridelab_web.pages.viewer import live, planner
from stridelab_web.pages.viewer import page as view
from stridelab_web.scene import proxy
from stridelab_web.scene.frame_cache import FrameCache
from stridelab_web.viser_client import FOLDER


def create_web(config: WebConfig) -> Starlette:
    """The ASGI app of all pages. Processes share no state: any number of them may serve it."""
    app = Starlette(
        routes=web_routes(),
        middleware=[Middleware(LanguageMiddleware, default=config.language)],
        exception_handlers={
            ProblemError: errors.on_problem,
            Unreachable: errors.on_unreachable,
            HTTPException: errors.on_http,
        },
    )
    app.state.config = config
    app.state.client = make_client(config)
    app.state.environment = make_environment(config)
    app.state.packed = FrameCache()
    return app


def web_routes() -> list[BaseRoute]:
    """All routes of the web app; pages without ``in_english`` are translated."""
    scene = "/view/scene/{kind}/{id}/{job}"
    return [
        Route("/", home.home),
        Route("/recordings", lists.recordings_page),
        Route("/recordings/{id}", recording.recording_page),
        Route("/subjects", lists.subjects_page),
        Route("/subjects/{id}", lists.subject_page),
        Route("/scenarios", in_english(scenario.scenarios_page)),
        Route("/scenarios/new", in_english(new_scenario.new_scenario_page)),
        Route("/scenarios/new/file", new_scenario.terrain_page),
        Route("/scenarios/new/pictures", new_scenario.course_pictures),
        Route("/scenarios/{id}", in_english(scenario.scenario_page)),
        Route("/plans/{id}", in_english(page.plan_page)),
        Route("/plans/{id}/plots.json", in_english(page.plots_json)),
        Route("/robots", in_english(robot.robots_page)),
        Route("/robots/{name}", in_english(robot.robot_page)),
        Route("/robots/{name}/reach.json", in_english(robot.reach_json)),
        Route("/live", home.live_page),
        Route("/live/robots", in_english(live.live_robots_page)),
        Route("/live/robots/{id}", in_english(live.live_robot_page)),
        Route("/sweeps", in_english(sweep.sweeps_page)),
        Route("/settings", in_english(home.settings_page)),
        Route("/jobs", lists.jobs_page),
        Route("/reproduction", in_english(reproduction.reproduction_page)),
        Route("/jobs/{id}", job.job_page),
        Route("/jobs/{id}/plots.json", job.plots_json),
        Route("/jobs/{id}/figures/{name}.json", comparison.figure_json),
        Route("/jobs/{id}/reach.json", in_english(reachability.reach_json)),
        Route("/population", population.new_study_page),
        Route("/population/{id}", population.study_page),
        Route("/view/", view.view_page),
        Route(f"{scene}/", proxy.scene_page),
        Route(f"{scene}/open", proxy.open_scene, methods=["POST"]),
        Route(f"{scene}/frames.bin", view.frames_bin),
        Route(f"{scene}/motion.{{form}}", proxy.player_file),
        Route("/view/scene/scenario/{id}/-/touches.json", planner.contacts_json),
        WebSocketRoute(scene, proxy.relay_websocket),
        Route("/help/pictures/{name}", book.help_picture),
        Route("/help/{name:path}", in_english(book.help_page)),
        Route("/help", lambda _: RedirectResponse("/help/")),
        Route("/login", home.login_page),
        Route("/static/plotly.min.js", assets.plotly_script),
        Route("/static/languages/{name}", script_file),
        Route(f"{FOLDER}{{name}}", assets.viser_file),
        Mount("/static", assets.OwnFiles(directory=assets.STATIC)),
    ]
