"""Uploads on their way in when their web server is killed."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import httpx

from support.service.processes import environment, free_port, wait_until

HALF = b"C3D" * 30_000


def healthy(port: int) -> bool:
    try:
        return httpx.get(f"http://127.0.0.1:{port}/api/v1/health", timeout=2.0).status_code == 200
    except httpx.TransportError:
        return False


@contextmanager
def web_server(url: str, data: Path) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """A web server alone, and its port; ended at the end."""
    port = free_port()
    settings = {"STRIDELAB_DATABASE_URL": url, "STRIDELAB_DATA_DIR": str(data), "STRIDELAB_PORT": str(port)}
    with (data / f"{time.monotonic_ns()}.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "support.service.web_server"],
            stdout=log,
            stderr=log,
            env=environment(STRIDELAB_MIN_FREE_DISK_MB="0", STRIDELAB_BODY_TIMEOUT_S="300", **settings),
        )
        try:
            wait_until(lambda: healthy(port), 60.0, "the web server answers")
            yield process, port
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(30)


@contextmanager
def half_an_upload(port: int) -> Iterator[None]:
    """The first half of a file, whose rest does not come."""
    head = (
        b"POST /api/v1/recordings HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nContent-Length: %d\r\n"
        b"Content-Type: multipart/form-data; boundary=b\r\n\r\n" % (port, 3 * len(HALF))
    )
    part = b'--b\r\nContent-Disposition: form-data; name="file"; filename="walk.c3d"\r\n\r\n'
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall(head + part + HALF)
        yield


def arrived(data: Path) -> set[Path]:
    """Files of which more than 1000 bytes have arrived. Folders may vanish while they are listed."""
    uploads = set()
    for folder, _, names in os.walk(data / "spool"):
        file = Path(folder, "trial")
        with suppress(FileNotFoundError):
            if "trial" in names and file.stat().st_size > 1000:
                uploads.add(file)
    return uploads


def test_the_next_start_removes_uploads_of_a_killed_web_server_and_no_others(database_url: str, tmp_path: Path) -> None:
    with web_server(database_url, tmp_path) as (_, living), half_an_upload(living):
        wait_until(lambda: len(arrived(tmp_path)) == 1, 30.0, "half an upload")
        in_use = arrived(tmp_path)
        with web_server(database_url, tmp_path) as (process, port), half_an_upload(port):
            wait_until(lambda: len(arrived(tmp_path)) == 2, 30.0, "half of another")
            process.kill()
            process.wait(30)
            assert len(arrived(tmp_path)) == 2
        with web_server(database_url, tmp_path):
            assert arrived(tmp_path) == in_use
    wait_until(lambda: arrived(tmp_path) == set(), 10.0, "nothing is left by servers that ended in good order")
