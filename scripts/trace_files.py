"""How many files and functions run for three common requests; the record is in docs/trace.md.

    estimate   ``stridelab estimate`` on the sample walk
    upload     upload of the sample walk to a running service, ``estimate-com``, result
    plan       ``stridelab plan long-stride --replay``

A profiler hook (scripts/tracing/sitecustomize.py) notes every function at its first call, in all processes. Class
bodies and module level code do not count. Usage: scripts/trace [estimate upload plan]
"""

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from stridelab.client import Client, ClientError

ROOT = Path(__file__).parents[1]
HOOK = Path(__file__).parent / "tracing"
QUIET_S = 20.0
"""A service prepares robots after its start; that is over by then."""
SAMPLE = ROOT / "models" / "recordings" / "sample-walk" / "recording.c3d"


class Traced(NamedTuple):
    """Distinct files of the project and distinct functions that ran."""

    files: int
    functions: int


def environment(folder: Path) -> Mapping[str, str]:
    """Environment of a traced process."""
    paths = os.pathsep.join([str(HOOK), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    return {**os.environ, "STRIDELAB_TRACE": str(folder), "PYTHONPATH": paths}


def traced(work: Callable[[Mapping[str, str], Path], None]) -> Traced:
    """Run ``work`` and count what its processes noted."""
    with tempfile.TemporaryDirectory() as notes, tempfile.TemporaryDirectory() as out:
        (Path(notes) / "on").touch()
        work(environment(Path(notes)), Path(out))
        lines = {line for file in Path(notes).iterdir() for line in file.read_text(encoding="utf-8").splitlines()}
    return Traced(len({line.partition("\t")[0] for line in lines}), len(lines))


def command(*arguments: str) -> Callable[[Mapping[str, str], Path], None]:
    """A command of the program, with a folder for its result."""

    def work(env: Mapping[str, str], out: Path) -> None:
        line = [sys.executable, "-m", "stridelab.cli", *arguments, "--out", str(out / "result")]
        subprocess.run(line, env=env, check=True, stdout=subprocess.DEVNULL)

    return work


def upload(env: Mapping[str, str], out: Path) -> None:
    """The way of a recording through a service that is running already: what its start calls does not count."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    url, on = f"http://127.0.0.1:{port}", Path(env["STRIDELAB_TRACE"]) / "on"
    on.unlink()
    settings = {**env, "STRIDELAB_DATA_DIR": str(out / "data"), "STRIDELAB_PORT": str(port)}
    service = subprocess.Popen(
        [sys.executable, "-m", "stridelab.cli", "serve"], env=settings, stdout=subprocess.DEVNULL
    )
    try:
        with Client(url) as client:
            _wait_for(client)
            time.sleep(QUIET_S)
            on.touch()
            recording = client.upload(SAMPLE)
            job = client.submit("estimate-com", {"recording_id": recording.id})
            client.wait(job.id, 120.0)
            client.result(job.id)
    finally:
        service.terminate()
        service.wait(60)


def _wait_for(client: Client) -> None:
    until_s = time.monotonic() + 180.0
    while True:
        try:
            client.health()
        except ClientError:
            if time.monotonic() > until_s:
                raise
            time.sleep(0.5)
        else:
            return


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    runs = {
        "estimate": command("estimate", str(SAMPLE)),
        "upload": upload,
        "plan": command("plan", "long-stride", "--replay"),
    }
    parser.add_argument("requests", nargs="*", help=f"of {', '.join(runs)}")
    for request in parser.parse_args().requests or runs:
        count = traced(runs[request])
        sys.stdout.write(f"| {request} | {count.files} | {count.functions} |\n")
