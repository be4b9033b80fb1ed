"""Error pages: the message of the HTTP interface, and links to other pages."""

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import ProblemError, Unreachable
from stridelab_web.pages.render import render_page

_TITLES = {
    401: "Please log in",
    403: "Not allowed",
    404: "Not found",
    409: "Not possible now",
    429: "Too busy",
    503: "Part of the service does not answer",
}


async def on_problem(request: Request, error: Exception) -> Response:
    """Error page for a problem response of the HTTP interface."""
    if not isinstance(error, ProblemError):
        raise error
    problem = error.problem
    wait = error.retry_after_s
    answer = render_page(
        request,
        "pages/error.html",
        problem.status,
        title=_TITLES.get(problem.status, problem.title),
        detail=problem.detail if wait is None else f"{problem.detail} Try again in {wait:g} s.",
        code=problem.code,
        status=problem.status,
        errors=problem.errors,
    )
    if wait is not None:
        answer.headers["Retry-After"] = f"{wait:g}"
    return answer


async def on_http(request: Request, error: Exception) -> Response:
    """Error page for a wrong address or method."""
    if not isinstance(error, HTTPException):
        raise error
    status = error.status_code
    detail = "There is no page at this address." if status == 404 else str(error.detail)
    title = _TITLES.get(status, "Request failed")
    return render_page(
        request, "pages/error.html", status, title=title, detail=detail, code="", status=status, errors=[]
    )


async def on_unreachable(request: Request, error: Exception) -> Response:
    """Error page if the HTTP interface does not answer."""
    if not isinstance(error, Unreachable):
        raise error
    detail = "The service does not answer at the moment. Try again in a few seconds."
    return render_page(
        request, "pages/error.html", 503, title=_TITLES[503], detail=detail, code="", status=503, errors=[]
    )
