"""Cache of the token table in an API process, reloaded after ``STALE_S``: the delay of a revocation."""

import asyncio
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any, Final

from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.service.auth import tokens
from stridelab.service.auth.callers import Caller

STALE_S: Final = 2.0


class TokenCache:
    """Looks up the caller of a token. If the database does not answer, no token of the table is valid."""

    def __init__(self, engine: AsyncEngine, clock: Callable[[], float] = time.monotonic) -> None:
        self._engine, self._clock = engine, clock
        self._lock = asyncio.Lock()
        self._by_hash: dict[str, Mapping[str, Any]] = {}
        self._by_id: dict[str, Mapping[str, Any]] = {}
        self._read_at_s = float("-inf")

    async def caller_of_secret(self, secret: str) -> Caller | None:
        """Caller of the token ``secret``; None if it is unknown, revoked or expired."""
        await self._reload_if_stale()
        # looked up by its hash, so the time of the lookup reveals nothing about the secret
        return _caller_of_row(self._by_hash.get(tokens.hash_of(secret)))

    async def caller_of_id(self, token_id: str) -> Caller | None:
        """Caller of the token with this id; None if it is unknown, revoked or expired."""
        await self._reload_if_stale()
        return _caller_of_row(self._by_id.get(token_id))

    def mark_stale(self) -> None:
        """Reload the table at the next lookup."""
        self._read_at_s = float("-inf")

    async def _reload_if_stale(self) -> None:
        async with self._lock:
            now_s = self._clock()
            if now_s - self._read_at_s < STALE_S:
                return
            async with self._engine.connect() as connection:
                rows = await tokens.active_rows(connection)
            self._by_hash = {row["token_hash"]: row for row in rows}
            self._by_id = {row["id"]: row for row in rows}
            self._read_at_s = now_s


def _caller_of_row(row: Mapping[str, Any] | None) -> Caller | None:
    if row is None or (row["expires_at"] is not None and row["expires_at"] <= datetime.now(UTC)):
        return None
    return Caller(row["name"], row["scope"], row["id"])
