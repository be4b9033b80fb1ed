"""The book, served by the service itself."""

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from stridelab_web.book.contents import INDEX, chapters, picture_file
from stridelab_web.pages.render import render_page


async def help_page(request: Request) -> Response:
    """``GET /help/{name}``: a page of the book; ``/help/`` is its first one."""
    # imported lazily: a service whose book is not read does not need the parsers
    from stridelab_web.book.markdown import read_page

    name = request.path_params["name"].removesuffix(".md") or INDEX
    page = await run_in_threadpool(read_page, name)
    if page is None:
        raise HTTPException(404, "The book has no such page.")
    return render_page(
        request, "pages/help.html", section="Help", page=page, address=f"/help/{name}", chapters=chapters()
    )


async def help_picture(request: Request) -> Response:
    """``GET /help/pictures/{name}``."""
    path = picture_file(request.path_params["name"])
    if path is None:
        raise HTTPException(404, "The book has no such picture.")
    return FileResponse(path, headers={"Cache-Control": "public, max-age=3600"})
