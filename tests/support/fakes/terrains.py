"""Terrains as the pages see them: the answer depends on the name of the file alone."""

import math
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import Route

from stridelab.schemas.plans import PlanContactsInput
from stridelab.schemas.scenarios import ReadTerrain, TerrainCrossing
from support.fakes.robots import scenario

RISE_M, RUN_M, TREADS = 0.17, 0.28, 8
EDGE_M: Final = 5.0
"""Beyond it, nothing is below a foot."""


def read_terrain() -> ReadTerrain:
    """A floor, eight treads, a landing, a ramp, a wall and two rails."""
    treads = [
        _box(f"tread {k + 1}", (1.14 + k * RUN_M, 0.0), (RUN_M, 1.2), (k + 1) * RISE_M, RISE_M) for k in range(TREADS)
    ]
    slope = math.atan(0.1)
    ramp = {
        **_box("ramp", (-0.8, -2.2), (2.0, 1.2), 0.1, 0.05),
        "orientation_wxyz": [math.cos(slope / 2), 0.0, -math.sin(slope / 2), 0.0],
    }
    wall = {
        **_box("wall 1", (0.5, 1.4), (2.0, 3.0), 1.0, 0.1),
        "orientation_wxyz": [math.cos(math.pi / 4), math.sin(math.pi / 4), 0.0, 0.0],
    }
    rails = [
        {"kind": "rail", "name": f"rail {k}", "from_m": [1.0, y, 0.9], "to_m": [3.2, y, 2.3], "radius_m": 0.02}
        for k, y in ((1, -0.62), (2, 0.62))
    ]
    floor = _box("floor", (-0.25, 0.0), (2.5, 2.4), 0.0, 0.2)
    landing = _box("landing", (3.7, 0.0), (0.9, 1.2), TREADS * RISE_M, 0.2)
    stairs = {
        "rise_m": RISE_M,
        "run_m": RUN_M,
        "width_m": 1.2,
        "start_m": [1.0, 0.0, 0.0],
        "heading_rad": 0.0,
        "treads": [tread["name"] for tread in treads],
        "rails": ["rail 1", "rail 2"],
    }
    remark = "3 surfaces smaller than 10 cm were left out."
    surfaces = [floor, *treads, landing, ramp, wall, *rails]
    return ReadTerrain.model_validate({"terrain": surfaces, "stairs": [stairs], "remarks": [remark]})


def _box(
    name: str, place_m: tuple[float, float], edges_m: tuple[float, float], top_m: float, depth_m: float
) -> dict[str, Any]:
    center_m, size_m = [*place_m, top_m - depth_m / 2], [*edges_m, depth_m]
    return {"kind": "box", "name": name, "center_m": center_m, "size_m": size_m}


def routes(api: str) -> list[Route]:
    """The routes of terrains."""
    return [
        Route(f"{api}/terrains", read, methods=["POST"]),
        Route(f"{api}/terrains/crossing", cross, methods=["POST"]),
    ]


async def read(request: Request) -> JSONResponse:
    """``POST /terrains``: files with "wide" in their name are in millimetres, those with "wall" have no surface."""
    form = await request.form()
    file, unit = form["file"], form["unit"]
    assert not isinstance(file, str)
    name = file.filename or ""
    await form.close()
    if "wide" in name and unit != "mm":
        width = 4000 if unit == "m" else 40
        detail = f"It is {width} m wide; a terrain has 0.2 to 100 m. State its unit."
        return _refusal(
            "terrain-mesh-unreadable", f"The mesh of the terrain cannot be used. {detail}", name, "cannot be used"
        )
    if "wall" in name:
        text = f"{name} has no surface on which a foot can stand: at most 35 degrees steep, 10 cm long and wide."
        return _refusal("terrain-without-surfaces", text, name, "no surface")
    return JSONResponse(read_terrain().model_dump(mode="json", exclude_none=True))


async def cross(request: Request) -> JSONResponse:
    """``POST /terrains/crossing``."""
    crossing, walk = TerrainCrossing.model_validate(await request.json()), scenario()
    if crossing.goal_m[0] > EDGE_M:
        reason = f"there is no surface at ({crossing.goal_m[0]:.2f}, {crossing.goal_m[1]:.2f}) m"
        return _refusal("terrain-without-foothold", f"Goal, left foot: {reason}.", "goal, left foot", reason)
    start, goal = ({"contacts": walk.phases[k].contacts} for k in (0, -1))
    fields = {"robot": crossing.robot, "terrain": walk.terrain, "start": start, "goal": goal, "name": crossing.name}
    return JSONResponse(PlanContactsInput.model_validate(fields).model_dump(mode="json"))


def _refusal(code: str, detail: str, where: str, message: str) -> JSONResponse:
    problem = {"title": "Unprocessable", "status": 422, "code": code, "detail": detail}
    return JSONResponse(problem | {"errors": [{"where": where, "message": message}]}, 422)
