"""Endpoints ``/caller`` (all callers), ``/tokens`` and ``/audit`` (admins; checked here and in the middleware)."""

from typing import Annotated, Any, Final

from fastapi import APIRouter, Body, Depends
from sqlalchemy import select

from stridelab.schemas.access import AuditEntry, CallerFacts, NewToken, TokenFacts, TokenInput
from stridelab.schemas.base import Page
from stridelab.service.api.dependencies import AppParts, CallerOf, known_form
from stridelab.service.api.openapi import failures
from stridelab.service.api.pagination import Cursor, Limit, read_page
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.auth import audit, tokens
from stridelab.service.auth.callers import require
from stridelab.service.storage import tables


def _admin(caller: CallerOf) -> None:
    require(caller, "admin")


anybody = APIRouter(tags=["access"], route_class=StrictRoute)
router = APIRouter(tags=["access"], route_class=StrictRoute, dependencies=[Depends(_admin)])

_EXAMPLE: Final[Any] = {
    "person": {"summary": "A member of the group", "value": {"name": "p07", "scope": "submit", "days": 365}},
}


@anybody.get("/caller", summary="Who calls")
async def read_caller(caller: CallerOf) -> CallerFacts:
    """Name and scope of the caller. On a service without login, the name is null and the scope `admin`."""
    return CallerFacts(name=caller.name, scope=caller.scope)


@router.get("/tokens", summary="List tokens")
async def list_tokens(parts: AppParts, limit: Limit = 50, cursor: Cursor = None) -> Page[TokenFacts]:
    """List tokens, newest first, including revoked and expired ones. Secrets are not stored."""
    rows, following = await read_page(parts.engine, select(tables.token), tables.token, limit, cursor)
    return Page[TokenFacts](items=[tokens.facts_of(row) for row in rows], next=following)


@router.post(
    "/tokens",
    status_code=201,
    summary="Make a token",
    responses=failures(s409="A token of that name has not been revoked (`token-name-taken`)."),
)
async def create_token(
    parts: AppParts, caller: CallerOf, body: Annotated[TokenInput, Body(openapi_examples=_EXAMPLE)]
) -> NewToken:
    """Create a token. `secret` is the token itself; only this response contains it."""
    async with parts.engine.begin() as connection:
        created = await tokens.create(connection, body)
        await audit.note(connection, caller, "token-created", created.id)
    parts.tokens.forget()
    return created


@router.delete(
    "/tokens/{token_id}",
    summary="Revoke a token",
    responses=failures(s404="No token with this id, or it has been revoked already (`token-not-found`)."),
)
async def revoke_token(parts: AppParts, caller: CallerOf, token_id: str) -> TokenFacts:
    """Revoke a token. This process refuses it at once, others within two seconds. The objects it owns remain."""
    async with parts.engine.begin() as connection:
        revoked = await tokens.revoke(connection, known_form(token_id, "token"))
        await audit.note(connection, caller, "token-revoked", revoked.id)
    parts.tokens.forget()
    return revoked


@router.get("/audit", summary="Audit log")
async def list_audit(parts: AppParts, limit: Limit = 50, cursor: Cursor = None) -> Page[AuditEntry]:
    """List audit entries, newest first: tokens, logins, deletions, cancellations and refused requests."""
    rows, following = await read_page(parts.engine, select(tables.audit), tables.audit, limit, cursor)
    return Page[AuditEntry](items=[AuditEntry(**row) for row in rows], next=following)
