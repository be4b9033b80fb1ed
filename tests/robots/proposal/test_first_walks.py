"""The script of first walks: what ends otherwise leaves no row, and says how it ended."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[3] / "scripts" / "first_walks.py"
ROBOT = "example-robot-data/go2.urdf"
ROW = {"robot": ROBOT, "search_s": 0.0, "refused": "no", "processor_s": 1.0, "wall_s": 1.0}


@pytest.fixture
def script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script, whose processes print ``ROW``; its sources are one file."""
    spec = importlib.util.spec_from_file_location("first_walks", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sources = tmp_path / "sources"
    sources.mkdir()
    (sources / "walk.py").write_text("before")
    vars(module)["SOURCES"] = sources
    monkeypatch.setattr(sys, "argv", ["first_walks.py", str(tmp_path / "walks"), "--only", "go2"])
    return module


def answer_with(monkeypatch: pytest.MonkeyPatch, code: int, stderr: str = "", changed: Path | None = None) -> list[Any]:
    commands: list[Any] = []

    def end_process(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        commands.append(command)
        if changed is not None:
            changed.write_text("after")
        return subprocess.CompletedProcess(command, code, json.dumps(ROW) + "\n", stderr)

    monkeypatch.setattr(subprocess, "run", end_process)
    return commands


def test_a_robot_with_a_row_of_the_same_sources_is_not_repeated(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = answer_with(monkeypatch, 0)
    script.main()
    script.main()
    assert len(commands) == 1
    (tmp_path / "sources/walk.py").write_text("other")
    script.main()
    rows = [json.loads(line) for line in (tmp_path / "walks/rows.jsonl").read_text().splitlines()]
    assert [row["robot"] for row in rows] == [ROBOT, ROBOT]
    assert rows[0]["sources"] != rows[1]["sources"]


def test_sources_that_change_during_a_walk_leave_no_row(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process imports some modules late: its row would belong to neither state."""
    answer_with(monkeypatch, 0, changed=tmp_path / "sources/walk.py")
    with pytest.raises(SystemExit, match=ROBOT):
        script.main()
    assert not (tmp_path / "walks/rows.jsonl").exists()
    assert "changed meanwhile" in (tmp_path / "walks/go2.log").read_text()


def test_a_fault_of_the_process_is_named_and_its_stacks_are_kept(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stacks = "Fatal Python error: Segmentation fault\n" + "  File deep in a library\n" * 500
    commands = answer_with(monkeypatch, -11, stacks)
    with pytest.raises(SystemExit, match=ROBOT):
        script.main()
    log = (tmp_path / "walks/go2.log").read_text()
    assert log.startswith("ended by SIGSEGV")
    assert stacks in log
    assert "faulthandler" in commands[0]
    assert not (tmp_path / "walks/rows.jsonl").exists()
