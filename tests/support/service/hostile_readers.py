"""Readers of uploads that a file has taken over.

Each attempt of such a reader returns whether it worked or which error it met. Those of bulk uploads report false facts.
"""

import ctypes
import encodings.idna  # noqa: F401 (a connection needs it, and the attempt shall get as far as the kernel)
import errno
import importlib
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stridelab.errors import StridelabError
from stridelab.service.kinds import read_terrain
from stridelab.service.kinds.robots.upload import ReadRobotTask, read_robot
from stridelab.service.processes.child import limit_memory

DONE = "done"


def read_and_measure(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """Read an uploaded robot as the service does: the code of its refusal, processor time and peak memory."""
    return _measure(lambda: read_robot(ReadRobotTask.model_validate(task), folder, progress))


def read_terrain_and_measure(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """Read an uploaded terrain as the service does: as ``read_and_measure``."""
    return _measure(lambda: read_terrain.run(read_terrain.ReadTerrainTask.model_validate(task), folder, progress))


def _measure(read: Callable[[], object]) -> dict[str, Any]:
    code = None
    began_s, _ = _processor_s_and_peak_bytes()
    try:
        read()
    except StridelabError as refusal:
        code = refusal.code
    ended_s, peak_bytes = _processor_s_and_peak_bytes()
    return {"code": code, "processor_s": ended_s - began_s, "peak_bytes": peak_bytes}


def _processor_s_and_peak_bytes() -> tuple[float, int]:
    """Processor time of this process and of its own children, and the largest resident memory of any of them."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used), 1024 * max(one.ru_maxrss for one in used)


def attempts(task: dict[str, Any], folder: Path, _progress: Any) -> dict[str, str]:
    """Every attempt by name; ``task`` says where the other files, ports and processes are."""
    other, port, parent = Path(task["other"]), int(task["port"]), int(task["parent"])
    tries: dict[str, Callable[[], object]] = {
        "read /etc/passwd": Path("/etc/passwd").read_bytes,
        "read another file": other.read_bytes,
        "read it through /proc": lambda: Path("/proc/self/root", str(other).lstrip("/")).read_bytes(),
        "list another folder": lambda: list(other.parent.iterdir()),
        "write another file": lambda: other.write_bytes(b"changed"),
        "make another file": lambda: (other.parent / "new").write_bytes(b"new"),
        "truncate another file": lambda: os.truncate(other, 0),
        "remove another file": (other.parent / "spare").unlink,
        "link another file": lambda: os.link(other, folder / "hard"),
        "lead to another file": lambda: (folder / "soft").symlink_to(other),
        "read the environment of others": lambda: Path(f"/proc/{parent}/environ").read_bytes(),
        "read commands of others": lambda: Path(f"/proc/{parent}/cmdline").read_bytes(),
        "write into Python": lambda: Path(os.__file__).open("ab").close(),
        "connect over TCP": lambda: socket.create_connection(("127.0.0.1", port), timeout=2.0).close(),
        "send over UDP": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"x", ("127.0.0.1", port)),
        "connect over IPv6": lambda: socket.socket(socket.AF_INET6, socket.SOCK_STREAM).close(),
        "connect to the database's socket": lambda: _unix(task["unix"]),
        "listen": lambda: socket.create_server(("127.0.0.1", 0)).close(),
        "run a program": lambda: subprocess.run([sys.executable, "-c", ""], check=True),
        "become a program": lambda: _in_a_fork(lambda: os.execv(sys.executable, [sys.executable, "-c", ""])),
        "run a program in a thread": _in_a_thread(
            lambda: os.posix_spawn(sys.executable, [sys.executable, "-c", ""], {})
        ),
        "watch another process": lambda: _libc("ptrace", 16, parent, 0, 0),
        "end another process": lambda: os.kill(parent, signal.SIGCONT),
        "limit another process": lambda: resource.prlimit(parent, resource.RLIMIT_CORE),
        "leave its group": lambda: _in_a_fork(os.setsid),
        "make a namespace": lambda: _libc("unshare", 0x10000000),
        "mount": lambda: _mount_for_a_moment(folder),
        "open an io_uring": lambda: _libc("syscall", 425, 1, None),
    }
    return {name: outcome(act) for name, act in tries.items()}


def necessities(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """What every reader needs: its folder, temporary files, threads, forks, random numbers, modules, its limits."""
    (folder / "sub").mkdir()
    (folder / "sub" / "result").write_text("42")
    (folder / "sub" / "result").rename(folder / "result")
    (folder / "sub").rmdir()
    with tempfile.TemporaryDirectory(prefix="c3d-") as own:
        (Path(own) / "part").write_text("x")
        inside = Path(own).is_relative_to(folder)
    threads: list[int] = []
    thread = threading.Thread(target=lambda: threads.append(1))
    thread.start()
    thread.join()
    if task["import"]:
        importlib.import_module("colorsys")  # which nothing has imported yet

    def reserve_too_much() -> None:
        limit_memory(64)
        bytearray(32 << 20)
        try:
            bytearray(128 << 20)
        except MemoryError:
            return
        raise OSError(errno.EEXIST, "there is no limit")

    progress(0.5, "half")
    return {
        "result": (folder / "result").read_text(),
        "temporary": inside,
        "threads": len(threads),
        "random": len(os.urandom(8)),
        "null": outcome(lambda: Path("/dev/null").write_bytes(b"x")),
        "fork": outcome(lambda: _in_a_fork(reserve_too_much)),
        "no_new_privileges": _status("NoNewPrivs"),
        "capabilities": int(_status("CapEff"), 16),
        "user": os.geteuid(),
        "groups": os.getgroups(),
        "core": resource.getrlimit(resource.RLIMIT_CORE)[0],
        "limited": resource.getrlimit(resource.RLIMIT_AS)[0] > 0,
    }


def serve_a_moment(_task: dict[str, Any], _folder: Path, _progress: Any) -> dict[str, str]:
    """What the recorder of a plan needs, and what it does not."""
    return {
        "listen": outcome(lambda: socket.create_server(("127.0.0.1", 0)).close()),
        "listen on a port of its choice": outcome(lambda: socket.create_server(("127.0.0.1", 47123)).close()),
        "connect": outcome(_connect_to_itself),
        "send over UDP": outcome(lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).close()),
        "open a local socket": outcome(lambda: socket.socket(socket.AF_UNIX).close()),
        "run a program": outcome(lambda: subprocess.run([sys.executable, "-c", "pass"], check=True)),
        "a program reads": outcome(
            lambda: subprocess.run([sys.executable, "-c", "open('/etc/passwd')"], check=True, stderr=subprocess.DEVNULL)
        ),
    }


def outcome(act: Callable[[], object]) -> str:
    """``done``, or the name of the error number."""
    try:
        act()
    except subprocess.CalledProcessError:
        return "failed"
    except OSError as error:
        return errno.errorcode.get(error.errno or 0, type(error).__name__)
    return DONE


def _connect_to_itself() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        socket.create_connection(server.getsockname(), timeout=2.0).close()


def _unix(path: str) -> None:
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(path)


def _in_a_fork(act: Callable[[], object]) -> None:
    pid = os.fork()
    if pid == 0:
        code = 0
        try:
            act()
        except OSError as error:
            code = error.errno or 255
        os._exit(code)
    if code := os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]):
        raise OSError(code, "in a fork")


def _in_a_thread(act: Callable[[], object]) -> Callable[[], None]:
    def run() -> None:
        failures: list[OSError] = []

        def inside() -> None:
            try:
                act()
            except OSError as error:
                failures.append(error)

        thread = threading.Thread(target=inside)
        thread.start()
        thread.join()
        if failures:
            raise failures[0]

    return run


def _libc(name: str, *arguments: Any) -> None:
    function = getattr(ctypes.CDLL(None, use_errno=True), name)
    function.restype = ctypes.c_long
    if function(*arguments) < 0:
        raise OSError(ctypes.get_errno(), name)


def _mount_for_a_moment(folder: Path) -> None:
    """Mount a file system and take it away: where root may do so, it would keep the folder from being removed."""
    _libc("mount", b"none", bytes(folder), b"tmpfs", 0, None)
    _libc("umount2", bytes(folder), 0)


def _status(field: str) -> str:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(line.split()[1] for line in lines if line.startswith(f"{field}:"))


def claim_another_file(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """A reader of bulk uploads that gives a file of the machine for one that was sent."""
    from stridelab.service.kinds.read_batch.run import parse_batch  # a second of imports that most children do without

    parsed = parse_batch(task, folder, progress)
    parsed["files"][0]["file"] = "/etc/hostname"
    return parsed


def claim_another_hash(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """A reader that reports the hash of another file, which is already stored."""
    from stridelab.service.kinds.read_batch.run import parse_batch  # a second of imports that most children do without

    parsed = parse_batch(task, folder, progress)
    parsed["files"][0]["sha256"] = "ab" * 32
    return parsed
