"""How many streams there may be, and how fast one may be."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Final

from stridelab.errors import Busy

BURST_S: Final = 2.0
"""So much more than its share may come at once: a client that had to wait catches up."""
RETRY_S: Final = 10.0


class StreamPlaces:
    """The streams of this process, at most ``limit`` at a time."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self.taken = 0

    @contextmanager
    def one(self) -> Iterator[None]:
        """A place, given back at the end. Raises ``Busy`` (``too-many-streams``)."""
        if self.taken >= self._limit:
            raise Busy(
                "too-many-streams",
                f"{self._limit} streams are open already, which is the limit of this service; try again later.",
                RETRY_S,
            )
        self.taken += 1
        try:
            yield
        finally:
            self.taken -= 1


class SampleRate:
    """What a stream may send: ``rate_hz`` samples per second, and ``BURST_S`` of them ahead."""

    def __init__(self, rate_hz: float, clock: Callable[[], float] = monotonic) -> None:
        self._rate_hz, self._clock = rate_hz, clock
        self._left, self._at_s = BURST_S * rate_hz, clock()

    def take(self, samples: int) -> None:
        """Count ``samples``. Raises ``Busy`` (``stream-too-fast``) where they are more than may have come."""
        now_s = self._clock()
        self._left = min(BURST_S * self._rate_hz, self._left + (now_s - self._at_s) * self._rate_hz) - samples
        self._at_s = now_s
        if self._left < 0:
            raise Busy(
                "stream-too-fast",
                f"Samples come faster than the {self._rate_hz:g} per second that this service takes from a stream.",
                RETRY_S,
            )
