"""A plain mutational fuzzer of the readers: seeded, each input in a child with limits of time and memory.

``python -m support.recordings.fuzzing`` (``make fuzz``) runs every reader for ten minutes. A reader may read an input
or refuse it with an error of the project; anything else is a finding, and its number makes the same input again.
Coverage does not guide it: seeds are small files of every shape, mutations know of the formats' block and number sizes.
"""

import argparse
import io
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.validation import validate  # noqa: F401 (imported before the children are forked)
from stridelab.errors import StridelabError
from stridelab.recordings.reader import read_recording
from stridelab.schemas.scenarios import Scenario
from stridelab.service.api.scenarios.validation import validate_sync
from stridelab.service.api.strict_json import JSON_LIMIT_BYTES, parse_json
from stridelab.service.samples.scenario_bodies import ONE_STEP
from support.recordings.body_model_files import rocking_members
from support.recordings.c3d_files import small_trial
from support.recordings.export_files import mvnx_text

TIMEOUT_S: Final = 10.0
MEMORY_MB: Final = 1024
_NUMBERS: Final = (0, 1, 2, 127, 128, 255, 256, 32767, 32768, 65535, 2**31 - 1, 2**31, 2**32 - 1)
_WORDS: Final = (
    b"nan",
    b"inf",
    b"-1",
    b"1e308",
    b"1e-320",
    b"0",
    b"\t",
    b"\n",
    b"\r",
    b",",
    b'"',
    b"[",
    b"{",
    b"\xff",
    b"9" * 40,
)
_MARKERS: Final = 6
_FRAMES: Final = 20


@dataclass(frozen=True)
class Reader:
    """A fuzzed reader: seed files and the function that reads one."""

    seeds: tuple[bytes, ...]
    read: Callable[[bytes, Path], object]


@dataclass(frozen=True)
class Finding:
    """Input ``number`` of ``reader`` ended as ``how``."""

    reader: str
    number: int
    how: str


def readers(folder: Path) -> dict[str, Reader]:
    """The readers with their seeds, made in ``folder``."""
    plain = small_trial(folder / "plain.c3d", seconds=0.2).read_bytes()
    without = small_trial(folder / "without.c3d", seconds=0.1, with_plate=False).read_bytes()
    trc, mot = trc_text().encode(), _mot().encode()
    members = rocking_members(0.2)
    model, angles = members["subject.osim"], members["rocking_ik.mot"].encode()
    effector_shapes("talos")
    return {
        "c3d": Reader((plain, without), _read_file),
        "trc": Reader((trc,), lambda raw, place: _read_file(_zipped(raw, mot), place)),
        "mot": Reader((mot,), lambda raw, place: _read_file(_zipped(trc, raw), place)),
        "tsv": Reader((_tsv().encode(),), lambda raw, place: _read_file(_zipped(raw, _tsv_forces().encode()), place)),
        "tsv forces": Reader(
            (_tsv_forces().encode(),), lambda raw, place: _read_file(_zipped(_tsv().encode(), raw), place)
        ),
        "csv": Reader((_csv().encode(),), _read_file),
        "mvnx": Reader((mvnx_text(n_frames=8).encode(), mvnx_text(n_frames=8, points=False).encode()), _read_file),
        "osim": Reader((model.encode(),), lambda raw, place: _read_file(_zipped_model(raw, angles), place)),
        "joint angles": Reader((angles,), lambda raw, place: _read_file(_zipped_model(model.encode(), raw), place)),
        "scenario": Reader((Scenario.model_validate(ONE_STEP).model_dump_json().encode(),), _read_scenario),
    }


def _read_file(raw: bytes, folder: Path) -> None:
    path = folder / "input"
    path.write_bytes(raw)
    read_recording(path)


def _read_scenario(raw: bytes, _: Path) -> None:
    parse_json(raw[:JSON_LIMIT_BYTES])
    validate_sync(Scenario.model_validate_json(raw, strict=True))


def _zipped(trc: bytes, mot: bytes) -> bytes:
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w") as packed:
        packed.writestr("a.trc", trc)
        packed.writestr("a.mot", mot)
    return raw.getvalue()


def _zipped_model(model: bytes, angles: bytes) -> bytes:
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w") as packed:
        packed.writestr("a.osim", model)
        packed.writestr("a.mot", angles)
    return raw.getvalue()


def trc_text() -> str:
    names = [f"M{i}" for i in range(_MARKERS)]
    head = [
        "PathFileType\t4\t(X/Y/Z)\ta.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
        f"100\t100\t{_FRAMES}\t{_MARKERS}\tmm",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{i + 1}" for i in range(_MARKERS) for axis in "XYZ"),
        "",
    ]
    rows = [
        [k + 1, k / 100, *(100 * i + 10 * k + j for i in range(_MARKERS) for j in range(3))] for k in range(_FRAMES)
    ]
    return "\n".join(head + ["\t".join(map(str, row)) for row in rows]) + "\n"


def _mot() -> str:
    columns = "\t".join(f"ground_force_{kind}{axis}" for kind in "vp" for axis in "xyz")
    rows = "\n".join(f"{k / 100}\t0\t{700 + k}\t0\t0.1\t0\t0.2" for k in range(_FRAMES))
    return f"grf\nversion=1\nnRows={_FRAMES}\nnColumns=7\nendheader\ntime\t{columns}\n{rows}\n"


def _rows(mark: str, *, frame: bool) -> list[str]:
    cells = [[100 * i + 10 * k + j for i in range(_MARKERS) for j in range(3)] for k in range(_FRAMES)]
    return [mark.join(map(str, [k + 1, 0, *row] if frame else row)) for k, row in enumerate(cells)]


def _tsv() -> str:
    names = "\t".join(f"M{i}" for i in range(_MARKERS))
    head = f"NO_OF_FRAMES\t{_FRAMES}\nNO_OF_MARKERS\t{_MARKERS}\nFREQUENCY\t100\n"
    head += f"DATA_INCLUDED\t3D\nMARKER_NAMES\t{names}\n"
    return head + "\n".join(_rows("\t", frame=False)) + "\n"


def _tsv_forces() -> str:
    head = f"NO_OF_SAMPLES\t{_FRAMES}\nFREQUENCY\t100\nFORCE_PLATE_NAME\tA\n"
    signs = {"POSX_POSY": (1, 1), "NEGX_POSY": (-1, 1), "NEGX_NEGY": (-1, -1), "POSX_NEGY": (1, -1)}
    for corner, (x, y) in signs.items():
        head += "".join(f"FORCE_PLATE_CORNER_{corner}_{a}\t{300 * s}\n" for a, s in zip("XYZ", (x, y, 0), strict=True))
    return head + "\n".join(f"0\t0\t{700 + k}\t0\t0\t0\t0\t{k}\t0" for k in range(_FRAMES)) + "\n"


def _csv() -> str:
    rows = "\n".join(f"{k + 1},0,0,0,{-700 - k},0,0,0,{k},0,0" for k in range(_FRAMES))
    force = ",,P - Force,,,P - Moment,,,P - CoP,,\nFrame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz,Cx,Cy,Cz"
    devices = f"Devices\n100\n{force}\n,,N,N,N,N.mm,N.mm,N.mm,mm,mm,mm\n{rows}\n\n"
    names, axes, units = (",,".join(f"S:M{i}," for i in range(_MARKERS)), "X,Y,Z," * _MARKERS, "mm,mm,mm," * _MARKERS)
    head = f"Trajectories\n100\n,,{names}\nFrame,Sub Frame,{axes}\n,,{units}\n"
    return devices + head + "\n".join(_rows(",", frame=True)) + "\n"


def mutated_input(seed: bytes, random_: random.Random) -> bytes:
    """``seed`` with one to eight changes."""
    raw = bytearray(seed)
    for _ in range(random_.choice((1, 1, 1, 2, 4, 8))):
        at = random_.randrange(len(raw) + 1)
        length = random_.choice((1, 2, 4, 16, 512))
        match random_.randrange(7):
            case 0:
                raw[at : at + 1] = random_.randbytes(1)
            case 1:
                size = random_.choice((1, 2, 4))
                number = random_.choice(_NUMBERS) % 256**size
                raw[at : at + size] = number.to_bytes(size, random_.choice(("little", "big")))
            case 2:
                del raw[at : at + length]
            case 3:
                raw[at:at] = raw[at : at + length] * random_.choice((1, 2, 50))
            case 4:
                raw[at : at + random_.choice((0, 1, 4))] = random_.choice(_WORDS)
            case 5:
                head = random_.randrange(min(len(raw), 1024) + 1)  # headers decide most
                raw[head : head + 1] = random_.randbytes(1)
            case _:
                del raw[at if random_.random() < 0.2 else len(raw) :]
    return bytes(raw)


def inputs(name: str, reader: Reader, first: int = 0) -> Iterator[tuple[int, bytes]]:
    """Endless numbered inputs of a reader; the number alone decides what is in one."""
    number = first
    while True:
        random_ = random.Random(f"{name} {number}")
        yield number, mutated_input(random_.choice(reader.seeds), random_)
        number += 1


def read_in_child(reader: Reader, raw: bytes, folder: Path, *, timeout_s: float = TIMEOUT_S) -> str:
    """``read``, ``refused``, or what went wrong, of one input in a child process."""
    report = folder / "report"
    report.write_bytes(b"")
    child = os.fork()
    if child == 0:
        _child(reader, raw, folder, report)
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        ended_pid, status = os.waitpid(child, os.WNOHANG)
        if ended_pid:
            report_text = report.read_text(encoding="utf-8")
            return report_text if os.WIFEXITED(status) and report_text else f"died of status {status}: {report_text}"
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return f"took longer than {timeout_s:g} s"


def _child(reader: Reader, raw: bytes, folder: Path, report: Path) -> None:
    """Read, write down how it went, and end without anything of the parent's."""
    try:
        used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        limit = used + (MEMORY_MB << 20)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        reader.read(raw, folder)
        report_text = "read"
    except (StridelabError, ValidationError):
        report_text = "refused"
    except BaseException:
        report_text = traceback.format_exc(limit=-4)
    report.write_text(report_text, encoding="utf-8")
    os._exit(0)


def fuzz(
    name: str, reader: Reader, folder: Path, *, count: int, seconds: float, first: int = 0
) -> tuple[dict[str, int], list[Finding]]:
    """Run inputs from ``first`` on for ``count`` or ``seconds``; return counts by outcome, and the failures."""
    ends = time.monotonic() + seconds
    counts = {"read": 0, "refused": 0}
    findings: list[Finding] = []
    for number, raw in inputs(name, reader, first):
        if number >= first + count or time.monotonic() > ends:
            return counts, findings
        how = read_in_child(reader, raw, folder)
        if how in counts:
            counts[how] += 1
        else:
            findings.append(Finding(name, number, how))
    raise AssertionError("inputs are endless")


def main() -> int:
    """Fuzz from the command line; exit code 1 with a finding."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seconds", type=float, default=600.0, help="per reader")
    options.add_argument("--count", type=int, default=sys.maxsize, help="inputs per reader")
    options.add_argument("--first", type=int, default=0, help="number of the first input, where another run ended")
    options.add_argument("--reader", help="only this one")
    arguments = options.parse_args()
    bad = 0
    with tempfile.TemporaryDirectory(prefix="stridelab-fuzz-") as place:
        for name, reader in readers(Path(place)).items():
            if arguments.reader in (None, name):
                counts, findings = fuzz(
                    name, reader, Path(place), count=arguments.count, seconds=arguments.seconds, first=arguments.first
                )
                bad += len(findings)
                print(
                    f"{name}: {counts['read']} read, {counts['refused']} refused, {len(findings)} findings", flush=True
                )
                for finding in findings[:20]:
                    print(f"  input {finding.number}: {finding.how}", flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
