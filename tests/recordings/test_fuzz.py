"""A short run of ``make fuzz`` on mutated files, and tests that the fuzzer detects failures."""

import faulthandler
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stridelab.errors import UnreadableFile
from support.recordings.fuzzing import Reader, inputs, read_in_child


def test_no_reader_crashes_on_mutated_files() -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    limits = ["--count", "60", "--seconds", "60"]  # the count decides, also on a slow machine
    command = [sys.executable, "-m", "support.recordings.fuzzing", *limits]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=900, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    lines = ran.stdout.splitlines()
    names = ["c3d", "trc", "mot", "tsv", "tsv forces", "csv", "mvnx", "osim", "joint angles", "scenario"]
    assert [line.partition(":")[0] for line in lines] == names
    for line in lines:  # seeds are good, and mutations matter
        words = line.partition(":")[2].split()
        assert int(words[0]) > 0
        assert int(words[2]) > 0


def crash(_: bytes, __: Path) -> None:
    faulthandler.disable()  # pytest would print where
    os.kill(os.getpid(), signal.SIGSEGV)


def hang(_: bytes, __: Path) -> None:
    time.sleep(60)


def swell(_: bytes, __: Path) -> None:
    bytearray(8 << 30)


def blunder(_: bytes, __: Path) -> None:
    raise KeyError("not an error of ours")


def refuse(_: bytes, __: Path) -> None:
    raise UnreadableFile("unknown-format", "No.")


@pytest.mark.parametrize(
    ("read", "reported"),
    [(crash, "died"), (hang, "longer"), (swell, "MemoryError"), (blunder, "KeyError"), (refuse, "refused")],
)
def test_the_fuzzer_reports_crashes_and_unnamed_errors(read, reported: str, tmp_path: Path) -> None:
    assert reported in read_in_child(Reader((b"x",), read), b"x", tmp_path, timeout_s=3.0)


def test_an_input_can_be_made_again_from_its_number() -> None:
    reader = Reader((b"0123456789" * 9,), refuse)
    generated = inputs("c3d", reader)
    first = [next(generated) for _ in range(5)]
    assert next(inputs("c3d", reader, first=4)) == first[4]
    assert len({raw for _, raw in first}) == 5
