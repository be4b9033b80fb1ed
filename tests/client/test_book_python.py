"""Every Python block of the book runs, against a whole service where it speaks to one."""

import runpy
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from stridelab.machine.models_folder import models_dir
from support.docs.book import PAGES, Block, blocks
from support.service.terrain_files import stairs

PYTHON = [block for page in PAGES for block in blocks(page) if block.language == "python"]
ADDRESS = "http://127.0.0.1:8000"


def laboratory() -> Iterator[tuple[float, list[float], list[float], list[float]]]:
    """What the reader has: time, CoM by geometry, force, moment."""
    for k in range(3):
        yield k / 200, [0.1, 0.0, 0.98], [3.0, -5.0, 690.0], [0.0, -68.0, 0.0]


@pytest.mark.parametrize("block", PYTHON, ids=lambda b: b.place)
def test_a_block_runs(
    block: Block, request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder with the sample walk as ``walk.c3d`` and ``trial.c3d``, and ``stairs.stl`` in millimetres."""
    text = block.text
    if ADDRESS in text:
        text = text.replace(ADDRESS, request.getfixturevalue("service_url"))
    monkeypatch.chdir(tmp_path)
    for name in ("walk.c3d", "trial.c3d"):
        shutil.copyfile(models_dir() / "recordings" / "sample-walk" / "recording.c3d", tmp_path / name)
    (tmp_path / "stairs.stl").write_bytes(stairs(1000.0))
    (tmp_path / "block.py").write_text(text, encoding="utf-8")
    runpy.run_path("block.py", {"laboratory": laboratory}, "__main__")
