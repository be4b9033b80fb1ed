"""Session cookies for browsers, signed with keys that are derived from the admin token of the settings.

A cookie contains the id of a token and an expiry time. It is not stored, so every API process can verify it. It is
valid as long as both its token and the token of the settings are.
"""

import hashlib
import hmac
from dataclasses import dataclass
from typing import Final

from stridelab.service.auth.callers import ADMIN

COOKIE: Final = "stridelab_session"
SESSION_S: Final = 12 * 3600
SCENARIO_KEY: Final = "scenario-key."
"""Prefix of a scenario key, which distinguishes it from a token."""


@dataclass(frozen=True)
class SigningKeys:
    """Values derived from the token of the settings: a hash for comparison, and two signing keys."""

    token_hash: bytes
    cookie_key: bytes
    scenario_signing_key: bytes

    @staticmethod
    def from_token(token: str) -> "SigningKeys":
        """Derive the keys from ``token``."""
        raw = token.encode("utf-8", "surrogateescape")
        return SigningKeys(
            *(hashlib.sha256(purpose + raw).digest() for purpose in (b"token:", b"cookie:", b"scenario:"))
        )

    def accepts_token(self, token: str) -> bool:
        """Whether ``token`` is the one of the settings; compares in constant time."""
        return hmac.compare_digest(SigningKeys.from_token(token).token_hash, self.token_hash)

    def make_cookie(self, now_s: float, token_id: str = ADMIN) -> str:
        """Create a cookie for the token ``token_id``, valid for ``SESSION_S`` from ``now_s``."""
        payload = f"{token_id}.{int(now_s) + SESSION_S}"
        return f"{payload}.{_sign(self.cookie_key, payload)}"

    def token_of(self, cookie: str, now_s: float) -> str | None:
        """Id of the token of ``cookie``; None if the cookie has expired or its signature is invalid."""
        payload, _, signature = cookie.rpartition(".")
        expected = _sign(self.cookie_key, payload)
        if not hmac.compare_digest(expected.encode(), signature.encode("utf-8", "surrogateescape")):
            return None
        token_id, _, expires_s = payload.partition(".")
        return token_id if int(expires_s) > now_s else None

    def make_scenario_key(self, now_s: float, token_id: str, scenario_id: str) -> str:
        """Create a key that permits replacing one scenario, and nothing else, for ``SESSION_S``."""
        payload = f"{token_id}.{int(now_s) + SESSION_S}.{scenario_id}"
        return f"{SCENARIO_KEY}{payload}.{_sign(self.scenario_signing_key, payload)}"

    def token_of_scenario_key(self, key: str, now_s: float, scenario_id: str) -> str | None:
        """Id of the token of ``key``; None if the key has expired, is forged, or is for another scenario."""
        payload, _, signature = key.removeprefix(SCENARIO_KEY).rpartition(".")
        expected = _sign(self.scenario_signing_key, payload)
        if not hmac.compare_digest(expected.encode(), signature.encode("utf-8", "surrogateescape")):
            return None
        token_id, expires_s, named_id = payload.split(".", 2)
        return token_id if int(expires_s) > now_s and named_id == scenario_id else None


def _sign(key: bytes, payload: str) -> str:
    return hmac.new(key, payload.encode("utf-8", "surrogateescape"), hashlib.sha256).hexdigest()
