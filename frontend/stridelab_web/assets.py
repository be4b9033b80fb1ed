"""Files for the browser: our own from this package, plotly's from the installed plotly package."""

import gzip
import re
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

HERE = Path(__file__).parent
STATIC = HERE / "static"
TEMPLATES = HERE / "templates"


class OwnFiles(StaticFiles):
    """Our own files: scripts and styles of a new version are taken at once.

    The sign of the pages is kept, since a browser asks for it at every change of the address.
    """

    async def get_response(self, path: str, scope: Scope) -> Response:
        """The file, with how long it may be kept."""
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
def plotly_style_ids() -> tuple[str, ...]:
    """Ids of the style sheets (of maps) that the script writes into a page unless an element of that id is there.

    Our content policy refuses inline styles, and we draw no maps: a page names elements so, and nothing is refused.
    """
    found = re.findall(rb'document\.getElementById\("([0-9a-f]{64})"\)', plotly_js())
    return tuple(sorted({name.decode() for name in found}))


async def plotly_script(request: Request) -> Response:
    """``GET /static/plotly.min.js``."""
    tag = f'"plotly-{version("plotly")}"'
    headers = {"ETag": tag, "Cache-Control": "public, max-age=86400"}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    return compressed(request, plotly_js_gzip(), "text/javascript", headers)


def compressed(request: Request, gzipped: bytes, media_type: str, headers: dict[str, str]) -> Response:
    """``gzipped`` as it is, or unpacked for the rare client that does not take gzip."""
    headers = {**headers, "Vary": "Accept-Encoding"}
    if "gzip" in request.headers.get("accept-encoding", ""):
        return Response(gzipped, media_type=media_type, headers={**headers, "Content-Encoding": "gzip"})
    return Response(gzip.decompress(gzipped), media_type=media_type, headers=headers)
