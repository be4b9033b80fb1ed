"""The loopback address at which the web app asks for scenes."""

import hmac

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from stridelab.client import ProblemError, Unreachable
from stridelab_web.documents import document_of
from stridelab_web.viewer.library import Library


def create_control(library: Library, token: str | None) -> Starlette:
    """``GET /health`` and ``POST /scenes {kind, id, job_id}`` -> ``{port, secret, said}``.

    Browsers cannot call it: a page's request carries an Origin and is refused, and a name that was rebound to this
    machine is not a loopback host. Where the service has a token, it is needed here too.
    """

    async def health(_: Request) -> Response:
        return JSONResponse({"status": "ok", "scenes": len(library)})

    async def scenes(request: Request) -> Response:
        if not _may(request, token):
            return JSONResponse({"detail": "not allowed"}, status_code=403)
        try:
            opened = await run_in_threadpool(library.open, document_of(await request.json()))
        except KeyError:
            return JSONResponse({"detail": "There is no such scene."}, status_code=404)
        except ProblemError as refusal:
            return JSONResponse(refusal.problem.model_dump(mode="json"), status_code=refusal.status)
        except Unreachable as silence:
            return JSONResponse({"detail": str(silence)}, status_code=503)
        return JSONResponse({"port": opened.port, "secret": opened.secret, "said": opened.said})

    return Starlette(routes=[Route("/health", health), Route("/scenes", scenes, methods=["POST"])])


def _may(request: Request, token: str | None) -> bool:
    host = request.headers.get("host", "").rpartition(":")[0]
    if "origin" in request.headers or host not in ("127.0.0.1", "localhost", "[::1]"):
        return False
    if token is None:
        return True
    return hmac.compare_digest(request.headers.get("authorization", "").encode(), f"Bearer {token}".encode())
