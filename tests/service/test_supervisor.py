import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from stridelab.errors import InvalidInput
from stridelab.service import supervisor
from stridelab.service.processes import supervised_program
from stridelab.service.processes.supervised_program import BusySignal, SupervisedProgram
from stridelab.service.settings import Settings
from stridelab.service.supervisor import serve


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SupervisedProgram:
    """A program that says a word and ends at once."""
    (tmp_path / "short_lived.py").write_text("print('a word')\n", encoding="utf-8")
    return SupervisedProgram("short_lived", tmp_path / "x.log", {"PYTHONPATH": ":".join([str(tmp_path), *sys.path])})


def until_ended(program: SupervisedProgram) -> None:
    assert program.process is not None
    program.process.wait(30)


def test_what_keeps_dying_is_started_later_and_later(program: SupervisedProgram) -> None:
    calls: list[float] = []
    program.before_restart = lambda: calls.append(time.monotonic())
    pauses = []
    program.keep_running()
    for _ in range(3):
        until_ended(program)
        program.keep_running()
        pauses.append(program.next_start_s - time.monotonic())
        assert program.process is None
        program.next_start_s = 0.0
        program.keep_running()
        assert program.process is not None
    until_ended(program)
    assert pauses == sorted(pauses)
    assert pauses[-1] > 2 * pauses[0]
    assert len(calls) == 3
    assert program.last_log_line() == f"a word (more in {program.log})"


def test_without_log_files_it_writes_where_the_supervisor_does(
    program: SupervisedProgram, capfd: pytest.CaptureFixture[str]
) -> None:
    assert program.log is not None
    file, program.log = program.log, None
    program.keep_running()
    until_ended(program)
    assert capfd.readouterr().out == "a word\n"
    assert program.last_log_line() == "see its output above"
    assert not file.exists()


def test_program_that_has_proven_itself_is_restarted_at_once(program: SupervisedProgram) -> None:
    program.failures = 4
    program.keep_running()
    until_ended(program)
    program.started_at_s -= 31.0
    program.keep_running()
    assert program.failures == 0


def test_log_does_not_grow_for_ever(program: SupervisedProgram, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervised_program, "_MAX_LOG_BYTES", 100)
    assert program.log is not None
    program.log.write_bytes(b"x" * 101)
    program.keep_running()
    until_ended(program)
    assert program.log.read_text(encoding="utf-8") == "a word\n"
    assert program.log.with_suffix(".log.old").stat().st_size == 101
    for size in range(102, 110):
        program.log.write_bytes(b"x" * size)
        program._trim_log()
    log_sizes = {path.name: path.stat().st_size for path in program.log.parent.glob("x.log.*")}
    assert log_sizes == {"x.log.old": 109, **{f"x.log.old.{k}": 110 - k for k in (2, 3, 4, 5)}}


def test_open_address_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as caught:
        serve(Settings(host="0.0.0.0", data_dir=tmp_path / "data", api_token=None))
    assert caught.value.code == "token-needed"
    assert [fault.where for fault in caught.value.faults] == ["STRIDELAB_API_TOKEN"]
    assert not (tmp_path / "data").exists()


def test_programs_share_one_arena_of_memory_unless_it_is_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for stated, used in ((None, "1"), ("4", "4")):
        monkeypatch.delenv("MALLOC_ARENA_MAX", raising=False)
        if stated is not None:
            monkeypatch.setenv("MALLOC_ARENA_MAX", stated)
        data = tmp_path / used
        data.mkdir()
        programs = supervisor._create_programs(Settings(data_dir=data), "", lambda: None, with_worker=True)
        assert len(programs) == 4
        assert {made.environment["MALLOC_ARENA_MAX"] for made in programs} == {used}


def test_a_program_runs_while_it_is_wanted(program: SupervisedProgram) -> None:
    program.is_wanted = lambda: False
    program.keep_running()
    assert program.process is None
    program.is_wanted = lambda: True
    program.module = "http.server"
    program.keep_running()
    assert program.process is not None
    assert program.process.poll() is None
    program.is_wanted = lambda: False
    program.keep_running()
    until_ended(program)
    program.next_start_s = 0.0
    program.keep_running()
    assert program.process is None


def test_help_is_needed_from_high_use_of_the_processor_to_a_rest(
    program: SupervisedProgram, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock_s = used_s = 0.0

    class Measured:
        def __init__(self, pid: int) -> None:
            self.pid = pid

        def cpu_times(self) -> SimpleNamespace:
            return SimpleNamespace(user=used_s, system=0.0)

    monkeypatch.setattr(supervised_program.psutil, "Process", Measured)  # type: ignore[attr-defined]
    monkeypatch.setattr(supervised_program, "queued_s", lambda _: 0.5 * used_s)
    program.process = SimpleNamespace(pid=1)  # type: ignore[assignment]
    signal = BusySignal(program, above=0.4, below=0.1, rest_s=60.0, clock=lambda: clock_s)
    busy = []
    for share in [0.3, 0.5, *[0.2] * 12, *[0.05] * 12, 0.2]:
        busy.append(signal.is_busy())
        clock_s, used_s = clock_s + 5.0, used_s + 5.0 * share / 1.5
    # the share of an interval counts at its end; busy at 10 s (0.5), last above 0.1 at 70 s, so at rest from 130 s on
    assert busy == [False] * 2 + [True] * 24 + [False]
    program.process = SimpleNamespace(pid=2)  # type: ignore[assignment]  # a new process has other times
    clock_s, used_s = clock_s + 5.0, used_s + 100.0
    assert not signal.is_busy()
