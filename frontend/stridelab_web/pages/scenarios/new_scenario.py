"""New scenarios: a course of obstacles, drawn while it is composed, or a terrain of a file.

The contact planner places the feet.
"""

import json

from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from stridelab.client import ProblemError
from stridelab.schemas.plans import PlanContactsInput
from stridelab.schemas.scenarios import BoxSurface, Course, Scenario, ScenarioPhase
from stridelab_web.api_client import client_of
from stridelab_web.charts.scenario_drawing import draw_scenario
from stridelab_web.pages.render import render_page
from stridelab_web.scene.contacts import box_corners_m


async def new_scenario_page(request: Request) -> Response:
    """``GET /scenarios/new``; the page's script draws the course as soon as it runs."""
    robots = await client_of(request).robots()
    return render_page(request, "pages/scenario_new.html", section="Scenarios", way="obstacles", robots=robots.items)


async def terrain_page(request: Request) -> Response:
    """``GET /scenarios/new/file``; the page's script sends the file and draws its terrain."""
    robots = await client_of(request).robots()
    return render_page(request, "pages/scenario_from_file.html", section="Scenarios", way="file", robots=robots.items)


async def course_pictures(request: Request) -> Response:
    """``GET /scenarios/new/pictures?course=``: drawings of a course, or the reason why it cannot be composed."""
    try:
        course = Course.model_validate(json.loads(request.query_params.get("course", "null")))
        task = await client_of(request).compose_scenario(course)
    except ProblemError as refusal:
        return _reason(refusal.problem.detail)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        return _reason(f"{'.'.join(map(str, first['loc']))}: {first['msg']}.")
    except ValueError:
        return _reason("The course is not JSON.")
    drawn = _with_both_stances(task)
    side = draw_scenario(drawn, "side")
    handles = {} if side is None else {k: side.to_px(corner_m) for k, corner_m in _end_corners(task).items()}
    return render_page(
        request, "partials/_course.html", side=side, above=draw_scenario(drawn, "above"), handles=handles
    )


def _end_corners(task: PlanContactsInput) -> dict[int, tuple[float, float]]:
    """Upper rear corner (x, z) of the last box of each element, by its index; a gap has none.

    The names of an element's boxes begin with its number (``stridelab.contacts.scenarios.course``).
    """
    corners = {}
    for surface in task.terrain:
        number = surface.name.partition(" ")[0]
        if isinstance(surface, BoxSurface) and number.isdigit():
            x, z = max(box_corners_m(surface)[:, [0, 2]].tolist(), key=sum)
            corners[int(number) - 1] = (x, z)
    return corners


def _with_both_stances(task: PlanContactsInput) -> Scenario:
    """A scenario whose phases are start and goal."""
    phases = [ScenarioPhase(duration_s=1.0, contacts=end.contacts) for end in (task.start, task.goal)]
    name, robot, friction = task.name or "Course", task.robot, task.friction
    return Scenario(name=name, robot=robot, friction=friction, terrain=task.terrain, phases=phases)


def _reason(text: str) -> Response:
    return HTMLResponse(text, status_code=422, media_type="text/plain")
