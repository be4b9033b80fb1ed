"""Starts a program that ends with its parent (parent death signal).

``python -m stridelab.service.processes.parent_death PID SIGNAL [--user NAME] -- ARGV``

A service that is killed with ``kill -9`` cannot stop its children; the kernel does (``PR_SET_PDEATHSIG``, prctl(2)).
The setting survives ``execve`` but not a change of user, so it is made after that change and right before the program
starts. The signal is sent when the *thread* that spawned the child ends: spawn from long-lived threads. Where the
kernel has no such call (macOS), the program starts without a parent death signal.
"""

import ctypes
import os
import pwd
import signal
import sys
from collections.abc import Sequence

_PR_SET_PDEATHSIG = 1


def die_with_parent(parent_pid: int, signum: int = signal.SIGKILL) -> None:
    """Make the kernel send ``signum`` to this process when its parent ends; exit at once if it already has."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signum))
    if os.getppid() != parent_pid:
        os._exit(1)


def command_ending_with_parent(
    argv: Sequence[str], *, signum: int = signal.SIGKILL, user: str | None = None
) -> list[str]:
    """Command line that runs ``argv`` so that it ends with the calling process; as ``user`` if given."""
    switch = [] if user is None else ["--user", user]
    return [
        sys.executable,
        "-m",
        "stridelab.service.processes.parent_death",
        str(os.getpid()),
        str(int(signum)),
        *switch,
        "--",
        *argv,
    ]


def change_user(user: str) -> None:
    """Change irrevocably from root to ``user``."""
    account = pwd.getpwnam(user)
    os.setgroups([])
    os.setgid(account.pw_gid)
    os.setuid(account.pw_uid)


def main(arguments: Sequence[str]) -> None:
    """Set the parent death signal and execute the program."""
    separator = arguments.index("--")
    options, argv = arguments[:separator], list(arguments[separator + 1 :])
    if options[2:]:
        change_user(options[3])
        os.chdir("/")
    die_with_parent(int(options[0]), int(options[1]))
    os.execvp(argv[0], argv)  # noqa: S606 (no shell is the point)


if __name__ == "__main__":
    main(sys.argv[1:])
