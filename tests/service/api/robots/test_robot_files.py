"""The files of robots: the process that makes them, and the hash below which they are stored."""

import asyncio
import shutil
from pathlib import Path

import pytest

from stridelab.machine.models_folder import models_dir
from stridelab.robots import card, data_files
from stridelab.service import source_hash
from stridelab.service.api.robots.children import RobotChildren
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.source_hash import source_sha256


def test_the_libraries_leave_memory_when_nothing_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    monkeypatch.setenv("ROBOT_DIARY", str(tmp_path / "diary"))

    async def work() -> tuple[list[bool], str]:
        pool = IsolatedPool()
        children = RobotChildren(pool, tmp_path, 500, sandbox=None, idle_s=0.4)
        alive = []

        async def describe() -> str:
            async with children.run(
                "support.service.robot_children:describe", {"robot": "talos"}, 30.0, lambda *_: None
            ) as (
                value,
                _,
            ):
                alive.append(pool._fork_server is not None)
                return str(value["summary"]["name"])

        await asyncio.gather(describe(), describe())
        while pool._fork_server is not None:
            await asyncio.sleep(0.05)
        name = await describe()
        await children.aclose()
        return [*alive, pool._fork_server is not None], name

    assert asyncio.run(work()) == ([True, True, True, False], "talos")


def test_the_hash_names_all_that_the_files_are_made_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    models = tmp_path / "models"
    shutil.copytree(models_dir() / "robots", models / "robots")
    shutil.copytree(models_dir() / "reachability" / "hrp2", models / "reachability" / "hrp2")
    for module in (card, data_files, source_hash):
        monkeypatch.setattr(module, "models_dir", lambda: models)
    first = source_sha256("hrp2")
    assert first == source_sha256("hrp2")
    mesh = source_hash._mesh_files(data_files.data_files(card.robot_card("hrp2")))
    changed = [next(models.rglob("hrp2*.urdf")), models / "robots" / "hrp2.toml", *mesh]
    changed += list((models / "reachability" / "hrp2").iterdir())
    for path in changed:
        before = path.read_bytes()
        path.write_bytes(before + b"\n")
        assert source_sha256("hrp2") != first, path.name
        path.write_bytes(before)
    assert source_sha256("hrp2") == first
    monkeypatch.setattr(source_hash, "EDITION", 0)
    assert source_sha256("hrp2") != first
