"""Token table: create, list, revoke. Only hashes are stored, without salt, because tokens have 256 random bits."""

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
"""Prefix of every token, by which secret scanners recognise it."""


def hash_of(secret: str) -> str:
    """SHA-256 of a token, in hexadecimal; the form in which it is stored."""
    return hashlib.sha256(b"token:" + secret.encode("utf-8", "surrogateescape")).hexdigest()


async def create_token(connection: AsyncConnection, wanted: TokenInput) -> NewToken:
    """Create a token. Raises ``Conflict`` (``token-name-taken``) if a token of that name has not been revoked."""
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
        stored = (await connection.execute(insert(token).values(row).returning(*token.c))).mappings().one()
    except IntegrityError as error:
        raise taken from error
    return NewToken(**facts_of(stored).model_dump(), secret=secret)


async def revoke_token(connection: AsyncConnection, name_or_id: str) -> TokenFacts:
    """Revoke the active token with this name or id.

    Raises ``NotFound`` (``token-not-found``).
    """
    matches = (token.c.id == name_or_id) | (token.c.name == name_or_id)
    change = update(token).where(matches, token.c.revoked_at.is_(None)).values(revoked_at=func.now())
    row = (await connection.execute(change.returning(*token.c))).mappings().one_or_none()
    if row is None:
        raise NotFound("token-not-found", "There is no such token, or it has been revoked already.")
    return facts_of(row)


async def active_rows(connection: AsyncConnection) -> list[Mapping[str, Any]]:
    """Rows of all tokens that have not been revoked, including expired ones."""
    rows = await connection.execute(select(token).where(token.c.revoked_at.is_(None)))
    return [dict(row) for row in rows.mappings()]


def facts_of(row: Mapping[Any, Any]) -> TokenFacts:
    """Convert a row to ``TokenFacts``, without its hash."""
    return TokenFacts(**{name: row[name] for name in TokenFacts.model_fields})


async def all_tokens(connection: AsyncConnection) -> list[TokenFacts]:
    """All tokens, oldest first, including revoked ones."""
    rows = await connection.execute(select(token).order_by(token.c.created_at, token.c.id))
    return [facts_of(row) for row in rows.mappings()]
