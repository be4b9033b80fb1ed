"""The caller of a request, as the gate has found it."""

from typing import Annotated, Final

from fastapi import Depends
from starlette.requests import HTTPConnection

from stridelab.service.access.callers import STRANGER, Caller

KEY: Final = "stridelab.caller"
"""Where in a request's scope the gate puts the caller."""


async def caller_of(connection: HTTPConnection) -> Caller:
    """Who calls; calls that did not pass the gate come from the pages.

    A coroutine, since FastAPI calls any other dependency in a thread.
    """
    caller = connection.scope.get(KEY, STRANGER)
    if not isinstance(caller, Caller):
        raise TypeError("the gate has put something else than a caller into the request")
    return caller


CallerOf = Annotated[Caller, Depends(caller_of)]
