"""seccomp: system call filter of a process. The kernel runs the filter before each system call.

The filter is a classic Berkeley packet filter over ``struct seccomp_data``; see seccomp(2) and
Documentation/userspace-api/seccomp_filter.rst of the kernel. A refused call fails with EPERM, so that a library which
can work without it continues. Imports the standard library only.

The filter is a deny list. An allow list would be tighter, but would break with new versions of the C library; the
purpose of the deny list (no network, programs, other processes, or error-prone parts of the kernel) changes rarely.
"""

import ctypes
import errno
import platform
import struct
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

_FILTER_MODE, _ACTION_AVAILABLE, _ALL_THREADS = 1, 2, 1  # operations and flag of seccomp(2)
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_NUMBER_AT, _ARCHITECTURE_AT, _ARGUMENTS_AT = 0, 4, 16
_X32_CALLS: Final = 0x40000000
"""First number of the x32 interface of x86_64, a second table of the same calls."""
_NAMESPACE_FLAGS: Final = 0x7E020000
"""CLONE_NEWNS, CLONE_NEWUSER etc.: a user namespace gives its first process all capabilities inside."""
_MSG_FASTOPEN: Final = 0x20000000
"""MSG_FASTOPEN: sending opens a connection."""
_AF_INET, _SOCK_STREAM = 2, 1


@dataclass(frozen=True)
class _Machine:
    """AUDIT_ARCH value of an architecture (linux/audit.h), and its column in ``_CALLS``."""

    audit: int
    column: int


_MACHINES: Final = {"x86_64": _Machine(0xC000003E, 0), "aarch64": _Machine(0xC00000B7, 1)}

_CALLS: Final[Mapping[str, tuple[int, int]]] = {
    "socket": (41, 198),
    "connect": (42, 203),
    "bind": (49, 200),
    "listen": (50, 201),
    "sendto": (44, 206),
    "sendmsg": (46, 211),
    "sendmmsg": (307, 269),
    "execve": (59, 221),
    "execveat": (322, 281),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "kcmp": (312, 272),
    "pidfd_getfd": (438, 438),
    "process_madvise": (440, 440),
    "prlimit64": (302, 261),
    "setsid": (112, 157),
    "setpgid": (109, 154),
    "shmget": (29, 194),
    "shmat": (30, 196),
    "msgget": (68, 186),
    "semget": (64, 190),
    "mq_open": (240, 180),
    "clone": (56, 220),
    "clone3": (435, 435),
    "unshare": (272, 97),
    "setns": (308, 268),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    "open_tree": (428, 428),
    "move_mount": (429, 429),
    "fsopen": (430, 430),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fspick": (433, 433),
    "mount_setattr": (442, 442),
    "open_by_handle_at": (304, 265),
    "io_uring_setup": (425, 425),
    "io_uring_enter": (426, 426),
    "io_uring_register": (427, 427),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
    "seccomp": (317, 277),
}
"""Numbers on x86_64 and aarch64 (asm/unistd_64.h, asm-generic/unistd.h).

io_uring opens files and sockets past this filter. A process with its own session or group would outlive the child,
which is killed as a group. clone and clone3 are needed for threads and forks.
"""
_CONDITIONAL_CALLS: Final = frozenset({"clone", "clone3", "prlimit64", "seccomp", "sendto", "sendmsg", "sendmmsg"})
_EXEC_CALLS: Final = frozenset({"execve", "execveat"})
_LISTENING_CALLS: Final = frozenset({"socket", "bind", "listen"})
_CONNECTING_CALLS: Final = frozenset({"socket", "connect"})


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_char_p))


def is_available() -> bool:
    """Whether the kernel accepts filters from this process and the architecture is supported."""
    machine = _current_machine()
    if machine is None:
        return False
    refuse = ctypes.c_uint32(_REFUSE)
    try:
        return _seccomp_call(machine, _ACTION_AVAILABLE, 0, ctypes.byref(refuse)) == 0
    except OSError:
        return False


def install_filter(*, programs: bool, server: bool, client: bool) -> None:
    """Install the filter in all threads of this process, which must have set ``no_new_privs``.

    With ``programs`` the process may still start programs, with ``server`` listen on TCP, with ``client`` connect by
    TCP. Raises ``OSError``.
    """
    machine = _current_machine()
    if machine is None:
        raise OSError(errno.ENOSYS, "no table of system calls for this architecture")
    code = filter_program(machine.audit, machine.column, programs=programs, server=server, client=client)
    program = _Program(len(code) // 8, code)
    if (thread := _seccomp_call(machine, _FILTER_MODE, _ALL_THREADS, ctypes.byref(program))) != 0:
        raise OSError(errno.EBUSY, f"seccomp: the thread {thread} has another filter")


def filter_program(audit: int, column: int, *, programs: bool, server: bool, client: bool = False) -> bytes:
    """Filter program for the architecture ``audit`` with the call numbers of ``column``."""
    number = {name: numbers[column] for name, numbers in _CALLS.items()}
    exceptions = ((programs, _EXEC_CALLS), (server, _LISTENING_CALLS), (client, _CONNECTING_CALLS))
    free = _CONDITIONAL_CALLS.union(*(calls for is_excepted, calls in exceptions if is_excepted))
    code = [
        # Check the architecture first: an instruction may switch to another one with other call numbers.
        _bpf_instruction(_LOAD, _ARCHITECTURE_AT),
        _bpf_instruction(_EQUAL, audit, skip_if=1),
        _return_action(_REFUSE | errno.EPERM),
        _bpf_instruction(_LOAD, _NUMBER_AT),
        _bpf_instruction(_AT_LEAST, _X32_CALLS, skip_unless=1),
        _return_action(_REFUSE | errno.EPERM),
    ]
    for name in _CALLS:
        if name not in free:
            code += [_bpf_instruction(_EQUAL, number[name], skip_unless=1), _return_action(_REFUSE | errno.EPERM)]
    # A filter cannot read the flags of clone3, which are in memory: on ENOSYS the C library falls back to clone.
    code += [_bpf_instruction(_EQUAL, number["clone3"], skip_unless=1), _return_action(_REFUSE | errno.ENOSYS)]
    code += _refuse_unless(number["clone"], 0, [_bpf_instruction(_ANY_BIT, _NAMESPACE_FLAGS, skip_unless=1)])
    # Limits of this process (0) only, not of others that the same user runs.
    code += _refuse_unless(number["prlimit64"], 0, [_bpf_instruction(_EQUAL, 0, skip_if=1)])
    if server or client:
        code += _refuse_unless(number["socket"], 0, [_bpf_instruction(_EQUAL, _AF_INET, skip_if=1)])
        not_tcp = [_bpf_instruction(0x54, 0xF), _bpf_instruction(_EQUAL, _SOCK_STREAM, skip_if=1)]  # 0x54: and with 0xF
        code += _refuse_unless(number["socket"], 1, not_tcp)
    for name, flags in (("sendto", 3), ("sendmsg", 2), ("sendmmsg", 3)):
        code += _refuse_unless(number[name], flags, [_bpf_instruction(_ANY_BIT, _MSG_FASTOPEN, skip_unless=1)])
    return b"".join([*code, _return_action(_ALLOW)])


def _refuse_unless(number: int, argument: int, condition: list[bytes]) -> list[bytes]:
    """Refuse the call ``number`` unless ``condition``, applied to 32 bits of an argument, skips an instruction.

    The kernel uses only the lower 32 bits of these arguments, or all relevant bits are there.
    """
    then = [
        _bpf_instruction(_LOAD, _ARGUMENTS_AT + 8 * argument),  # both architectures are little endian
        *condition,
        _return_action(_REFUSE | errno.EPERM),
        _bpf_instruction(_LOAD, _NUMBER_AT),
    ]
    return [_bpf_instruction(_EQUAL, number, skip_unless=len(then)), *then]


def _bpf_instruction(operation: int, operand: int, *, skip_if: int = 0, skip_unless: int = 0) -> bytes:
    return struct.pack("=HBBI", operation, skip_if, skip_unless, operand)  # struct sock_filter


def _return_action(action: int) -> bytes:
    return _bpf_instruction(_RETURN, action)


def _current_machine() -> _Machine | None:
    """Architecture of this process; None if it is not supported."""
    is_known = sys.platform == "linux" and struct.calcsize("P") == 8
    return _MACHINES.get(platform.machine()) if is_known else None


def _seccomp_call(machine: _Machine, operation: int, flags: int, argument: object) -> int:
    system_call = ctypes.CDLL(None, use_errno=True).syscall
    system_call.restype = ctypes.c_long
    numbers = (_CALLS["seccomp"][machine.column], operation, flags)
    result = int(system_call(*(ctypes.c_long(number) for number in numbers), argument))
    if result < 0:
        raise OSError(ctypes.get_errno(), "seccomp refused")
    return result
