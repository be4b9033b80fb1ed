"""Runs tests on changed code in forks of a process that has imported all but the reproduction: 2 s less per mutant.

``python -m support.mutant_judge`` reads a line of JSON per run, ``{"tests": [...], "limit_s": 240}``, and answers with
one: the first test that fails, "too slow", or an empty text. Results of slow functions outside of the reproduction are
shared (``result_memo``): a run with ``"results": FILE`` stores them, later ones use them. A run with ``"lines": FILE``
writes which lines each test executes (``executed_lines``).
"""

import contextlib
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Final

import jaxtyping
import pytest

REPRODUCTION: Final = "stridelab.reproduction"
WALL_PER_PROCESSOR: Final = 4.0
"""The limit is processor time; a process that only waits is stopped after so many times as long."""
BROKEN: Final = 100
TOO_SLOW: Final = "too slow"


def import_all_but_reproduction() -> None:
    """Import what the items import, with types checked as in the tests, but not the items themselves."""
    listing = f"import sys, {REPRODUCTION}.registry; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, check=True).stdout.split()
    jaxtyping.install_import_hook(["stridelab"], "beartype.beartype")
    for name in loaded:
        if name.startswith("stridelab.") and not name.startswith(REPRODUCTION):
            import_module(name)
    assert not any(name.startswith(REPRODUCTION) for name in sys.modules)


def first_failure(tests: Sequence[str], limit_s: float, results: str = "", lines: str = "") -> str:
    """The first test that fails with the code as it is now, ``TOO_SLOW``, or an empty text."""
    with tempfile.TemporaryFile("r+", encoding="utf-8", errors="replace") as output:
        pid = os.fork()
        if pid == 0:
            try:
                _run_tests(tests, limit_s, output.fileno(), results, lines)
            except BaseException:
                traceback.print_exc()
            os._exit(BROKEN)
        status = _wait(pid)
        if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGALRM, signal.SIGKILL):
            return TOO_SLOW
        if os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0:
            return ""
        output.seek(0)
        text = output.read()
    broken_import = "ERROR collecting" in text
    if not broken_import and os.waitstatus_to_exitcode(status) != pytest.ExitCode.TESTS_FAILED:
        raise RuntimeError(text)  # no test ran: this says nothing on the change
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", text, re.MULTILINE)
    return failed.group(1) if failed else text[-200:].replace("\n", " ") or f"status {status}"


def _wait(pid: int) -> int:
    _, status = os.waitpid(pid, 0)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)  # what its tests have started
    return status


def _run_tests(tests: Sequence[str], limit_s: float, output: int, results: str, lines: str) -> None:
    """In the fork, which ends here."""
    os.setsid()
    os.dup2(output, 1)
    os.dup2(output, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s), int(limit_s) + 5))
    signal.alarm(int(WALL_PER_PROCESSOR * limit_s))
    sys.dont_write_bytecode = not results  # the changed module is as long as the original, or nearly so
    options = ["-q", "-p", "no:cacheprovider", "--hypothesis-seed=0", "-W", "ignore::pytest.PytestAssertRewriteWarning"]
    options += ["--timeout=0"]  # the time on the wall says nothing on a change: a busy machine is no failure
    if lines:
        os.environ["STRIDELAB_EXECUTED_LINES"] = lines
        options += ["-p", "support.executed_lines"]
    else:
        options += ["-x"]
    code = pytest.main([*options, *tests])
    if results:
        import_module("support.result_memo").write_results(Path(results))
    sys.stdout.flush()
    os._exit(int(code))


def main() -> None:
    """Answer line by line."""
    import_all_but_reproduction()
    memo = import_module("support.result_memo")  # after the hook that checks types
    memo.store_results()
    memo.warm_caches()
    for line in sys.stdin:
        asked = json.loads(line)
        if (results := Path(asked.get("results", ""))).is_file():
            memo.read_results(results)
        print(json.dumps(first_failure(**asked)), flush=True)
        if results.is_file():
            memo.read_results(results)


if __name__ == "__main__":
    main()
