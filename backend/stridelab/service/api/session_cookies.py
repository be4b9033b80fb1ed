"""The token of the settings, and the cookies that browsers get for any token.

A cookie is the id of a token and a date, signed with a key that is derived from the token of the settings: any number
of API processes accept it, and nothing is stored. It is good as long as both tokens are.
"""

import hashlib
import hmac
from dataclasses import dataclass
from typing import Final

from stridelab.service.auth.callers import ADMIN

COOKIE: Final = "stridelab_session"
SESSION_S: Final = 12 * 3600
SCENARIO_KEY: Final = "scenario-key."
"""Begins a key for one scenario, so that the gate can tell it from a token."""


@dataclass(frozen=True)
class Keys:
    """What is kept of the token of the settings: a hash to compare with, and keys that sign."""

    token_hash: bytes
    cookie_key: bytes
    scenario_signing_key: bytes

    @staticmethod
    def of(token: str) -> "Keys":
        """The keys of ``token``."""
        raw = token.encode("utf-8", "surrogateescape")
        return Keys(*(hashlib.sha256(purpose + raw).digest() for purpose in (b"token:", b"cookie:", b"scenario:")))

    def accepts_token(self, token: str) -> bool:
        """Whether ``token`` is the one of the settings, in a time that does not depend on it."""
        return hmac.compare_digest(Keys.of(token).token_hash, self.token_hash)

    def cookie(self, now_s: float, token_id: str = ADMIN) -> str:
        """A cookie for the holder of a token, good for ``SESSION_S`` from ``now_s`` on."""
        said = f"{token_id}.{int(now_s) + SESSION_S}"
        return f"{said}.{_sign(self.cookie_key, said)}"

    def token_of(self, cookie: str, now_s: float) -> str | None:
        """Id of the token for which ``cookie`` was made; None if it has expired or is not ours."""
        said, _, signature = cookie.rpartition(".")
        if not hmac.compare_digest(_sign(self.cookie_key, said).encode(), signature.encode("utf-8", "surrogateescape")):
            return None
        token_id, _, expires_s = said.partition(".")
        return token_id if int(expires_s) > now_s else None

    def scenario_key(self, now_s: float, token_id: str, scenario_id: str) -> str:
        """A key with which the holder of a token may replace one scenario, and do nothing else, for ``SESSION_S``."""
        said = f"{token_id}.{int(now_s) + SESSION_S}.{scenario_id}"
        return f"{SCENARIO_KEY}{said}.{_sign(self.scenario_signing_key, said)}"

    def token_of_scenario_key(self, key: str, now_s: float, scenario_id: str) -> str | None:
        """Id of the token for which ``key`` was made; None if it has expired, is forged, or names another scenario."""
        said, _, signature = key.removeprefix(SCENARIO_KEY).rpartition(".")
        expected = _sign(self.scenario_signing_key, said)
        if not hmac.compare_digest(expected.encode(), signature.encode("utf-8", "surrogateescape")):
            return None
        token_id, expires_s, named_id = said.split(".", 2)
        return token_id if int(expires_s) > now_s and named_id == scenario_id else None


def _sign(key: bytes, said: str) -> str:
    return hmac.new(key, said.encode("utf-8", "surrogateescape"), hashlib.sha256).hexdigest()
