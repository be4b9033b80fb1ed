"""Callers, their scopes, and the scope that a request requires."""

from dataclasses import dataclass
from typing import Final

from stridelab.errors import Forbidden
from stridelab.schemas.access import TokenScope

SCOPES: Final[tuple[TokenScope, ...]] = ("read", "submit", "admin")
"""In ascending order: each scope includes those before it."""
ADMIN: Final = "admin"
"""Name and id of the token in the settings."""
_SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
_API: Final = "/api/v1/"
_ADMIN_ONLY: Final = ("tokens", "audit")
_WATCHED: Final = ("stream/markers/", "live/")
"""Paths of open streams of markers and of live robots, which are shown to those who connect: what they send is ignored,
or needs the scope ``submit``."""


@dataclass(frozen=True)
class Caller:
    """Sender of a request; ``name`` is None on a service without login, ``token_id`` is written to logs."""

    name: str | None
    scope: TokenScope
    token_id: str | None = None

    def has_scope(self, scope: TokenScope) -> bool:
        """Whether the caller's scope contains ``scope``."""
        return SCOPES.index(scope) <= SCOPES.index(self.scope)


ANONYMOUS_ADMIN: Final = Caller(None, "admin")
"""Any caller of a service without a token, which only this machine can reach."""
UNAUTHENTICATED: Final = Caller(None, "read")
"""Unauthenticated caller: a request before login, or an internal request of the web pages, which only read."""


def needed_scope(kind: str, method: str, path: str) -> TokenScope:
    """Scope that a request (``kind`` is http or websocket) requires."""
    if not path.startswith(_API):
        return "read"
    if path.removeprefix(_API).partition("/")[0] in _ADMIN_ONLY:
        return "admin"
    reads = method in _SAFE_METHODS if kind == "http" else path.removeprefix(_API).startswith(_WATCHED)
    return "read" if reads else "submit"


def require_scope(caller: Caller, scope: TokenScope) -> None:
    """Raise ``Forbidden`` (``scope-missing``) unless the caller's scope includes ``scope``."""
    if not caller.has_scope(scope):
        raise Forbidden("scope-missing", f"This needs a token of scope '{scope}'; yours has '{caller.scope}'.")


def require_owner(caller: Caller, owner: str | None, what: str) -> None:
    """Raise ``Forbidden`` (``not-owner``) if a ``what`` has another owner and the caller is not an admin."""
    if owner is not None and owner != caller.name and not caller.has_scope("admin"):
        raise Forbidden("not-owner", f"This {what} belongs to another user; only its owner or an admin may do that.")
