"""Sandbox of a child process, entered before the child reads untrusted input.

The child keeps access to its folder, to the files of Python and its libraries (read only), and to its open files (the
socket to its parent and its log). It loses access to all other files, the network, other programs and other processes,
in layers that depend on the kernel:

    privileges     no_new_privs; as root also the capabilities, and the account if another one is set
    files          Landlock (``landlock``): files, from ABI 4 on TCP ports, from ABI 6 on signals to others
    system calls   seccomp (``seccomp``): sockets, programs, other processes, rarely used parts of the kernel

If a layer that the kernel supports cannot be set up, the child reads nothing. Imports the standard library and small
modules of this package only, because the fork server imports it, too.
"""

import ctypes
import os
import pwd
import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from stridelab.errors import Unavailable
from stridelab.machine.models_folder import models_dir, robot_folders
from stridelab.service.processes import landlock, seccomp
from stridelab.service.processes.landlock import DEVICE_ACCESS, READ, READ_EXECUTE, READ_FILE, WRITABLE_FOLDER, Rule
from stridelab.service.processes.parent_death import change_user, die_with_parent

MODE_VARIABLE: Final = "STRIDELAB_SANDBOX"
USER_VARIABLE: Final = "STRIDELAB_CHILD_USER"
LAYERS: Final = ("files", "tcp-ports", "system-calls")
_PR_SET_NO_NEW_PRIVS: Final = 38
_CAPABILITIES_V3: Final = 0x20080522
_CAP_DAC_OVERRIDE: Final = 1 << 1
_LIBRARY_PATHS: Final = (
    *("/usr/lib", "/usr/lib64", "/usr/lib32", "/usr/local/lib", "/usr/local/lib64", "/lib", "/lib64", "/usr/share"),
    *("/nix/store", "/gnu/store", "/etc/ld.so.cache", "/etc/ld.so.conf", "/etc/localtime", "/etc/timezone"),
    *("/etc/ssl/openssl.cnf", "/etc/fonts"),
)
_PROGRAM_FOLDERS: Final = ("/usr/bin", "/usr/local/bin", "/bin")
_SYSTEM_FILES: Final = (
    *("/sys/devices/system/cpu", "/sys/devices/system/node", "/sys/fs/cgroup", "/sys/kernel/mm/transparent_hugepage"),
    *("/dev/zero", "/dev/urandom", "/dev/random"),
)
_PROC_FILES: Final = tuple(
    Path("/proc", name)
    for name in (
        *("cpuinfo", "meminfo", "stat", "sys/vm/overcommit_memory"),
        *(f"self/{name}" for name in ("statm", "stat", "status", "task", "maps", "auxv", "cgroup", "mountinfo")),
    )
)
"""Files that libraries read to choose thread counts and memory block sizes; none about other processes."""


def _working_folder() -> Path | None:
    try:
        return Path.cwd()
    except OSError:
        return None


_START_FOLDER: Final = _working_folder()
"""Working folder at the start, which ``python -m`` adds to the module path although it may be a home folder."""


@dataclass(frozen=True)
class Sandbox:
    """Exceptions for a child.

    It may start ``programs`` (under the same limits), be a ``server`` on a TCP port, connect to the TCP port
    ``connects``, read installed files below ``folders``, or read the files ``reads`` of the caller, for which it keeps
    the caller's account.
    """

    programs: bool = False
    server: bool = False
    connects: int | None = None
    reads: Sequence[str] = ()
    folders: Sequence[str] = ()


STRICT: Final = Sandbox()


@dataclass(frozen=True)
class KernelFeatures:
    """Sandbox features of the kernel: the ABI of Landlock (0: none), and system call filters."""

    landlock_abi: int
    filters: bool

    @staticmethod
    def detect_features() -> "KernelFeatures":
        """Features of the running kernel."""
        return KernelFeatures(landlock.abi_version(), seccomp.is_available())

    @property
    def supported_layers(self) -> tuple[str, ...]:
        """Supported layers of ``LAYERS``."""
        has = (self.landlock_abi > 0, self.landlock_abi >= landlock.NETWORK_ABI, self.filters)
        return tuple(name for name, there in zip(LAYERS, has, strict=True) if there)

    @property
    def missing_layers(self) -> tuple[str, ...]:
        """Unsupported layers of ``LAYERS``."""
        return tuple(name for name in LAYERS if name not in self.supported_layers)


def missing_layers_error(missing: tuple[str, ...]) -> Unavailable:
    """Error of a service whose settings require layers that are missing."""
    return Unavailable(
        "sandbox-missing",
        f"{MODE_VARIABLE}=required, and the kernel offers no {', no '.join(missing)} here: use Linux 6.7 or "
        "newer with Landlock "
        "and seccomp, and a container runtime that permits their system calls.",
    )


def confine_process(sandbox: Sandbox, folder: Path | None, kernel: KernelFeatures | None = None) -> None:
    """Confine this process to ``sandbox``; files can then be written in ``folder`` only.

    To be called in a single-threaded process that has imported its libraries and inherits neither secrets nor open
    files. Environment: ``STRIDELAB_SANDBOX`` (``auto``, ``required``, ``off``), ``STRIDELAB_CHILD_USER``.

    Raises ``Unavailable`` (``sandbox-missing``) if all layers are required and one is missing, ``OSError`` or
    ``RuntimeError`` if a layer cannot be set up; the process must then end.
    """
    mode = os.environ.get(MODE_VARIABLE, "auto")
    if mode == "off":
        return
    kernel = kernel or KernelFeatures.detect_features()
    if mode == "required" and kernel.missing_layers:
        raise missing_layers_error(kernel.missing_layers)
    if kernel.landlock_abi and (threads := _thread_count()) > 1:
        raise RuntimeError(f"Landlock would bind one of {threads} threads only")
    if folder is not None:
        os.environ["TMPDIR"] = tempfile.tempdir = str(folder)
    if (user := os.environ.get(USER_VARIABLE)) and os.geteuid() == 0 and not sandbox.reads:
        _change_user(user, folder)
    landlock.pin_paths(_PROC_FILES)
    _drop_privileges()
    if kernel.landlock_abi:
        landlock.restrict_thread(
            _landlock_rules(sandbox, folder),
            may_listen=sandbox.server,
            connects=sandbox.connects,
            version=kernel.landlock_abi,
        )
    if kernel.filters:
        seccomp.install_filter(programs=sandbox.programs, server=sandbox.server, client=sandbox.connects is not None)


def confine_piece(folder: Path) -> None:
    """Confine a process that computes a part of a job on a node of a cluster, without exceptions.

    Raises as ``confine_process`` does.
    """
    confine_process(STRICT, folder)


def _landlock_rules(sandbox: Sandbox, folder: Path | None) -> list[Rule]:
    rules: list[Rule] = [(Path("/dev/null"), DEVICE_ACCESS)]
    rules += [(path, READ) for path in (*map(Path, _SYSTEM_FILES), *_PROC_FILES)]
    rules += [(path, READ_EXECUTE if sandbox.programs else READ) for path in _code_paths(sandbox, folder)]
    if sandbox.programs:  # programs read their own memory below /proc; Landlock denies access to that of others
        rules.append((Path("/proc"), READ_FILE))
    rules += [(Path(file), READ_FILE) for file in sandbox.reads]
    rules += [(Path(shared), READ) for shared in sandbox.folders if Path(shared).is_dir()]
    if folder is not None:
        rules.append((folder, WRITABLE_FOLDER))
    return rules


def _code_paths(sandbox: Sandbox, folder: Path | None) -> list[Path]:
    """Folders and files of Python, the libraries, this project and its data."""
    package = Path(__file__).resolve().parents[2]
    prefixes = {Path(prefix) for prefix in (sys.prefix, sys.exec_prefix, sys.base_prefix, sys.base_exec_prefix)}
    parts = ("lib", "lib64", "share", "pyvenv.cfg", *(("bin",) if sandbox.programs else ()))
    paths = [package, *robot_folders(models_dir()), *(prefix / part for prefix in prefixes for part in parts)]
    paths += [Path(entry) for entry in sys.path if entry and not _contains_other_files(Path(entry), folder)]
    paths += map(Path, _LIBRARY_PATHS)
    if native := os.environ.get("STRIDELAB_NATIVE_PATH"):
        paths.append(Path(native))
    if sandbox.programs:
        paths += map(Path, _PROGRAM_FOLDERS)
        if film := shutil.which("ffmpeg"):
            paths.append(Path(film).resolve())
    return list(dict.fromkeys(paths))


def _contains_other_files(entry: Path, folder: Path | None) -> bool:
    """Whether a folder of the module path contains other files: the start folder, or a parent of ``folder``."""
    return entry == _START_FOLDER or (folder is not None and folder.is_relative_to(entry))


def _change_user(user: str, folder: Path | None) -> None:
    """Change from root to ``user``, who becomes the owner of ``folder``; hard links to files elsewhere are skipped."""
    account = pwd.getpwnam(user)
    if folder is not None:
        for path in (folder, *folder.rglob("*")):
            if path.is_dir() or path.lstat().st_nlink == 1:
                os.chown(path, account.pw_uid, account.pw_gid, follow_symlinks=False)
    parent = os.getppid()
    change_user(user)
    die_with_parent(parent)  # the setting is lost when the account changes


def _drop_privileges() -> None:
    """Set ``no_new_privs`` and drop all capabilities of root except ``CAP_DAC_OVERRIDE``.

    That capability permits access to files whatever their mode; Landlock restricts it to the files of the rules.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None, use_errno=True)
    _require_success(library.prctl(_PR_SET_NO_NEW_PRIVS, *(ctypes.c_ulong(value) for value in (1, 0, 0, 0))))
    header = (ctypes.c_uint32 * 2)(_CAPABILITIES_V3, 0)
    capabilities = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable; and again for the upper 32
    _require_success(library.capget(header, capabilities))
    retained = capabilities[1] & _CAP_DAC_OVERRIDE
    _require_success(library.capset(header, (ctypes.c_uint32 * 6)(retained, retained, 0, 0, 0, 0)))


def _require_success(result: Any) -> None:
    if result != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def _thread_count() -> int:
    try:
        return len(list(Path("/proc/self/task").iterdir()))
    except OSError:
        return 1
