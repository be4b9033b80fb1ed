"""Cores are those that affinity, control groups and the worker's slots give, whatever the machine has."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from stridelab.machine.cores import cores_per_slot, default_slots, limit_cores, usable_cores

NONE = Path("/nonexistent")


@pytest.fixture(autouse=True)
def _machine_of_64(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: set(range(8)))
    yield
    limit_cores(None)


def test_affinity_counts_and_not_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    assert usable_cores(NONE, NONE) == 8
    monkeypatch.delattr(os, "sched_getaffinity")
    assert usable_cores(NONE, NONE) == 64


@pytest.mark.parametrize(
    ("quota", "cores"), [("max 100000", 8), ("200000 100000", 2), ("250000 100000", 2), ("50000 100000", 1), ("", 8)]
)
def test_the_quota_of_version_2_counts(tmp_path: Path, quota: str, cores: int) -> None:
    own, unit = tmp_path / "own", tmp_path / "lab.slice" / "worker.service"
    own.write_text("0::/lab.slice/worker.service\n")
    unit.mkdir(parents=True)
    (unit / "cpu.max").write_text(f"{quota}\n")
    assert usable_cores(tmp_path, own) == cores


def test_the_strictest_group_counts(tmp_path: Path) -> None:
    own, unit = tmp_path / "own", tmp_path / "lab.slice" / "worker.service"
    own.write_text("0::/lab.slice/worker.service\n")
    unit.mkdir(parents=True)
    (unit / "cpu.max").write_text("600000 100000\n")
    (unit.parent / "cpu.max").write_text("300000 100000\n")
    assert usable_cores(tmp_path, own) == 3


@pytest.mark.parametrize("folder", ["cpu", "cpu,cpuacct"])
@pytest.mark.parametrize(("quota_us", "cores"), [(-1, 8), (300_000, 3)])
def test_the_quota_of_version_1_counts(tmp_path: Path, folder: str, quota_us: int, cores: int) -> None:
    """A container sees its group at the root, and the name that it has on the host."""
    own, group = tmp_path / "own", tmp_path / folder
    own.write_text("4:memory:/docker/1f\n3:cpu,cpuacct:/docker/1f\n")
    group.mkdir()
    (group / "cpu.cfs_quota_us").write_text(f"{quota_us}\n")
    (group / "cpu.cfs_period_us").write_text("100000\n")
    assert usable_cores(tmp_path, own) == cores


@pytest.mark.parametrize(("slots", "share"), [(1, 8), (3, 2), (8, 1), (30, 1)])
def test_a_slot_is_a_share_of_the_cores(monkeypatch: pytest.MonkeyPatch, slots: int, share: int) -> None:
    monkeypatch.setattr("stridelab.machine.cores._cgroup_quota_cores", lambda *_: float("inf"))
    assert default_slots() == 7
    assert cores_per_slot(slots) == share
    limit_cores(cores_per_slot(slots))
    assert usable_cores() == share
