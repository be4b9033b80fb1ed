"""Landlock: a thread gives up all files and TCP ports but those that it names, for itself and whatever it starts.

Three system calls, which the C library does not wrap; see landlock(7) and Documentation/userspace-api/landlock.rst of
the kernel, from which the numbers below are taken (include/uapi/linux/landlock.h). The kernel tells which version of
the interface it has (its ABI), and knows no access right that came later: those are left out here. Only the standard
library is imported.
"""

import ctypes
import os
import stat
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # the same on every architecture
_ASK_VERSION = 1
_PATH_BENEATH, _NET_PORT = 1, 2

EXECUTE, WRITE_FILE, READ_FILE, READ_DIR, REMOVE_DIR, REMOVE_FILE = (1 << bit for bit in range(6))
_MAKE_CHAR, MAKE_DIR, MAKE_REG, _MAKE_SOCK, _MAKE_FIFO, _MAKE_BLOCK, _MAKE_SYM = (1 << bit for bit in range(6, 13))
REFER, TRUNCATE, _IOCTL_DEV = (1 << bit for bit in range(13, 16))
_BIND_TCP, _CONNECT_TCP = 1, 2
_ABSTRACT_SOCKETS, _SIGNALS = 1, 2
_LAST_BIT_OF_ABI: Final = (12, 13, 14, 14, 15)
"""The last access right to files that ABI 1, 2, ... knows; later ones know no other that is handled here."""
NETWORK_ABI: Final = 4
_SCOPE_ABI: Final = 6

READ: Final = READ_FILE | READ_DIR
RUN: Final = READ | EXECUTE
USE: Final = READ_FILE | WRITE_FILE
"""Of a device such as /dev/null."""
FILL: Final = READ | WRITE_FILE | REMOVE_DIR | REMOVE_FILE | MAKE_DIR | MAKE_REG | REFER | TRUNCATE
"""Everything in a folder but programs, devices, sockets and symbolic links: whoever reads the folder follows links."""
_OF_A_FILE: Final = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | _IOCTL_DEV

Rule = tuple[Path, int]
"""A file, or a folder with all that is below it, and the access rights that remain."""


class _Ruleset(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _PathBeneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


class _NetPort(ctypes.Structure):
    _fields_ = (("allowed", ctypes.c_uint64), ("port", ctypes.c_uint64))


def abi() -> int:
    """Version of the kernel's Landlock; 0 where there is none, or where something forbids to use it."""
    if sys.platform != "linux":  # where the numbers mean other calls
        return 0
    try:
        return _call(_CREATE_RULESET, None, 0, _ASK_VERSION)
    except OSError:
        return 0


def restrict(rules: Iterable[Rule], *, may_listen: bool, version: int) -> None:
    """Leave the calling thread with ``rules`` only; it must have set ``no_new_privs``.

    A path that is not there, or cannot be reached, is left out. From ABI 4 on no TCP port can be connected to, and none
    bound, but for one that the kernel chooses if it ``may_listen``; from ABI 6 on no process outside can be signalled,
    and no abstract socket of one be reached. Raises ``OSError``.
    """
    handled = (2 << _LAST_BIT_OF_ABI[min(version, len(_LAST_BIT_OF_ABI)) - 1]) - 1
    asked = _Ruleset(handled)
    size = 8
    if version >= NETWORK_ABI:
        asked.network, size = _BIND_TCP | _CONNECT_TCP, 16
    if version >= _SCOPE_ABI:
        asked.scoped, size = _ABSTRACT_SOCKETS | _SIGNALS, 24
    ruleset = _call(_CREATE_RULESET, ctypes.byref(asked), size, 0)
    try:
        for path, rights in rules:
            _allow(ruleset, path, rights & handled)
        if may_listen and version >= NETWORK_ABI:
            any_port = _NetPort(_BIND_TCP, 0)  # a port from the ephemeral range
            _call(_ADD_RULE, ruleset, _NET_PORT, ctypes.byref(any_port), 0)
        _call(_RESTRICT_SELF, ruleset, 0)
    finally:
        os.close(ruleset)


def pin(paths: Sequence[Path]) -> None:
    """Keep a handle to each path for as long as the process lives.

    A rule is about the file that the kernel has in memory. Those of /proc are forgotten, and made anew without the
    rule, unless somebody holds them.
    """
    for path in paths:
        try:
            os.open(path, os.O_PATH | os.O_CLOEXEC)
        except OSError:
            continue


def _allow(ruleset: int, path: Path, rights: int) -> None:
    try:
        handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not stat.S_ISDIR(os.fstat(handle).st_mode):
            rights &= _OF_A_FILE
        if rights:
            rule = _PathBeneath(rights, handle)
            _call(_ADD_RULE, ruleset, _PATH_BENEATH, ctypes.byref(rule), 0)
    finally:
        os.close(handle)


def _call(number: int, *arguments: object) -> int:
    system_call = ctypes.CDLL(None, use_errno=True).syscall
    system_call.restype = ctypes.c_long
    wide = [ctypes.c_long(argument) if isinstance(argument, int) else argument for argument in arguments]
    result = int(system_call(ctypes.c_long(number), *wide))
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, f"Landlock (system call {number}): {os.strerror(code)}")
    return result
