"""Error pages: the message of the HTTP interface, and links to other pages."""

from collections.abc import Sequence

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import ProblemError, Unreachable
from stridelab.schemas.base import FaultItem
from stridelab.translations.catalogue import ENGLISH, current_language, gettext, translate_text
from stridelab_web.pages.render import render_page

TITLES = {
    401: "Please log in",
    403: "Not allowed",
    404: "Not found",
    409: "Not possible now",
    429: "Too busy",
    503: "Part of the service does not answer",
}
"""Titles of the pages of errors by their status."""
EXPLANATIONS = {
    "job-not-found": "This job does not exist, or it has been deleted.",
    "recording-not-found": "This recording does not exist, or it has been deleted.",
    "subject-not-found": "This subject does not exist, or it has been deleted.",
    "login-needed": "This service needs a login with a token.",
    "queue-full": "Too many jobs are waiting. Try again in a few seconds.",
    "too-many-requests": "Too many requests in a short time. Try again in a few seconds.",
    "foreign-host": "The service does not answer to this host name.",
    "foreign-origin": "The request comes from a page of another site.",
    "database-unreachable": "The database does not answer. Try again shortly.",
}
"""What codes of problems mean, in other languages than that of the problem itself."""


async def on_problem(request: Request, error: Exception) -> Response:
    """Error page for a problem response of the HTTP interface."""
    if not isinstance(error, ProblemError):
        raise error
    problem, wait = error.problem, error.retry_after_s
    detail = problem.detail
    if wait is not None:
        detail = f"{detail} {gettext('Try again in %(seconds)s s.', seconds=f'{wait:g}')}"
    answer = error_page(request, problem.status, detail, problem.title, problem.code, problem.errors)
    if wait is not None:
        answer.headers["Retry-After"] = f"{wait:g}"
    return answer


async def on_http(request: Request, error: Exception) -> Response:
    """Error page for a wrong address or method."""
    if not isinstance(error, HTTPException):
        raise error
    missing = error.status_code == 404
    detail = gettext("There is no page at this address.") if missing else str(error.detail)
    return error_page(request, error.status_code, detail)


async def on_unreachable(request: Request, error: Exception) -> Response:
    """Error page if the HTTP interface does not answer."""
    if not isinstance(error, Unreachable):
        raise error
    return error_page(request, 503, gettext("The service does not answer at the moment. Try again in a few seconds."))


def error_page(
    request: Request,
    status: int,
    detail: str,
    title: str = "Request failed",
    code: str = "",
    errors: Sequence[FaultItem] = (),
) -> Response:
    """The page of an error; ``title`` is for a status without a title of its own."""
    title = gettext(TITLES.get(status, title))
    known = EXPLANATIONS.get(code, "")
    explanation = "" if current_language() == ENGLISH else translate_text(known) if known else ""
    return render_page(
        request,
        "pages/error.html",
        status,
        title=title,
        explanation=explanation,
        detail=detail,
        code=code,
        status=status,
        errors=errors,
    )
