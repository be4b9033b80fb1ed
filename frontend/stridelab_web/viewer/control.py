"""HTTP interface of the viewer process on loopback, through which the web app opens scenes."""

import hmac
from collections.abc import Awaitable, Callable
from typing import get_args

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from stridelab.client import ProblemError, Unreachable
from stridelab_web.scene.documents import PlayerForm, document_of
from stridelab_web.viewer.scene_limits import ScenesInUse
from stridelab_web.viewer.scene_pool import ScenePool

Answer = Callable[[Request], Awaitable[Response]]


def create_control(library: ScenePool, token: str | None) -> Starlette:
    """``GET /health``; ``POST /scenes`` and ``POST /players/{form}`` about the document ``{kind, id, job_id}``.

    Requests for a scene also have the ``user``. The response is ``{port, secret, said}`` for a scene, and the file
    for a player.

    Browsers cannot call it: requests of pages have an Origin and are refused, and a name that was rebound to this
    machine is not a loopback host. If the service has a token, it is required here too.
    """

    async def get_health(_: Request) -> Response:
        return JSONResponse({"status": "ok", "scenes": len(library)})

    async def open_scene(request: Request) -> Response:
        body = await request.json()
        opened = await run_in_threadpool(library.open_scene, document_of(body), str(body.get("user") or ""))
        return JSONResponse({"port": opened.port, "secret": opened.secret, "said": opened.refusal})

    async def record_player(request: Request) -> Response:
        form = request.path_params["form"]
        if form not in get_args(PlayerForm):
            raise KeyError(form)
        return Response(await run_in_threadpool(library.record_player, document_of(await request.json()), form))

    def guard_endpoint(answer: Answer) -> Answer:
        async def guarded_endpoint(request: Request) -> Response:
            if not _is_allowed(request, token):
                return JSONResponse({"detail": "not allowed"}, status_code=403)
            try:
                return await answer(request)
            except KeyError:
                return JSONResponse({"detail": "There is no such scene."}, status_code=404)
            except ScenesInUse as full:
                problem = {"code": full.code, "detail": str(full)}
                return JSONResponse(problem, status_code=full.status)
            except ProblemError as refusal:
                return JSONResponse(refusal.problem.model_dump(mode="json"), status_code=refusal.status)
            except Unreachable as silence:
                return JSONResponse({"detail": str(silence)}, status_code=503)

        return guarded_endpoint

    return Starlette(
        routes=[
            Route("/health", get_health),
            Route("/scenes", guard_endpoint(open_scene), methods=["POST"]),
            Route("/players/{form}", guard_endpoint(record_player), methods=["POST"]),
        ]
    )


def _is_allowed(request: Request, token: str | None) -> bool:
    host = request.headers.get("host", "").rpartition(":")[0]
    if "origin" in request.headers or host not in ("127.0.0.1", "localhost", "[::1]"):
        return False
    if token is None:
        return True
    return hmac.compare_digest(request.headers.get("authorization", "").encode(), f"Bearer {token}".encode())
