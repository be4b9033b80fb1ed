"""Fork server: imports the libraries of computations once and forks a child for each of them.

``python -m stridelab.service.processes.fork_server PARENT MODULES``; ``fork_server_client`` is the parent's end. The
standard input is a socket for requests and answers, in records:

    FORK, serial, niceness, and two files
                                   fork a child that communicates on the first file and prints into the second
    PING, 0                        answer 0, 0
    RELEASE, serial                the child may be reaped, after which its process id may be reused
    serial, code  (answer)         the child has ended; until it is reaped it stays a zombie and can be signalled safely

The server has one thread, so that no fork copies a held lock, imports only the standard library by itself, and ends
with its parent, as its children end with it. It forks no child before all imports are done, because the time limit of a
child starts when it is forked.
"""

import gc
import importlib
import os
import select
import signal
import socket
import struct
import sys
import traceback
from typing import Final, NoReturn

from stridelab.service.processes import child
from stridelab.service.processes.parent_death import die_with_parent

REQUEST: Final = struct.Struct("<cqB")
"""Request (``FORK``, ``RELEASE`` or ``PING``), the child's serial number assigned by the client, its niceness."""
ANSWER: Final = struct.Struct("<qi")
"""Serial number and exit code, negative for a signal."""
FORK: Final = b"F"
LET_GO: Final = b"L"
PING: Final = b"P"


class Forking:
    """Forks, monitors and reaps the children of this process."""

    def __init__(self, control: socket.socket) -> None:
        self._control, self._asked = control, control.fileno()
        self._woken, wake = os.pipe()
        os.set_blocking(self._woken, False)
        os.set_blocking(wake, False)
        self._wake = wake
        signal.signal(signal.SIGCHLD, lambda *_: None)  # the signal only writes a byte to the wake-up pipe
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        self._pids: dict[int, int] = {}
        self._ended: set[int] = set()
        self._let_go: set[int] = set()

    def attend(self) -> NoReturn:
        """Serve requests and report ended children until the client closes the socket."""
        while True:
            ready, _, _ = select.select([self._asked, self._woken], [], [])
            if self._woken in ready:
                os.read(self._woken, select.PIPE_BUF)
            if self._asked in ready:
                self._take()
            self._look_after()

    def _take(self) -> None:
        request, files, _, _ = socket.recv_fds(self._control, REQUEST.size, 2, socket.MSG_WAITALL)
        if len(request) < REQUEST.size:
            os._exit(0)  # the client has closed the socket
        what, serial, niceness = REQUEST.unpack(request)
        if what == FORK:
            self._fork(serial, niceness, *files)
        elif what == PING:
            self._control.sendall(ANSWER.pack(0, 0))
        else:
            self._let_go.add(serial)

    def _fork(self, serial: int, niceness: int, wire: int, log: int) -> None:
        server_pid = os.getpid()
        try:
            pid = os.fork()
        except OSError as error:  # no process or no memory left
            os.write(log, f"No child could be forked: {error}.\n".encode())
            pid = None
        if pid == 0:
            self._live(server_pid, niceness, wire, log)
        os.close(wire)
        os.close(log)
        if pid is None:
            self._control.sendall(ANSWER.pack(serial, os.EX_OSERR))
        else:
            self._pids[serial] = pid

    def _live(self, nursery: int, niceness: int, wire: int, log: int) -> NoReturn:
        """In the child: drop the server's state except for the imported modules, and run the task."""
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            self._control.close()
            for inherited in (self._woken, self._wake):
                os.close(inherited)
            os.setsid()  # its own children can be killed with it
            os.dup2(log, 1)
            os.dup2(log, 2)
            os.close(log)
            os.set_inheritable(wire, False)
            die_with_parent(nursery)
            child.live(wire, niceness)
        except BaseException:  # noqa: BLE001 (the child must not return into the server's loop)
            traceback.print_exc()
        finally:
            os._exit(1)

    def _look_after(self) -> None:
        for serial, pid in list(self._pids.items()):
            if serial not in self._ended:
                status = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT | os.WNOHANG)
                if status is None:
                    continue
                code = status.si_status if status.si_code == os.CLD_EXITED else -status.si_status
                self._ended.add(serial)
                self._control.sendall(ANSWER.pack(serial, code))
            if serial in self._let_go:
                os.waitpid(pid, 0)
                del self._pids[serial]
                self._ended.discard(serial)
        self._let_go &= self._pids.keys()


def main(parent_pid: int, modules: list[str]) -> None:
    """Import ``modules`` and serve fork requests until the parent ends."""
    die_with_parent(parent_pid)
    child.forbid_core_files()
    control = socket.socket(fileno=os.dup(0))
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    forking = Forking(control)
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError:
            traceback.print_exc()  # a task that needs the module reports the error
    gc.collect()
    gc.freeze()  # a collection in a child would write to, and so copy, every page
    forking.attend()


if __name__ == "__main__":
    main(int(sys.argv[1]), [name for name in sys.argv[2].split(",") if name])
