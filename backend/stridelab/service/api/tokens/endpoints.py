"""Endpoints ``/caller`` (all callers), ``/tokens`` and ``/audit`` (admins; checked here and in the middleware)."""

from typing import Annotated, Any, Final

from fastapi import APIRouter, Body, Depends
from sqlalchemy import select

from stridelab.schemas.access import AuditEntry, CallerFacts, NewToken, TokenFacts, TokenInput
from stridelab.schemas.base import Page
from stridelab.service.api.dependencies import AppParts, CallerOf, require_id_form
from stridelab.service.api.openapi import failure_responses
from stridelab.service.api.pagination import Cursor, Limit, Order, read_page
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.auth import audit, tokens
from stridelab.service.auth.callers import require_scope
from stridelab.service.storage import tables


def _require_admin(caller: CallerOf) -> None:
    require_scope(caller, "admin")


public_router = APIRouter(tags=["access"], route_class=StrictRoute)
router = APIRouter(tags=["access"], route_class=StrictRoute, dependencies=[Depends(_require_admin)])

_EXAMPLE: Final[Any] = {
    "person": {"summary": "A member of the group", "value": {"name": "p07", "scope": "submit", "days": 365}},
}


@public_router.get("/caller", summary="Who calls")
async def read_caller(caller: CallerOf) -> CallerFacts:
    """Name and scope of the caller. On a service without login, the name is null and the scope `admin`."""
    return CallerFacts(name=caller.name, scope=caller.scope)


@router.get("/tokens", summary="List tokens")
async def list_tokens(parts: AppParts, limit: Limit = 50, cursor: Cursor = None) -> Page[TokenFacts]:
    """List tokens, newest first, including revoked and expired ones. Secrets are not stored."""
    rows, following = await read_page(parts.engine, select(tables.token), Order(tables.token), limit, cursor)
    return Page[TokenFacts](items=[tokens.facts_of(row) for row in rows], next=following)


@router.post(
    "/tokens",
    status_code=201,
    summary="Make a token",
    responses=failure_responses(s409="A token of that name has not been revoked (`token-name-taken`)."),
)
async def create_token(
    parts: AppParts, caller: CallerOf, body: Annotated[TokenInput, Body(openapi_examples=_EXAMPLE)]
) -> NewToken:
    """Create a token. `secret` is the token itself; only this response contains it."""
    async with parts.engine.begin() as connection:
        created = await tokens.create_token(connection, body)
        await audit.record_action(connection, caller, "token-created", created.id)
    parts.tokens.mark_stale()
    return created


@router.delete(
    "/tokens/{token_id}",
    summary="Revoke a token",
    responses=failure_responses(s404="No token with this id, or it has been revoked already (`token-not-found`)."),
)
async def revoke_token(parts: AppParts, caller: CallerOf, token_id: str) -> TokenFacts:
    """Revoke a token. This process refuses it at once, others within two seconds. The objects it owns remain."""
    async with parts.engine.begin() as connection:
        revoked = await tokens.revoke_token(connection, require_id_form(token_id, "token"))
        await audit.record_action(connection, caller, "token-revoked", revoked.id)
    parts.tokens.mark_stale()
    return revoked


@router.get("/audit", summary="Audit log")
async def list_audit(parts: AppParts, limit: Limit = 50, cursor: Cursor = None) -> Page[AuditEntry]:
    """List audit entries, newest first: tokens, logins, deletions, cancellations and refused requests."""
    rows, following = await read_page(parts.engine, select(tables.audit), Order(tables.audit), limit, cursor)
    return Page[AuditEntry](items=[AuditEntry(**row) for row in rows], next=following)
