"""Limits on the number of streams and on the sample rate of each."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Final

from stridelab.errors import Busy

BURST_S: Final = 2.0
"""Burst size in seconds of samples, with which a delayed client can catch up."""
RETRY_S: Final = 10.0


class StreamLimiter:
    """Counts the open streams of this process, at most ``limit``."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self.n_open = 0

    @contextmanager
    def reserve_place(self) -> Iterator[None]:
        """Reserve a place for the duration of the context. Raises ``Busy`` (``too-many-streams``)."""
        if self.n_open >= self._limit:
            raise Busy(
                "too-many-streams",
                f"{self._limit} streams are already open, the limit of this service; try again later.",
                RETRY_S,
            )
        self.n_open += 1
        try:
            yield
        finally:
            self.n_open -= 1


class SampleRateLimiter:
    """Token bucket of one stream: ``rate_hz`` samples per second, with a burst of ``BURST_S``."""

    def __init__(self, rate_hz: float, clock: Callable[[], float] = monotonic) -> None:
        self._rate_hz, self._clock = rate_hz, clock
        self._left, self._at_s = BURST_S * rate_hz, clock()

    def count_samples(self, samples: int) -> None:
        """Count ``samples``. Raises ``Busy`` (``stream-too-fast``) if they exceed the rate."""
        now_s = self._clock()
        self._left = min(BURST_S * self._rate_hz, self._left + (now_s - self._at_s) * self._rate_hz) - samples
        self._at_s = now_s
        if self._left < 0:
            raise Busy(
                "stream-too-fast",
                f"Samples arrive faster than {self._rate_hz:g} per second, the limit of this service per stream.",
                RETRY_S,
            )
