"""Static files: our own and viser's client from this package, plotly's from the installed one."""

import gzip
import re
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Final

import zstandard
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from stridelab_web import viser_client

HERE = Path(__file__).parent
STATIC = HERE / "static"
TEMPLATES = HERE / "templates"
IMMUTABLE: Final = "public, max-age=31536000, immutable"
"""Cache-Control of a file whose name changes with its content."""
PLOTLY_ZSTD_LEVEL: Final = 9
"""Compresses plotly in a ninth of a second; level 19 takes sixteen times as long for 9 % less size."""


class OwnFiles(StaticFiles):
    """Our own static files: browsers revalidate scripts and styles, so that a new version takes effect at once.

    The icon of the pages is cached, because browsers request it at every change of the address.
    """

    async def get_response(self, path: str, scope: Scope) -> Response:
        """The file with its Cache-Control header."""
        answer = await super().get_response(path, scope)
        answer.headers["Cache-Control"] = "public, max-age=86400" if path.endswith(".svg") else "no-cache"
        return answer


@cache
def plotly_js() -> bytes:
    """The script of the installed plotly package."""
    return files("plotly").joinpath("package_data", "plotly.min.js").read_bytes()


@cache
def plotly_js_gzip() -> bytes:
    """The script, compressed once (4.8 MB to 1.4 MB)."""
    return gzip.compress(plotly_js(), compresslevel=6, mtime=0)


@cache
def plotly_js_zstd() -> bytes:
    """The script, compressed once for browsers that accept zstd (4.8 MB to 1.3 MB)."""
    return zstandard.ZstdCompressor(level=PLOTLY_ZSTD_LEVEL).compress(plotly_js())


@cache
def plotly_style_ids() -> tuple[str, ...]:
    """Ids of the style sheets (of maps) that the script writes into a page unless an element of that id is there.

    The content policy refuses inline styles, and we draw no maps: pages contain empty elements with these ids.
    """
    ids = re.findall(rb'document\.getElementById\("([0-9a-f]{64})"\)', plotly_js())
    return tuple(sorted({name.decode() for name in ids}))


async def plotly_script(request: Request) -> Response:
    """``GET /static/plotly.min.js``."""
    tag = f'"plotly-{version("plotly")}"'
    headers = {"ETag": tag, "Cache-Control": "public, max-age=86400"}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    if accepts_encoding(request, "zstd"):
        return zstd_response(await run_in_threadpool(plotly_js_zstd), "text/javascript", headers)
    return gzip_response(request, await run_in_threadpool(plotly_js_gzip), "text/javascript", headers)


async def viser_file(request: Request) -> Response:
    """``GET /static/viser/{name}``: the script of viser's client, by the name that its page requests."""
    client = await run_in_threadpool(viser_client.built_client)
    if request.path_params["name"] != client.name:
        raise HTTPException(404, "This file belongs to another version: load the page again.")
    headers = {"Cache-Control": IMMUTABLE}
    if accepts_encoding(request, "zstd"):
        return zstd_response(client.script_zstd, "text/javascript", headers)
    return gzip_response(request, client.script_gzip, "text/javascript", headers)


def accepts_encoding(request: Request, coding: str) -> bool:
    """Whether the client accepts this content coding."""
    return coding in request.headers.get("accept-encoding", "")


def zstd_response(packed: bytes, media_type: str, headers: dict[str, str]) -> Response:
    """Response with the zstd-compressed content ``packed``."""
    encoded = {**headers, "Vary": "Accept-Encoding", "Content-Encoding": "zstd"}
    return Response(packed, media_type=media_type, headers=encoded)


def gzip_response(request: Request, gzipped: bytes, media_type: str, headers: dict[str, str]) -> Response:
    """Response with the ``gzipped`` content, unpacked for clients that do not accept gzip."""
    headers = {**headers, "Vary": "Accept-Encoding"}
    if accepts_encoding(request, "gzip"):
        return Response(gzipped, media_type=media_type, headers={**headers, "Content-Encoding": "gzip"})
    return Response(gzip.decompress(gzipped), media_type=media_type, headers=headers)
