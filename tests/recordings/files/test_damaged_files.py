"""Files with one damage each, of all machines and number formats: read, or refused by name, in little memory."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.reader import read_recording
from support.recordings.c3d_files import BLOCK, MACHINES, as_written_by, parameter_at, small_trial, with_integer_samples

MEMORY_MIB = 1024
FRAMES = 30
FORMATS = [f"{machine} {kind}" for machine in MACHINES for kind in ("floats", "integers")]
NO_NUMBER = b"\xff" * 4
Damage = Callable[[bytearray, bytes, str], None]
"""Changes a file; it knows the Intel file with the same offsets and the order of bytes."""


def count(at: int, value: int, content: bytearray, _: bytes, order: str) -> None:
    """Write a count of the header."""
    content[at : at + 2] = value.to_bytes(2, order)


def over(at: int, raw: bytes, content: bytearray, _: bytes, __: str) -> None:
    """Write bytes over others."""
    content[at : at + len(raw)] = raw


def cut(n_bytes: int, content: bytearray, _: bytes, __: str) -> None:
    """Drop the end of the file; a negative number counts from there."""
    del content[n_bytes:]


def parameter(name: str, skip: int, raw: bytes, content: bytearray, intel: bytes, _: str) -> None:
    """Write bytes over a parameter: type, number of dimensions, dimensions, values."""
    at = parameter_at(intel, *name.split(":")) + skip
    content[at : at + len(raw)] = raw


def values(name: str, raw: bytes, content: bytearray, intel: bytes, order: str) -> None:
    """Write bytes over the values of a parameter."""
    parameter(name, 2 + intel[parameter_at(intel, *name.split(":")) + 1], raw, content, intel, order)


def unnamed(name: str, content: bytearray, intel: bytes, _: str) -> None:
    """Give a parameter another name, as if the file lacked it."""
    short = name.split(":")[1].encode()
    at = parameter_at(intel, *name.split(":")) - 2 - len(short)
    content[at : at + len(short)] = b"Q" * len(short)


DAMAGES: dict[str, Damage] = {
    "empty": partial(cut, 0),
    "one byte": partial(cut, 1),
    "half a header": partial(cut, 200),
    "only the header": partial(cut, BLOCK),
    "half of the parameters": partial(cut, BLOCK + 300),
    "no frames behind the parameters": partial(cut, -8 * BLOCK),
    "half of the frames": partial(cut, -4 * BLOCK),
    "another key": partial(over, 1, b"\x51"),
    "parameters far away": partial(over, 0, b"\x14"),
    "no processor": partial(over, BLOCK + 3, b"\x00"),
    "unknown processor": partial(over, BLOCK + 3, b"\x60"),
    "no blocks of parameters": partial(over, BLOCK + 2, b"\x00"),
    "too many blocks of parameters": partial(over, BLOCK + 2, b"\xff"),
    "no points": partial(count, 2, 0),
    "too many points": partial(count, 2, 65535),
    "a few points too many": partial(count, 2, 30),
    "no analog samples": partial(count, 4, 0),
    "too many analog samples": partial(count, 4, 65535),
    "frames backwards": partial(count, 6, 900),
    "no last frame": partial(count, 8, 0),
    "too many frames": partial(count, 8, 60000),
    "saturated frames": partial(count, 8, 65535),
    "scale zero": partial(over, 12, bytes(4)),
    "scale no number": partial(over, 12, NO_NUMBER),
    "data in the header": partial(count, 16, 1),
    "data in the parameters": partial(count, 16, 2),
    "data behind the file": partial(count, 16, 60000),
    "no samples in a frame": partial(count, 18, 0),
    "too many samples in a frame": partial(count, 18, 60000),
    "rate zero": partial(over, 20, bytes(4)),
    "rate no number": partial(over, 20, NO_NUMBER),
    "header of zeros": partial(over, 2, bytes(BLOCK - 2)),
    "header of ones": partial(over, 2, b"\xff" * (BLOCK - 2)),
    "parameters of zeros": partial(over, BLOCK + 4, bytes(BLOCK)),
    "parameters of ones": partial(over, BLOCK + 4, b"\xff" * BLOCK),
    "second block of zeros": partial(over, 2 * BLOCK, bytes(BLOCK)),
    "frames of ones": partial(over, -6 * BLOCK, b"\xff" * BLOCK),
    "unknown type": partial(parameter, "POINT:USED", 0, b"\x07"),
    "nine dimensions": partial(parameter, "POINT:USED", 1, b"\x09"),
    "USED is text": partial(parameter, "POINT:USED", 0, b"\xff\x01\x02"),
    "USED below zero": partial(values, "POINT:USED", b"\xff\xff"),
    "USED zero": partial(values, "POINT:USED", b"\x00\x00"),
    "no USED": partial(unnamed, "POINT:USED"),
    "SCALE no number": partial(values, "POINT:SCALE", NO_NUMBER),
    "no SCALE": partial(unnamed, "POINT:SCALE"),
    "RATE no number": partial(values, "POINT:RATE", NO_NUMBER),
    "RATE zero": partial(values, "POINT:RATE", bytes(4)),
    "no RATE": partial(unnamed, "POINT:RATE"),
    "no LABELS": partial(unnamed, "POINT:LABELS"),
    "LABELS are numbers": partial(parameter, "POINT:LABELS", 0, b"\x01"),
    "LABELS without letters": partial(parameter, "POINT:LABELS", 2, b"\x00"),
    "too few LABELS": partial(parameter, "POINT:LABELS", 3, b"\x02"),
    "too many LABELS": partial(parameter, "POINT:LABELS", 3, b"\xff"),
    "UNITS are noise": partial(values, "POINT:UNITS", b"\x01\xfe"),
    "FRAMES below zero": partial(values, "POINT:FRAMES", b"\x00\x80"),
    "no FRAMES": partial(unnamed, "POINT:FRAMES"),
    "no analog RATE": partial(unnamed, "ANALOG:RATE"),
    "analog RATE no number": partial(values, "ANALOG:RATE", NO_NUMBER),
    "analog USED too large": partial(values, "ANALOG:USED", b"\x7f\x7f"),
    "no analog SCALE": partial(unnamed, "ANALOG:SCALE"),
    "no analog OFFSET": partial(unnamed, "ANALOG:OFFSET"),
    "analog SCALE no number": partial(values, "ANALOG:SCALE", NO_NUMBER),
    "too many plates": partial(values, "FORCE_PLATFORM:USED", b"\x40\x40"),
    "unknown plate": partial(values, "FORCE_PLATFORM:TYPE", b"\x63\x63"),
    "channels that are not there": partial(values, "FORCE_PLATFORM:CHANNEL", b"\x7f" * 8),
    "corners no number": partial(values, "FORCE_PLATFORM:CORNERS", NO_NUMBER * 12),
    "no corners": partial(unnamed, "FORCE_PLATFORM:CORNERS"),
    "no plate channels": partial(unnamed, "FORCE_PLATFORM:CHANNEL"),
}


def whole_files(folder: Path) -> dict[str, bytes]:
    """The same trial in the numbers of every machine, written by the product and converted."""
    write_c3d(folder / "whole.c3d", read_recording(small_trial(folder / "small.c3d", seconds=FRAMES / 100.0)))
    floats = (folder / "whole.c3d").read_bytes()
    return {
        form: as_written_by(form.split()[0], floats if form.endswith("floats") else with_integer_samples(floats, 0.1))
        for form in FORMATS
    }


READER = """
import json, sys
from pathlib import Path
from stridelab.errors import StridelabError
from stridelab.recordings.reader import read_recording

outcomes = {}
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        markers = read_recording(path).markers_m
        outcomes[path.name] = {label: track.round(4).tolist() for label, track in sorted(markers.items())}
    except StridelabError as error:
        outcomes[path.name] = error.code
# not ru_maxrss, which starts at the size of the process that started this one
status = Path("/proc/self/status").read_text()
print(json.dumps([outcomes, int(status.partition("VmHWM:")[2].split()[0]) // 1024]))
"""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """Markers or error code by "format: damage" of every file, all read in one process whose memory is measured."""
    folder = tmp_path_factory.mktemp("damaged")
    files = whole_files(tmp_path_factory.mktemp("whole"))
    intel = files["intel floats"]
    for form, content in files.items():
        order = "big" if form.startswith("sgi") else "little"
        (folder / f"{form}: whole").write_bytes(content)
        for name, damage in DAMAGES.items():
            damaged = bytearray(content)
            damage(damaged, intel, order)
            (folder / f"{form}: {name}").write_bytes(damaged)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run(
        [sys.executable, "-c", READER, str(folder)], env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[-2000:]
    outcome_by_file, peak_mib = json.loads(run.stdout)
    return {**outcome_by_file, "peak MiB": peak_mib}


REFUSED: dict[str, tuple[str, ...]] = {
    "empty-file": ("empty",),
    "unknown-format": ("one byte", "another key"),
    "truncated-file": (
        "half a header",
        "only the header",
        "half of the parameters",
        "no frames behind the parameters",
        "half of the frames",
        "too many frames",
        "saturated frames",
        "data behind the file",
        "parameters of ones",
        "too many LABELS",
    ),
    "absurd-c3d-header": (
        "too many points",
        "too many analog samples",
        "frames backwards",
        "no last frame",
        "header of ones",
    ),
    "c3d-parameters-broken": (
        "no processor",
        "unknown processor",
        "data in the header",
        "header of zeros",
        "data in the parameters",
        "parameters of zeros",
        "second block of zeros",
        "unknown type",
        "nine dimensions",
        "USED is text",
        "RATE no number",
        "LABELS without letters",
        "too few LABELS",
        "analog RATE no number",
        "analog USED too large",
    ),
    "no-markers": ("no LABELS", "LABELS are numbers"),
}
CODES = {damage: code for code, damages in REFUSED.items() for damage in damages}


def test_at_least_sixty_kinds_of_damage_are_tested() -> None:
    assert len(DAMAGES) >= 60
    assert set(CODES) < set(DAMAGES)


@pytest.mark.parametrize("damage", [name for name in DAMAGES if name != "parameters far away"])
def test_a_damaged_file_is_read_right_or_refused_by_name(damage: str, outcomes: dict[str, object]) -> None:
    """What is read is the trial: no damage moves a marker."""
    for form in FORMATS:
        outcome = outcomes[f"{form}: {damage}"]
        if damage in CODES:
            assert outcome == CODES[damage], form
        else:
            assert isinstance(outcome, dict), (form, outcome)
            whole = outcomes[f"{form}: whole"]
            assert isinstance(whole, dict)
            assert set(outcome) == set(whole), form
            for label, track in whole.items():
                np.testing.assert_allclose(outcome[label], track, atol=2e-4, err_msg=f"{form} {label}")


@pytest.mark.parametrize("form", FORMATS)
def test_misplaced_parameters_are_not_invented(form: str, outcomes: dict[str, object]) -> None:
    """The block that is stated lies in the frames of a file of floats, and behind one of integers."""
    expected = "c3d-parameters-broken" if form.endswith("floats") else "truncated-file"
    assert outcomes[f"{form}: parameters far away"] == expected


def test_the_memory_is_bounded(outcomes: dict[str, object]) -> None:
    peak_mib = outcomes["peak MiB"]
    assert isinstance(peak_mib, int)
    assert peak_mib < MEMORY_MIB
