"""What a child can still reach once it is confined: attempts in real children, and the filter in an interpreter."""

import asyncio
import json
import os
import socket
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from stridelab.cli.doctor.service import check_sandbox as doctor_says
from stridelab.errors import InvalidInput, Unavailable, UnreadableFile
from stridelab.service.filenames import child_output_file
from stridelab.service.kinds.registry import KINDS
from stridelab.service.processes import confinement, seccomp
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.processes.sandbox import LAYERS, STRICT, KernelFeatures, Sandbox
from stridelab.service.settings import Settings
from support.service.hostile_readers import DONE

KERNEL = KernelFeatures.detect_features()
whole_sandbox = pytest.mark.skipif(bool(KERNEL.missing_layers), reason=f"this kernel lacks {KERNEL.missing_layers}")
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root changes accounts")


@pytest.fixture
def spool(tmp_path: Path) -> Path:
    folder = tmp_path / "spool" / "mine"
    folder.mkdir(parents=True)
    return folder


@pytest.fixture
def others(tmp_path: Path) -> Iterator[dict[str, Any]]:
    """A file, a TCP port and a local socket that a child must not reach."""
    folder = tmp_path / "spool" / "others"
    folder.mkdir(parents=True)
    (folder / "secret").write_text("secret")
    (folder / "spare").write_text("secret")
    path = str(Path(tempfile.gettempdir(), f"stridelab-test-{os.getpid()}"))  # short: a socket's path has 108 bytes
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_UNIX) as local:
        local.bind(path)
        local.listen()
        yield {
            "other": str(folder / "secret"),
            "port": server.getsockname()[1],
            "unix": path,
            "parent": os.getpid(),
        }
    Path(path).unlink()


def run(function: str, task: dict[str, Any], folder: Path, sandbox: Sandbox | None = STRICT) -> IsolatedOutcome:
    async def inside() -> IsolatedOutcome:
        async with IsolatedPool() as pool:
            target = f"support.service.hostile_readers:{function}"
            return await pool.run(target, task, folder, timeout_s=60.0, memory_mb=500, sandbox=sandbox)

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
        return asyncio.run(inside())


@whole_sandbox
def test_a_confined_child_reaches_nothing_but_its_folder(spool: Path, others: dict[str, Any]) -> None:
    outcome = run("attempts", others, spool)
    assert outcome.state == "ok", outcome.log_tail
    assert {name for name, ended in outcome.value.items() if ended == DONE} == set()
    assert set(outcome.value.values()) == {"EACCES", "EPERM", "EXDEV"}, outcome.value  # EXDEV: the link
    assert Path(others["other"]).read_text() == "secret"
    assert sorted(path.name for path in Path(others["other"]).parent.iterdir()) == ["secret", "spare"]


def test_without_a_sandbox_the_same_attempts_succeed(spool: Path, others: dict[str, Any]) -> None:
    """What the test above refuses is the sandbox's doing: nothing else stands in the way."""
    outcomes = run("attempts", others, spool, sandbox=None).value
    reached = {name for name, ended in outcomes.items() if ended == DONE}
    assert reached >= {
        *("read /etc/passwd", "read another file", "list another folder", "write another file", "make another file"),
        *("truncate another file", "remove another file", "link another file", "lead to another file"),
        *("connect over TCP", "connect to the database's socket", "listen", "run a program", "become a program"),
        *("read commands of others", "end another process", "leave its group"),
    }


def test_a_confined_child_does_its_work_within_its_limits(spool: Path) -> None:
    outcome = run("necessities", {"import": True}, spool)
    assert outcome.state == "ok", outcome.log_tail
    value = outcome.value
    assert (spool / "result").read_text() == value["result"] == "42"
    assert (value["temporary"], value["threads"], value["random"], value["null"], value["fork"]) == (
        *(True, 1, 8),
        *(DONE, DONE),
    )
    assert value["no_new_privileges"] == "1"
    assert value["capabilities"] in (0, 1 << 1), "root keeps CAP_DAC_OVERRIDE alone"
    assert (value["core"], value["limited"]) == (0, True)


@whole_sandbox
def test_a_plan_may_listen_and_start_programs_and_nothing_more(spool: Path) -> None:
    outcomes = run("serve_a_moment", {}, spool, Sandbox(programs=True, server=True)).value
    assert outcomes == {
        "listen": DONE,
        "listen on a port of its choice": "EACCES",
        "connect": "EPERM",
        "send over UDP": "EPERM",
        "open a local socket": "EPERM",
        "run a program": DONE,
        "a program reads": "failed",
    }


def test_only_kinds_that_need_it_may_do_more_than_read() -> None:
    more = {name: kind.sandbox for name, kind in KINDS.items() if kind.sandbox != STRICT}
    filming = Sandbox(programs=True, server=True)
    assert more == {
        "plan-motion": filming,
        "plan-receding": filming,
    }


@as_root
@whole_sandbox
def test_a_child_of_root_has_an_account_of_its_own(
    spool: Path, others: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STRIDELAB_CHILD_USER", "nobody")
    (spool / "upload").write_text("mine")
    (spool / "upload").chmod(0o600)
    spool.chmod(0o700)
    above = [folder for folder in spool.parents if folder != Path("/tmp") and folder.is_relative_to("/tmp")]
    modes = {folder: folder.stat().st_mode for folder in above}
    confinement.grant_search_access("nobody", *above)
    assert all(folder.stat().st_mode & 0o066 <= modes[folder] & 0o066 for folder in above), "passed through, not read"
    value = run("necessities", {"import": False}, spool).value  # Python may lie in root's home
    assert value["user"] != 0
    assert value["groups"] == []
    assert value["capabilities"] == 0
    assert (spool / "result").read_text() == "42"
    outcome = run("attempts", others, spool)
    assert outcome.state == "ok", outcome.log_tail
    assert DONE not in outcome.value.values()


def test_an_unknown_account_is_refused() -> None:
    with pytest.raises(InvalidInput, match="no account") as refusal:
        confinement.grant_search_access("nobody-of-this-name", Path("/tmp"))
    assert refusal.value.code == "child-user-unknown"


def test_the_web_server_says_in_one_sentence_why_it_does_not_start(tmp_path: Path) -> None:
    environment = os.environ | {"STRIDELAB_CHILD_USER": "nobody-of-this-name", "STRIDELAB_DATA_DIR": str(tmp_path)}
    ended = subprocess.run(
        [sys.executable, "-m", "stridelab.service.api"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert ended.returncode == 1
    assert ended.stderr == "STRIDELAB_CHILD_USER: there is no account nobody-of-this-name.\n"


@as_root
def test_an_account_that_cannot_get_to_the_data_is_refused_at_the_start(tmp_path: Path) -> None:
    shut = tmp_path / "shut"
    (shut / "data").mkdir(parents=True)
    shut.chmod(0o700)
    with pytest.raises(InvalidInput, match="may not pass through") as refusal:
        confinement.prepare_confinement(Settings(child_user="nobody"), shut / "data")
    assert refusal.value.code == "child-user-cannot-reach"


def test_a_child_that_lacks_a_required_layer_reads_nothing(spool: Path) -> None:
    outcome = run_on(KernelFeatures(0, filters=True), "required", spool)
    assert outcome == ("Unavailable", "sandbox-missing")
    assert list(spool.iterdir()) == []


def run_on(kernel: KernelFeatures, mode: str, folder: Path) -> Any:
    """``confine`` in a process of its own that finds this kernel; then write a file inside and one outside."""
    program = f"""
import json, os, sys
from pathlib import Path
from stridelab.service.processes.sandbox import STRICT, KernelFeatures, confine_process
folder = Path({str(folder)!r})
try:
    confine_process(STRICT, folder, KernelFeatures({kernel.landlock_abi}, {kernel.filters}))
except Exception as error:
    print(json.dumps([type(error).__name__, getattr(error, "code", None)]))
    sys.exit()
outcomes = []
def attempt(act):
    try:
        act(); outcomes.append("done")
    except OSError as error:
        outcomes.append(error.strerror)
(folder / "a").mkdir()
(folder / "a" / "x").write_text("x")
attempt(lambda: (folder / "a" / "x").rename(folder / "x"))
attempt(lambda: Path("/etc/passwd").read_bytes())
import socket
attempt(lambda: socket.socket().close())
print(json.dumps(outcomes))
"""
    environment = os.environ | {"STRIDELAB_SANDBOX": mode}
    run = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True, timeout=60
    )
    return tuple(json.loads(run.stdout))


@whole_sandbox
@pytest.mark.parametrize(
    ("kernel", "renamed", "read", "connected"),
    [
        (KernelFeatures(0, filters=False), "done", "done", "done"),
        (KernelFeatures(0, filters=True), "done", "done", "Operation not permitted"),
        (KernelFeatures(1, filters=False), "Invalid cross-device link", "Permission denied", "done"),
        *(
            (KernelFeatures(abi, filters=False), "done", "Permission denied", "done")
            for abi in range(2, KERNEL.landlock_abi + 1)
        ),
        (KERNEL, "done", "Permission denied", "Operation not permitted"),
    ],
)
def test_each_layer_holds_without_the_others(
    spool: Path, kernel: KernelFeatures, renamed: str, read: str, connected: str
) -> None:
    assert run_on(kernel, "auto", spool) == (renamed, read, connected)


def test_switched_off_it_forbids_nothing(spool: Path) -> None:
    assert run_on(KERNEL, "off", spool) == ("done", "done", "done")


@pytest.mark.parametrize(
    ("kernel", "mode", "missing"),
    [
        (KernelFeatures(0, filters=False), "auto", LAYERS),
        (KernelFeatures(3, filters=True), "auto", ("tcp-ports",)),
        (KernelFeatures(7, filters=True), "off", LAYERS),
        (KernelFeatures(7, filters=True), "auto", ()),
    ],
)
def test_missing_confinement_is_reported_once_at_the_start(
    kernel: KernelFeatures, mode: str, missing: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(KernelFeatures, "detect_features", staticmethod(lambda: kernel))
    settings = Settings(sandbox=mode)
    with capture_logs() as lines:
        confinement.prepare_confinement(settings)
    assert [line["missing"] for line in lines] == ([list(missing)] if missing else [])
    assert set(confinement.active_layers(settings)) == set(LAYERS) - set(missing)
    message = doctor_says(settings)
    assert message.ok
    assert all(name in message.detail for name in LAYERS)


def test_a_service_that_requires_the_sandbox_does_not_start_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(KernelFeatures, "detect_features", staticmethod(lambda: KernelFeatures(3, filters=True)))
    settings = Settings(sandbox="required")
    with pytest.raises(Unavailable, match="tcp-ports") as refusal:
        confinement.prepare_confinement(settings)
    assert refusal.value.code == "sandbox-missing"
    assert not doctor_says(settings).ok


@pytest.mark.parametrize("name", ["../other", "link", "none", "/etc/passwd", "sub"])
def test_the_parent_follows_no_child_out_of_its_folder(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "mine"
    (folder / "sub").mkdir(parents=True)
    (tmp_path / "other").write_text("secret")
    (folder / "link").symlink_to(tmp_path / "other")
    (folder / "sub" / "tracks").write_text("mine")
    assert child_output_file(folder, "sub/tracks").read_text() == "mine"
    with pytest.raises(UnreadableFile) as refusal:
        child_output_file(folder, name)
    assert refusal.value.code == "parser-crashed"


X86_64, AARCH64, I386 = 0xC000003E, 0xC00000B7, 0x40000003
ALLOW, EPERM, ENOSYS = 0x7FFF0000, 0x00050001, 0x00050026


def verdict(code: bytes, audit: int, number: int, *arguments: int) -> int:
    """Run a filter over one system call, as bpf(4) and the kernel's filter.rst say."""
    packet = struct.pack(
        "<iIQ6Q", number if number < 1 << 31 else -1, audit, 0, *arguments, *(0,) * (6 - len(arguments))
    )
    program = [struct.unpack_from("=HBBI", code, at) for at in range(0, len(code), 8)]
    accumulator, at = 0, 0
    while True:
        what, skip_if, skip_unless, operand = program[at]
        at += 1
        if what == 0x20:
            (accumulator,) = struct.unpack_from("<I", packet, operand)
        elif what == 0x54:
            accumulator &= operand
        elif what == 0x06:
            return operand
        else:
            holds = {0x15: accumulator == operand, 0x35: accumulator >= operand, 0x45: bool(accumulator & operand)}[
                what
            ]
            at += skip_if if holds else skip_unless


@pytest.mark.parametrize(("audit", "column"), [(X86_64, 0), (AARCH64, 1)])
def test_the_filter_on_either_architecture(audit: int, column: int) -> None:
    """Numbers from asm/unistd_64.h and asm-generic/unistd.h; the machine of the tests is only one of the two."""

    def ask(name: str, *arguments: int, programs: bool = False, server: bool = False) -> int:
        code = seccomp.filter_program(audit, column, programs=programs, server=server)
        return verdict(code, audit, NUMBERS[name][column], *arguments)

    for name in ("read", "openat", "mmap", "exit_group", "futex", "socketpair", "accept4"):
        assert ask(name) == ALLOW, name
    refused = (
        "socket",
        "connect",
        "bind",
        "execve",
        "execveat",
        "ptrace",
        "io_uring_setup",
        "unshare",
        "setsid",
        "bpf",
    )
    for name in refused:
        assert ask(name) == EPERM, name
    assert ask("clone3") == ENOSYS
    assert ask("clone", 0x11) == ALLOW
    assert ask("clone", 0x3D0F00) == ALLOW  # a thread
    for namespace in (0x00020000, 0x02000000, 0x04000000, 0x08000000, 0x10000000, 0x20000000, 0x40000000):
        assert ask("clone", namespace | 0x11) == EPERM
    assert (ask("prlimit64", 0), ask("prlimit64", 1)) == (ALLOW, EPERM)
    assert (ask("execve", programs=True), ask("socket", 2, 1, programs=True)) == (ALLOW, EPERM)
    assert (ask("socket", 2, 1, server=True), ask("socket", 2, 0x80801, server=True)) == (ALLOW, ALLOW)
    assert {
        ask("socket", family, kind, server=True) for family, kind in ((2, 2), (2, 3), (1, 1), (10, 1), (16, 3))
    } == {EPERM}
    assert (ask("listen", server=True), ask("connect", server=True), ask("execve", server=True)) == (
        ALLOW,
        EPERM,
        EPERM,
    )
    assert ask("sendto", 3, 0, 0, 0x20000000, server=True) == EPERM
    assert ask("sendmsg", 3, 0, 0x20000000, server=True) == EPERM
    assert ask("sendto", 3, 0, 0, 0x4000, server=True) == ALLOW


def test_other_doors_to_the_same_calls_are_shut() -> None:
    code = seccomp.filter_program(X86_64, 0, programs=True, server=True)
    assert verdict(code, I386, 3) == EPERM, "int 0x80"
    assert verdict(code, X86_64, 0x40000000) == EPERM, "the x32 interface"
    assert verdict(code, X86_64, 0) == ALLOW


NUMBERS = {
    "read": (0, 63),
    "openat": (257, 56),
    "mmap": (9, 222),
    "exit_group": (231, 94),
    "futex": (202, 98),
    "socketpair": (53, 199),
    "accept4": (288, 242),
    "socket": (41, 198),
    "connect": (42, 203),
    "bind": (49, 200),
    "listen": (50, 201),
    "sendto": (44, 206),
    "sendmsg": (46, 211),
    "execve": (59, 221),
    "execveat": (322, 281),
    "ptrace": (101, 117),
    "io_uring_setup": (425, 425),
    "unshare": (272, 97),
    "setsid": (112, 157),
    "bpf": (321, 280),
    "clone": (56, 220),
    "clone3": (435, 435),
    "prlimit64": (302, 261),
}
