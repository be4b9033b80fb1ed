"""Some of the numbered schedules of lost and late COMMITs (``scripts/chaos --schedules all`` runs every one)."""

from pathlib import Path

from support.faults.commits import SCHEDULES, run_all
from support.service.database import TestDatabases

CHOSEN = (
    *(("work", "publish", fault, "SIGTERM") for fault in ("late request", "late answer", "cut after")),
    *(("stop-half-way", "publish", "lost answer", sent) for sent in ("no signal", "SIGSTOP")),
    ("work", "claim", "lost answer", "no signal"),
    ("work", "claim", "cut after", "SIGKILL"),
    ("long-work", "hand back", "lost answer", "no signal"),
)
"""Every kind of fault and of signal, at every transaction."""


def test_lost_and_late_commits_lose_nothing(postgres: TestDatabases, tmp_path: Path) -> None:
    by_name: dict[tuple[str, str, str, str], int] = {
        (each.kind, each.transaction, each.fault, each.signal): n for n, each in enumerate(SCHEDULES)
    }
    reports: list[str] = []
    failed = run_all([by_name[each] for each in CHOSEN], postgres, tmp_path, at_once=len(CHOSEN), say=reports.append)
    assert not failed, "\n".join(reports)
    assert len(reports) == len(CHOSEN)
