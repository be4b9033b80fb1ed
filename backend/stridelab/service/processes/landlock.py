"""Landlock: restricts a thread and its children to a given set of files and TCP ports.

Uses three system calls that the C library does not wrap; see landlock(7) and Documentation/userspace-api/landlock.rst
of the kernel; the numbers below are from include/uapi/linux/landlock.h. The kernel reports its version of the interface
(ABI); access rights of later versions are left out. Imports the standard library only.
"""

import ctypes
import os
import stat
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # the same on every architecture
_GET_VERSION = 1
_PATH_BENEATH, _NET_PORT = 1, 2

EXECUTE, WRITE_FILE, READ_FILE, READ_DIR, REMOVE_DIR, REMOVE_FILE = (1 << bit for bit in range(6))
_MAKE_CHAR, MAKE_DIR, MAKE_REG, _MAKE_SOCK, _MAKE_FIFO, _MAKE_BLOCK, _MAKE_SYM = (1 << bit for bit in range(6, 13))
REFER, TRUNCATE, _IOCTL_DEV = (1 << bit for bit in range(13, 16))
_BIND_TCP, _CONNECT_TCP = 1, 2
_ABSTRACT_SOCKETS, _SIGNALS = 1, 2
_LAST_BIT_OF_ABI: Final = (12, 13, 14, 14, 15)
"""Last file access right of ABI 1, 2, ...; later ABIs add none that is handled here."""
NETWORK_ABI: Final = 4
_SCOPE_ABI: Final = 6

READ: Final = READ_FILE | READ_DIR
READ_EXECUTE: Final = READ | EXECUTE
DEVICE_ACCESS: Final = READ_FILE | WRITE_FILE
"""Rights for a device such as /dev/null."""
WRITABLE_FOLDER: Final = READ | WRITE_FILE | REMOVE_DIR | REMOVE_FILE | MAKE_DIR | MAKE_REG | REFER | TRUNCATE
"""Rights for a writable folder: everything except executing programs and creating devices, sockets or symbolic links,
which a later reader of the folder would follow."""
_FILE_RIGHTS: Final = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | _IOCTL_DEV

Rule = tuple[Path, int]
"""A file or folder (with everything below it) and its remaining access rights."""


class _Ruleset(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _PathBeneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


class _NetPort(ctypes.Structure):
    _fields_ = (("allowed", ctypes.c_uint64), ("port", ctypes.c_uint64))


def abi_version() -> int:
    """ABI version of the kernel's Landlock; 0 if it is missing or blocked."""
    if sys.platform != "linux":  # elsewhere the numbers belong to other calls
        return 0
    try:
        return _system_call(_CREATE_RULESET, None, 0, _GET_VERSION)
    except OSError:
        return 0


def restrict_thread(rules: Iterable[Rule], *, may_listen: bool, connects: int | None = None, version: int) -> None:
    """Restrict the calling thread to ``rules``; it must have set ``no_new_privs``.

    Missing or unreachable paths are skipped. From ABI 4 on, the thread can connect to the TCP port ``connects`` only,
    and can bind only a port chosen by the kernel, if ``may_listen``; from ABI 6 on, it cannot signal processes outside
    or use their abstract sockets. Raises ``OSError``.
    """
    handled = (2 << _LAST_BIT_OF_ABI[min(version, len(_LAST_BIT_OF_ABI)) - 1]) - 1
    ruleset_attr = _Ruleset(handled)
    size = 8
    if version >= NETWORK_ABI:
        ruleset_attr.network, size = _BIND_TCP | _CONNECT_TCP, 16
    if version >= _SCOPE_ABI:
        ruleset_attr.scoped, size = _ABSTRACT_SOCKETS | _SIGNALS, 24
    ruleset = _system_call(_CREATE_RULESET, ctypes.byref(ruleset_attr), size, 0)
    try:
        for path, rights in rules:
            _add_path_rule(ruleset, path, rights & handled)
        ports = [_NetPort(_BIND_TCP, 0)] if may_listen else []  # a port from the ephemeral range
        ports += [] if connects is None else [_NetPort(_CONNECT_TCP, connects)]
        for port in ports if version >= NETWORK_ABI else ():
            _system_call(_ADD_RULE, ruleset, _NET_PORT, ctypes.byref(port), 0)
        _system_call(_RESTRICT_SELF, ruleset, 0)
    finally:
        os.close(ruleset)


def pin_paths(paths: Sequence[Path]) -> None:
    """Keep an open handle to each path for the lifetime of the process.

    A rule belongs to the kernel's inode in memory. Inodes of /proc are evicted and recreated without the rule unless a
    handle holds them.
    """
    for path in paths:
        try:
            os.open(path, os.O_PATH | os.O_CLOEXEC)
        except OSError:
            continue


def _add_path_rule(ruleset: int, path: Path, rights: int) -> None:
    try:
        handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not stat.S_ISDIR(os.fstat(handle).st_mode):
            rights &= _FILE_RIGHTS
        if rights:
            rule = _PathBeneath(rights, handle)
            _system_call(_ADD_RULE, ruleset, _PATH_BENEATH, ctypes.byref(rule), 0)
    finally:
        os.close(handle)


def _system_call(number: int, *arguments: object) -> int:
    system_call = ctypes.CDLL(None, use_errno=True).syscall
    system_call.restype = ctypes.c_long
    wide = [ctypes.c_long(argument) if isinstance(argument, int) else argument for argument in arguments]
    result = int(system_call(ctypes.c_long(number), *wide))
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, f"Landlock (system call {number}): {os.strerror(code)}")
    return result
