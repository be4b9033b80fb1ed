"""The token of the settings, and the cookies that browsers get for any token.

A cookie is the id of a token and a date, signed with a key that is derived from the token of the settings: any number
of API processes accept it, and nothing is stored. It is good as long as both tokens are.
"""

import hashlib
import hmac
from dataclasses import dataclass
from typing import Final

from stridelab.service.access.callers import ADMIN

COOKIE: Final = "stridelab_session"
SESSION_S: Final = 12 * 3600


@dataclass(frozen=True)
class Keys:
    """What is kept of the token of the settings: a hash to compare with, and a key that signs cookies."""

    token_hash: bytes
    cookie_key: bytes

    @staticmethod
    def of(token: str) -> "Keys":
        """The keys of ``token``."""
        raw = token.encode("utf-8", "surrogateescape")
        return Keys(hashlib.sha256(b"token:" + raw).digest(), hashlib.sha256(b"cookie:" + raw).digest())

    def accepts_token(self, token: str) -> bool:
        """Whether ``token`` is the one of the settings, in a time that does not depend on it."""
        return hmac.compare_digest(Keys.of(token).token_hash, self.token_hash)

    def cookie(self, now_s: float, token_id: str = ADMIN) -> str:
        """A cookie for the holder of a token, good for ``SESSION_S`` from ``now_s`` on."""
        said = f"{token_id}.{int(now_s) + SESSION_S}"
        return f"{said}.{self._sign(said)}"

    def token_of(self, cookie: str, now_s: float) -> str | None:
        """Id of the token for which ``cookie`` was made; None if it has expired or is not ours."""
        said, _, signature = cookie.rpartition(".")
        if not hmac.compare_digest(self._sign(said).encode(), signature.encode("utf-8", "surrogateescape")):
            return None
        token_id, _, expires_s = said.partition(".")
        return token_id if int(expires_s) > now_s else None

    def _sign(self, said: str) -> str:
        return hmac.new(self.cookie_key, said.encode("utf-8", "surrogateescape"), hashlib.sha256).hexdigest()
