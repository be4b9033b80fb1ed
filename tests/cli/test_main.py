"""The command line as a user meets it: exit codes, one-line errors, nothing left behind; in one process."""

import subprocess
import sys
from pathlib import Path

import pytest

from stridelab import __version__
from stridelab.cli.results import EXIT_CODES, exit_code
from stridelab.errors import InvalidInput, NotEstimable, StridelabError, Unauthenticated, Unavailable, UnreadableFile
from support.command_line import Run


def test_version_is_that_of_the_package(run: Run) -> None:
    ran = run("version")
    assert (ran.code, ran.out.strip()) == (0, __version__)


def test_help_names_every_command_and_imports_no_numeric_package() -> None:
    code = (
        "import sys; sys.argv = ['stridelab', '--help']\n"
        "from stridelab.cli.app import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'ezc3d', 'pinocchio', 'pyarrow', 'sqlalchemy', 'httpx'}\n"
        "print('HEAVY', sorted(heavy & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip().endswith("HEAVY []")
    assert all(
        name in run.stdout for name in ("serve", "worker", "migrate", "estimate", "simulate", "plan", "demo", "doctor")
    )


BAD_FILES = {
    "empty.c3d": (b"", 3, "empty-file"),
    "text.c3d": (b"time,x,y\n0,1,2\n" * 50, 3, "unknown-format"),
    "zip.c3d": (b"PK\x03\x04 not a zip", 3, "zip-damaged"),
    "head.c3d": (b"\x02\x50" + bytes(600), 3, None),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_file_is_one_clear_line_and_leaves_nothing(run: Run, tmp_path: Path, name: str) -> None:
    content, code, stable_code = BAD_FILES[name]
    (tmp_path / name).write_bytes(content)
    ran = run("estimate", name)
    assert ran.code == code
    first = ran.err.splitlines()[0]
    assert first.startswith("error: ")
    assert stable_code is None or first.endswith(f"({stable_code})")
    assert "Traceback" not in ran.err
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("estimate", "nowhere.c3d"), 3, "there is no such file"),
        (("compare", "."), 3, "it is not a file"),
        (("estimate", "."), 4, "truncated-file"),
        (("estimate", "x.c3d", "--static", "nowhere.c3d"), 3, "nowhere.c3d"),
        (("estimate", "x.c3d", "--height", "171"), 2, "--height"),
        (("estimate", "x.c3d", "--mass", "0"), 2, "--mass"),
        (("estimate", "x.c3d", "--age", "-4"), 2, "--age"),
        (("estimate", "x.c3d", "--height", "nan"), 2, "--height"),
        (("estimate", "x.c3d", "--latency", "soon"), 2, "--latency takes a number"),
        (("estimate", "x.c3d", "--latency", "3"), 2, "--latency"),
        (("estimate", "x.c3d", "--cutoffs", "1"), 2, "--cutoffs takes 2 numbers"),
        (("estimate", "x.c3d", "--window", "1,a"), 2, "--window"),
        (("estimate", "x.c3d", "--marker", "LASI"), 2, "--marker takes NAME=VALUE"),
        (("estimate", "x.c3d", "--method", "magic"), 2, "magic"),
        (("estimate", "x.c3d", "--prior", "plate_force_n"), 2, "--prior takes NAME=VALUE"),
        (("estimate", "x.c3d", "--prior", "plate_force_n=-1"), 2, "--prior: plate_force_n"),
        (("estimate", "x.c3d", "--prior", "wind=1"), 2, "--prior: wind"),
        (("estimate", "x.c3d", "--method", "kalman", "--no-learn"), 2, "smoother"),
        (("simulate", "--duration", "1000"), 2, "--duration"),
        (("simulate", "--noise", "wind=3"), 2, "--noise"),
        (("plan",), 2, "scenario"),
        (("plan", "nowhere.json"), 5, "six-stairs"),
        (("plan", "x.c3d"), 3, "not-json"),
        (("plan", "six-stairs", "--no-whole-body", "--replay"), 2, "--no-whole-body"),
        (("estimate",), 2, "file"),
        (("walk",), 2, "walk"),
        (("migrate",), 2, "STRIDELAB_DATABASE_URL"),
        (("worker",), 2, "STRIDELAB_DATABASE_URL"),
    ],
)
def test_invalid_arguments_are_refused_by_name(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], code: int, message: str
) -> None:
    from stridelab.service.settings import current_settings

    monkeypatch.delenv("STRIDELAB_DATABASE_URL", raising=False)
    current_settings.cache_clear()
    (tmp_path / "x.c3d").write_bytes(b"\x02\x50")
    ran = run(*arguments)
    assert ran.code == code
    assert message in ran.err
    assert "Traceback" not in ran.err
    assert [path.name for path in tmp_path.iterdir()] == ["x.c3d"]


def test_invalid_settings_are_named(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    from stridelab.service.settings import current_settings

    monkeypatch.setenv("STRIDELAB_PORT", "eighty")
    current_settings.cache_clear()
    ran = run("migrate")
    current_settings.cache_clear()
    assert ran.code == 2
    assert "STRIDELAB_PORT" in ran.err


def test_an_existing_output_folder_is_refused_before_any_work(run: Run, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    ran = run("estimate", "nowhere.c3d", "--out", "out")
    assert ran.code == EXIT_CODES[cli_conflict()]
    assert "output-exists" in ran.err


def cli_conflict() -> type[StridelabError]:
    from stridelab.errors import Conflict

    return Conflict


def test_ctrl_c_ends_without_a_traceback(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(**_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("stridelab.cli.demo.run_demo", interrupted)
    ran = run("demo")
    assert (ran.code, ran.out, ran.err) == (130, "", "")


def test_an_error_takes_the_code_of_its_nearest_class() -> None:
    assert exit_code(UnreadableFile("a", "b")) == 3
    assert exit_code(InvalidInput("a", "b")) == 2
    assert exit_code(NotEstimable("a", "b")) == 4
    assert exit_code(Unavailable("a", "b")) == 10
    assert exit_code(Unauthenticated("a", "b")) == 9
    assert exit_code(StridelabError("a", "b")) == 1


def test_an_unreachable_service_is_reported(run: Run, tmp_path: Path) -> None:
    (tmp_path / "x.c3d").write_bytes(b"\x02\x50")
    ran = run("estimate", "x.c3d", "--server", "http://127.0.0.1:9")
    assert ran.code == 10
    assert "service-unreachable" in ran.err
    assert [path.name for path in tmp_path.iterdir()] == ["x.c3d"]


def test_the_estimation_imports_neither_signal_processing_nor_a_database() -> None:
    code = (
        "import sys, stridelab.cli.app, stridelab.service.kinds.estimate_com.run\n"
        "print(*sorted({'scipy.signal', 'scipy.stats', 'sqlalchemy', 'pydantic_settings', 'httpx'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []


def test_tables_and_tasks_of_an_estimation_import_nothing_that_they_do_not_use() -> None:
    code = (
        "import sys, stridelab.service.kinds.estimate_com.run\n"
        "unused = {'pyarrow.compute', 'stridelab.schemas.plans', 'stridelab.schemas.scenarios'}\n"
        "print(*sorted(unused & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []


def test_the_collector_does_not_run_while_a_command_imports() -> None:
    code = (
        "import gc, stridelab, sys\n"
        "started = []\n"
        "gc.callbacks.append(lambda phase, _: started.append(phase))\n"
        "from stridelab.cli.__main__ import main\n"
        "sys.argv = ['stridelab', 'version']\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print('collections', len(started))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split()[-2:] == ["collections", "0"]
