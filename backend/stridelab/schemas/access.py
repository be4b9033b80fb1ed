"""Tokens and the audit log, as in the HTTP contract."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from stridelab.schemas.base import Contract

TokenScope = Literal["read", "submit", "admin"]
"""What a token allows, each with what stands before it: look, work, manage tokens."""

TokenName = Annotated[
    str,
    Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,39}$", description="who uses the token; jobs and uploads are theirs"),
]


class CallerFacts(Contract):
    """Who calls: the name of the token, if there are names, and what it allows."""

    name: str | None = None
    scope: TokenScope


class TokenInput(Contract):
    """A token to make; without ``days`` it is good until it is revoked."""

    name: TokenName
    scope: TokenScope = "submit"
    days: Annotated[float | None, Field(gt=0, le=3650, description="how long it is good")] = None


class TokenFacts(Contract):
    """A token without its secret, which is nowhere."""

    id: str
    name: str
    scope: TokenScope
    created_at: datetime
    expires_at: datetime | None = None
    revoked_at: datetime | None = None


class NewToken(TokenFacts):
    """The answer to whoever made a token: the only time that ``secret`` is shown."""

    secret: str


class AuditEntry(Contract):
    """Somebody did something; ``caller`` is the name of a token, or null where nobody logs in."""

    id: str
    created_at: datetime
    action: str
    caller: str | None
    what: str | None
