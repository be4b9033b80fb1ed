"""Who speaks, and what a request needs."""

from dataclasses import dataclass
from typing import Final

from stridelab.errors import Forbidden
from stridelab.schemas.access import TokenScope

SCOPES: Final[tuple[TokenScope, ...]] = ("read", "submit", "admin")
"""Each allows what stands before it, too."""
ADMIN: Final = "admin"
"""Name and id of the token that the settings hold."""
_SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
_API: Final = "/api/v1/"
_ADMIN_ONLY: Final = ("tokens", "audit")


@dataclass(frozen=True)
class Caller:
    """Who a request comes from; ``name`` is None where nobody logs in, ``token_id`` is what logs may hold."""

    name: str | None
    scope: TokenScope
    token_id: str | None = None

    def may(self, scope: TokenScope) -> bool:
        """Whether the caller's scope contains ``scope``."""
        return SCOPES.index(scope) <= SCOPES.index(self.scope)


ANYBODY: Final = Caller(None, "admin")
"""Whoever calls a service without a token: only this machine reaches it."""
STRANGER: Final = Caller(None, "read")
"""Somebody unknown: before a login; and the pages, which read for whoever has passed the gate."""


def needed_scope(kind: str, method: str, path: str) -> TokenScope:
    """What a request (``kind`` http or websocket) needs: looking, working, or managing tokens."""
    if not path.startswith(_API):
        return "read"
    if path.removeprefix(_API).partition("/")[0] in _ADMIN_ONLY:
        return "admin"
    return "read" if kind == "http" and method in _SAFE_METHODS else "submit"


def require(caller: Caller, scope: TokenScope) -> None:
    """Raise ``Forbidden`` (``scope-missing``) where ``caller`` may not do what ``scope`` stands for."""
    if not caller.may(scope):
        raise Forbidden("scope-missing", f"This needs a token of scope '{scope}'; yours has '{caller.scope}'.")


def require_owner(caller: Caller, owner: str | None, what: str) -> None:
    """Raise ``Forbidden`` (``not-owner``) unless a thing is the caller's, nobody's, or the caller an admin."""
    if owner is not None and owner != caller.name and not caller.may("admin"):
        raise Forbidden("not-owner", f"This {what} belongs to somebody else; its owner or an admin may do that.")
