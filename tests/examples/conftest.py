"""A folder with what the first example writes."""

import runpy
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"

Example = Callable[..., str]
"""``example(number, *arguments)``: runs an example in the folder and returns what it printed."""


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where all examples run; the first of them has been here."""
    examples_folder = tmp_path_factory.mktemp("examples")
    with chdir(examples_folder):
        runpy.run_path(str(EXAMPLES / "01_simulate_a_walk.py"), run_name="__main__")
    return examples_folder


@pytest.fixture
def example(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Example:
    def run(number: str, *arguments: str) -> str:
        (script,) = EXAMPLES.glob(f"{number}_*.py")
        monkeypatch.chdir(folder)
        monkeypatch.setattr("sys.argv", [str(script), *arguments])
        capsys.readouterr()
        runpy.run_path(str(script), run_name="__main__")
        return capsys.readouterr().out

    return run
