"""A service at work for a long time: what its processes, tables and folders hold, and what of it grows.

Rows and files belong to jobs, which are kept for months; so they are counted per accepted job. Memory, open files,
connections and folders for work in progress belong to nobody and must not grow at all.

``make soak``: a whole service at work for half an hour; prints what grew, and fails where it should not have.
"""

import argparse
import asyncio
import os
import statistics
import sys
import time
from dataclasses import dataclass, field
from typing import Any, Final

import psutil
import psycopg
from psycopg import sql

from stridelab.service.jobs.attempt_runner import PROGRESS_S
from support.load.load import ADMIN, NICENESS, TASK, Connection, Load, real_service, users
from support.service.processes import Service, assert_sound, running_service

ROLES: Final = {
    "supervisor": ("support.service.supervisor_entry", "serve"),
    "web server": ("support.service.web_server", "stridelab.service.api"),
    "worker": ("support.service.job_kinds", "stridelab.service.jobs.worker"),
    "viewer": ("support.no_viewer", "stridelab_web.viewer"),
}
ROWS_PER_JOB: Final = {"job": 1, "job_event": 4, "audit": 1}
"""The most rows that a job may leave in each table, and an event for each progress it tells; others must not grow."""
FILES_PER_JOB: Final = 8
MEMORY_MB, FILES, CONNECTIONS = 12.0, 8.0, 4.0
"""What the fitted growth of a process over the run may be, and that of the connections to the database."""
WARM: Final = 1 / 3
"""Part of the run that does not count: pools fill, caches warm up, each call is imported once."""


@dataclass
class Sample:
    """Resources at one moment; memory is the unshared memory of a process in MB."""

    accepted: int
    memory_mb: dict[str, float] = field(default_factory=dict)
    files: dict[str, int] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    connections: int = 0
    blobs: int = 0
    scratch: int = 0
    computed_s: float = 0.0


def look(service: Service, accepted: int) -> Sample:
    """A sample of the service as it is."""
    sample = Sample(accepted)
    for process in service.members():
        try:
            line = process.cmdline()
            role = next((role for role, words in ROLES.items() if any(word in line for word in words)), None)
            if role is not None:
                sample.memory_mb[role] = process.memory_full_info().uss / 1e6
                sample.files[role] = process.num_fds()
        except (psutil.NoSuchProcess, psutil.ZombieProcess):
            continue
    with psycopg.connect(service.url) as connection:
        tables = connection.execute("SELECT tablename FROM pg_tables WHERE schemaname = 'public'").fetchall()
        for (name,) in tables:
            counted = connection.execute(sql.SQL("SELECT count(*) FROM {}").format(sql.Identifier(name))).fetchone()
            sample.rows[name] = counted[0] if counted else 0
        connected = connection.execute("SELECT count(*) FROM pg_stat_activity WHERE backend_type = 'client backend'")
        sample.connections = (connected.fetchone() or (0,))[0]
        spent = connection.execute("SELECT coalesce(sum(extract(epoch FROM finished_at - started_at)), 0) FROM job")
        sample.computed_s = float((spent.fetchone() or (0,))[0])
    sample.blobs = sum(path.is_file() for path in (service.folder / "blobs").rglob("*"))
    # below "work", each worker has a folder of its own, and in it one for each job
    sample.scratch = sum(1 for pattern in ("work/*/*/", "spool/*/files/*/") for _ in service.folder.glob(pattern))
    return sample


def fit_growth(values: list[float]) -> float:
    """Growth from the first to the last value along the line of their median slope (Theil and Sen)."""
    slopes = [(late - early) / (j - i) for i, early in enumerate(values) for j, late in enumerate(values) if j > i]
    return statistics.median(slopes) * (len(values) - 1) if slopes else 0.0


@dataclass
class Soak:
    """``clients`` at a service, in rounds of ``round_s`` with a sample after each, until ``seconds`` are over."""

    service: Service
    tokens: tuple[str, ...]
    task: tuple[str, dict[str, Any]]
    seconds: float
    round_s: float
    clients: int = 10
    samples: list[Sample] = field(default_factory=list)
    accepted: list[str] = field(default_factory=list)
    worse: int = 0

    def run(self) -> None:
        """Run the load; no job runs at the first and last sample. Raises if a job is lost, doubled or stuck."""
        asyncio.run(self._round(0))
        self._settle()
        for number in range(max(3, round(self.seconds / self.round_s))):
            asyncio.run(self._round(1 + number))
            self.samples.append(look(self.service, len(self.accepted)))
        self._settle()

    def _settle(self) -> None:
        assert_sound(self.service.url, self.service.folder / "blobs", self.accepted, timeout_s=600.0)
        self.samples.append(look(self.service, len(self.accepted)))

    async def _round(self, seed: int) -> None:
        load = Load(self.service.port, self.tokens, self.task, self.clients, self.round_s, seed=seed, many=self.clients)
        tally = await load.run()
        self.accepted += tally.accepted
        self.worse += tally.worse
        line = Connection(self.service.port, self.tokens[0])
        await line.call("DELETE", f"/api/v1/jobs/{tally.accepted[0]}?cancel_only=true")
        line.close()

    def table(self) -> str:
        """Markdown: what was there, and by how much it has grown."""
        first, last = self.samples[0], self.samples[-1]
        jobs = max(1, last.accepted - first.accepted)
        lines = ["| what | first | last | growth | bound |", "| --- | --- | --- | --- | --- |"]
        for role, fitted in self._fitted("memory_mb").items():
            lines.append(
                f"| memory of the {role}, MB | {first.memory_mb.get(role, 0):.0f} | {last.memory_mb[role]:.0f} "
                f"| {fitted:+.1f} | {MEMORY_MB:.0f} |"
            )
        for role, fitted in self._fitted("files").items():
            lines.append(
                f"| open files of the {role} | {first.files.get(role, 0)} | {last.files[role]} | {fitted:+.1f} "
                f"| {FILES:.0f} |"
            )
        connections = fit_growth([float(sample.connections) for sample in self._counted()])
        lines.append(
            f"| connections | {first.connections} | {last.connections} | {connections:+.1f} | {CONNECTIONS:.0f} |"
        )
        lines.append(f"| folders of work in progress, all done | {first.scratch} | {last.scratch} | | 0 |")
        for name, rows in sorted(last.rows.items()):
            if rows != first.rows[name]:
                per_job, most = (rows - first.rows[name]) / jobs, self._rows_at_most(name) / jobs
                lines.append(f"| rows of `{name}` | {first.rows[name]} | {rows} | {per_job:.2f} per job | {most:.2g} |")
        files = (last.blobs - first.blobs) / jobs
        lines.append(f"| stored files | {first.blobs} | {last.blobs} | {files:.2f} per job | {FILES_PER_JOB} |")
        return "\n".join(lines)

    def faults(self) -> list[str]:
        """Everything that has grown by more than it may."""
        first, last = self.samples[0], self.samples[-1]
        jobs = last.accepted - first.accepted
        faults = [f"{self.worse} answers with 5xx, or none"] if self.worse else []
        for name, most in (("memory_mb", MEMORY_MB), ("files", FILES)):
            for role, fitted in self._fitted(name).items():
                if fitted > most:
                    faults.append(f"{name} of the {role} has grown by {fitted:.1f}")
        if fit_growth([float(sample.connections) for sample in self._counted()]) > CONNECTIONS:
            faults.append("there are more and more connections")
        if last.scratch > first.scratch:
            faults.append(f"{last.scratch} folders of work in progress, and nothing is in progress")
        for name, rows in last.rows.items():
            if rows - first.rows[name] > self._rows_at_most(name):
                faults.append(f"{rows - first.rows[name]} rows of {name} for {jobs} jobs")
        if last.blobs - first.blobs > FILES_PER_JOB * jobs:
            faults.append(f"{last.blobs - first.blobs} files for {jobs} jobs")
        return faults

    def _rows_at_most(self, name: str) -> float:
        first, last = self.samples[0], self.samples[-1]
        progress_rows = (last.computed_s - first.computed_s) / PROGRESS_S if name == "job_event" else 0.0
        return ROWS_PER_JOB.get(name, 0) * (last.accepted - first.accepted) + progress_rows

    def _counted(self) -> list[Sample]:
        """Samples after the warm-up, taken while there was work."""
        under_way = self.samples[1:-1]
        return under_way[int(WARM * len(under_way)) :]

    def _fitted(self, name: str) -> dict[str, float]:
        counted = [getattr(sample, name) for sample in self._counted()]
        roles = set.intersection(*(set(values) for values in counted))
        return {role: fit_growth([float(values[role]) for values in counted]) for role in ROLES if role in roles}


LIGHT: tuple[str, dict[str, object]] = ("reproduce", {"item": "fig-2.5"})
"""With the tests' worker, a job that computes nothing: many of them pass in little time."""


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="make soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--clients", type=int, default=10)
    parser.add_argument("--round", type=float, default=20.0, help="seconds between two looks")
    parser.add_argument("--light", action="store_true", help="jobs that compute nothing")
    arguments = parser.parse_args()
    light = running_service(STRIDELAB_API_TOKEN=ADMIN)  # the tests' worker, and the real web server's logins
    with light if arguments.light else real_service() as service:
        os.nice(NICENESS)
        task = LIGHT if arguments.light else TASK
        soak = Soak(service, users(service.port, 2), task, 60 * arguments.minutes, arguments.round, arguments.clients)
        began = time.monotonic()
        soak.run()
        minutes = (time.monotonic() - began) / 60
        sys.stdout.write(
            f"{soak.table()}\n\n{len(soak.accepted)} jobs in {minutes:.1f} min, each ended once; "
            f"load {os.getloadavg()[0]:.1f} at the end.\n"
        )
        sys.stdout.flush()
    if faults := soak.faults():
        raise SystemExit("\n".join(faults))


if __name__ == "__main__":
    main()
