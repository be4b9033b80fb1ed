"""Schemas of tokens and the audit log."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from stridelab.schemas.base import Contract

TokenScope = Literal["read", "submit", "admin"]
"""Permissions of a token, each including the previous ones: read, write and submit jobs, manage tokens."""

TokenName = Annotated[
    str,
    Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,39}$", description="user of the token, who owns its jobs and uploads"),
]


class CallerFacts(Contract):
    """Caller of a request: the name of its token (null without login) and its scope."""

    name: str | None = None
    scope: TokenScope


class TokenInput(Contract):
    """Body of ``POST /tokens``; without ``days``, the token is valid until it is revoked."""

    name: TokenName
    scope: TokenScope = "submit"
    days: Annotated[float | None, Field(gt=0, le=3650, description="validity in days")] = None


class TokenFacts(Contract):
    """A token without its secret, which is not stored."""

    id: str
    name: str
    scope: TokenScope
    created_at: datetime
    expires_at: datetime | None = None
    revoked_at: datetime | None = None


class NewToken(TokenFacts):
    """Response to the creation of a token, the only one that contains ``secret``."""

    secret: str


class AuditEntry(Contract):
    """One action in the audit log; ``caller`` is the name of a token, or null without login."""

    id: str
    created_at: datetime
    action: str
    caller: str | None
    what: str | None
