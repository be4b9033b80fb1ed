"""What the processes of a running service that answer browsers cost: processor time and memory."""

from dataclasses import dataclass

import psutil

ANSWERING = {"viewer": "stridelab_web.viewer", "web": "stridelab.service.api"}
"""Modules of the processes that serve pages and scenes."""


@dataclass(frozen=True)
class Consumption:
    """The processes below ``stridelab serve`` that answer browsers."""

    processes: dict[str, psutil.Process]

    @staticmethod
    def of(pid: int | None) -> "Consumption":
        """Those of the service with the process ``pid``."""
        found: dict[str, psutil.Process] = {}
        for process in psutil.Process(pid).children(recursive=True):
            line = process.cmdline()
            for name, module in ANSWERING.items():
                if line[-2:] == ["-m", module] and "stridelab.service.processes.parent_death" not in line:
                    found[name] = process
        assert set(found) == set(ANSWERING), found
        return Consumption(found)

    def cpu_s(self) -> float:
        """Processor seconds of all of them so far."""
        return sum(sum(process.cpu_times()[:2]) for process in self.processes.values())

    def memory_mb(self) -> dict[str, float]:
        """Resident memory by process."""
        return {name: process.memory_info().rss / 1e6 for name, process in self.processes.items()}
