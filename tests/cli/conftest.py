"""The command line as a shell calls it, in a folder of the test's own."""

import sys
from pathlib import Path

import pytest

from stridelab.cli import app
from support.command_line import Ran, Run


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """Run it in ``tmp_path`` until it exits."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(app.signal, "signal", lambda *_: None)  # type: ignore[attr-defined]

    def act(*arguments: object) -> Ran:
        monkeypatch.setattr(sys, "argv", ["stridelab", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            app.main()
        captured = capsys.readouterr()
        return Ran(int(end.value.code or 0), captured.out, captured.err)

    return act
