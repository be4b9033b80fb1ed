"""Stages of a long run, each with a share of the progress, a wall-clock time and a label on its errors."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from stridelab.errors import Fault, StridelabError

ProgressCallback = Callable[[float, str], None]
"""Called with a fraction from 0 to 1 and a short message."""
Json = dict[str, Any]
"""A JSON object."""
ItemMap = Callable[[Callable[[Json], Json], list[Json]], Iterator[tuple[int, Json | StridelabError]]]
"""``map_items(work, items)`` yields the index and the result of ``work(item)``, or its error, as items finish."""


class Stages:
    """Reports the progress of a run stage by stage; messages have the form ``"<stage>: <activity>"``.

    ``shares`` maps the stages of the run, in order, to their share of the progress in any unit. ``times_s`` holds the
    wall-clock seconds of the completed stages.
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
    def run_stage(self, name: str, activity: str) -> Iterator[ProgressCallback]:
        """Context of one stage; yields a callback for the fraction of the stage from 0 to 1.

        A ``StridelabError`` raised inside gets the additional fault ``stage: <name>``.
        """
        first, share = self._parts[name]

        def report_progress(fraction: float, message: str) -> None:
            self._progress(first + share * min(max(fraction, 0.0), 1.0), f"{name}: {message}")

        started = time.perf_counter()
        report_progress(0.0, activity)
        try:
            yield report_progress
        except StridelabError as error:
            fault = Fault(f"stage: {name}", f"stopped after {time.perf_counter() - started:.1f} s")
            error.faults = (*error.faults, fault)
            raise
        self.times_s[name] = round(time.perf_counter() - started, 3)
