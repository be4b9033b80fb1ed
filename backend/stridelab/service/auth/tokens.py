"""The table of tokens: made, listed, revoked. Of a token only a hash is kept; it has 256 random bits, so no salt."""

import hashlib
import secrets
import uuid
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from sqlalchemy import func, insert, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Conflict, Fault, NotFound
from stridelab.schemas.access import NewToken, TokenFacts, TokenInput
from stridelab.service.auth.callers import ADMIN
from stridelab.service.storage.tables import token

PREFIX: Final = "stridelab_"
"""Begins every token, so that a scanner for leaked secrets can find one."""


def hash_of(secret: str) -> str:
    """What is kept of a token, in hexadecimal."""
    return hashlib.sha256(b"token:" + secret.encode("utf-8", "surrogateescape")).hexdigest()


async def create(connection: AsyncConnection, wanted: TokenInput) -> NewToken:
    """Make a token. Raises ``Conflict`` (``token-name-taken``) where a token of that name has not been revoked."""
    secret = PREFIX + secrets.token_urlsafe(32)
    expires_at = None if wanted.days is None else datetime.now(UTC) + timedelta(days=wanted.days)
    row = {
        "id": f"t{uuid.uuid4().hex[:12]}",
        "name": wanted.name,
        "scope": wanted.scope,
        "token_hash": hash_of(secret),
        "expires_at": expires_at,
    }
    taken = Conflict(
        "token-name-taken",
        f"There is a token named {wanted.name}; revoke it first, or choose another name.",
        [Fault("name", "taken")],
    )
    if wanted.name == ADMIN:
        raise taken
    try:
        made = (await connection.execute(insert(token).values(row).returning(*token.c))).mappings().one()
    except IntegrityError as error:
        raise taken from error
    return NewToken(**facts_of(made).model_dump(), secret=secret)


async def revoke(connection: AsyncConnection, name_or_id: str) -> TokenFacts:
    """Revoke the live token of that name, or the one with that id.

    Raises ``NotFound`` (``token-not-found``).
    """
    wanted = (token.c.id == name_or_id) | (token.c.name == name_or_id)
    change = update(token).where(wanted, token.c.revoked_at.is_(None)).values(revoked_at=func.now())
    row = (await connection.execute(change.returning(*token.c))).mappings().one_or_none()
    if row is None:
        raise NotFound("token-not-found", "There is no such token, or it has been revoked already.")
    return facts_of(row)


async def live(connection: AsyncConnection) -> list[Mapping[str, Any]]:
    """Rows of all tokens that have not been revoked; they may have expired."""
    rows = await connection.execute(select(token).where(token.c.revoked_at.is_(None)))
    return [dict(row) for row in rows.mappings()]


def facts_of(row: Mapping[Any, Any]) -> TokenFacts:
    """A row without its hash."""
    return TokenFacts(**{name: row[name] for name in TokenFacts.model_fields})


async def every(connection: AsyncConnection) -> list[TokenFacts]:
    """All tokens, oldest first, those that were revoked among them."""
    rows = await connection.execute(select(token).order_by(token.c.created_at, token.c.id))
    return [facts_of(row) for row in rows.mappings()]
