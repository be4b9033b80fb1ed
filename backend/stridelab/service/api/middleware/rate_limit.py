"""Rate limit: token buckets in the memory of one API process."""

import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from stridelab.errors import Busy

BURST_S: Final = 10.0
"""Capacity of a bucket, as the number of seconds in which it is filled."""
STRANGER_SHARE: Final = 0.1
"""Fraction of the rate for clients without a valid token, per address."""
_MAX_BUCKETS: Final = 10_000


class RateLimiter:
    """Token buckets by name, each refilled with ``rate_hz`` requests per second; 0 disables the limit."""

    def __init__(self, rate_hz: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate_hz, self._clock = rate_hz, clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def count_request(self, name: str, share: float = 1.0) -> None:
        """Count a request of ``name``. Raises ``Busy`` (``too-many-requests``) if its bucket is empty."""
        rate_hz = self._rate_hz * share
        if rate_hz == 0:
            return
        now_s = self._clock()
        most = max(1.0, rate_hz * BURST_S)
        left, at_s = self._buckets.pop(name, (most, now_s))
        left = min(most, left + (now_s - at_s) * rate_hz)
        allowed = left >= 1.0
        self._buckets[name] = (left - 1.0 if allowed else left, now_s)
        if len(self._buckets) > _MAX_BUCKETS:
            self._buckets.popitem(last=False)  # the least recently used bucket is the fullest
        if not allowed:
            raise Busy(
                "too-many-requests",
                f"More than {rate_hz:g} requests per second; STRIDELAB_RATE_LIMIT_HZ is the limit. Try again later.",
                (1.0 - left) / rate_hz,
            )
