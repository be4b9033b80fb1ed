"""Stages of a long run: each has its share of the progress bar, its time, and its name on whatever goes wrong in it."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from stridelab.errors import Fault, StridelabError

ProgressCallback = Callable[[float, str], None]
"""Called with a fraction from 0 to 1 and a short message."""


class Stages:
    """Tells ``progress`` of one run, stage by stage; messages read ``"<stage>: <what it does>"``.

    ``shares`` gives, in their order, the stages that this run has with the part of the bar that each is worth, in any
    unit. ``times_s`` are the wall-clock seconds of the stages that are done.
    """

    def __init__(self, progress: ProgressCallback, shares: Mapping[str, float]) -> None:
        self._progress = progress
        total, begun = sum(shares.values()), 0.0
        self._parts: dict[str, tuple[float, float]] = {}
        for name, share in shares.items():
            self._parts[name] = (begun / total, share / total)
            begun += share
        self.times_s: dict[str, float] = {}

    @contextmanager
    def at(self, name: str, doing: str) -> Iterator[ProgressCallback]:
        """Do one stage; it is given a callback for its own fraction from 0 to 1.

        An error of this project leaves it with ``stage: <name>`` behind its own faults.
        """
        first, share = self._parts[name]

        def tell(fraction: float, message: str) -> None:
            self._progress(first + share * min(max(fraction, 0.0), 1.0), f"{name}: {message}")

        started = time.perf_counter()
        tell(0.0, doing)
        try:
            yield tell
        except StridelabError as error:
            fault = Fault(f"stage: {name}", f"stopped after {time.perf_counter() - started:.1f} s")
            error.faults = (*error.faults, fault)
            raise
        self.times_s[name] = round(time.perf_counter() - started, 3)
