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

REQUEST: Final = struct.Struct("<cqb")
"""Request (``FORK``, ``RELEASE`` or ``PING``), the child's serial number assigned by the client, its niceness."""
ANSWER: Final = struct.Struct("<qi")
"""Serial number and exit code, negative for a signal."""
FORK: Final = b"F"
RELEASE: Final = b"L"
PING: Final = b"P"


class ForkServer:
    """Forks, monitors and reaps the children of this process."""

    def __init__(self, control: socket.socket) -> None:
        self._control, self._control_fd = control, control.fileno()
        self._wakeup_fd, wake = os.pipe()
        os.set_blocking(self._wakeup_fd, False)
        os.set_blocking(wake, False)
        self._wakeup_write_fd = wake
        signal.signal(signal.SIGCHLD, lambda *_: None)  # the signal only writes a byte to the wake-up pipe
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        self._pids: dict[int, int] = {}
        self._ended: set[int] = set()
        self._released: set[int] = set()

    def serve_requests(self) -> NoReturn:
        """Serve requests and report ended children until the client closes the socket."""
        while True:
            ready, _, _ = select.select([self._control_fd, self._wakeup_fd], [], [])
            if self._wakeup_fd in ready:
                os.read(self._wakeup_fd, select.PIPE_BUF)
            if self._control_fd in ready:
                self._handle_request()
            self._report_and_reap()

    def _handle_request(self) -> None:
        request, files, _, _ = socket.recv_fds(self._control, REQUEST.size, 2, socket.MSG_WAITALL)
        if len(request) < REQUEST.size:
            os._exit(0)  # the client has closed the socket
        what, serial, niceness = REQUEST.unpack(request)
        if what == FORK:
            self._fork_child(serial, niceness, *files)
        elif what == PING:
            self._control.sendall(ANSWER.pack(0, 0))
        else:
            self._released.add(serial)

    def _fork_child(self, serial: int, niceness: int, wire: int, log: int) -> None:
        server_pid = os.getpid()
        try:
            pid = os.fork()
        except OSError as error:  # no process or no memory left
            os.write(log, f"No child could be forked: {error}.\n".encode())
            pid = None
        if pid == 0:
            self._run_in_child(server_pid, niceness, wire, log)
        os.close(wire)
        os.close(log)
        if pid is None:
            self._control.sendall(ANSWER.pack(serial, os.EX_OSERR))
        else:
            self._pids[serial] = pid

    def _run_in_child(self, server_pid: int, niceness: int, wire: int, log: int) -> NoReturn:
        """In the child: drop the server's state except for the imported modules, and run the task."""
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            self._control.close()
            for inherited in (self._wakeup_fd, self._wakeup_write_fd):
                os.close(inherited)
            os.setsid()  # its own children can be killed with it
            os.dup2(log, 1)
            os.dup2(log, 2)
            os.close(log)
            os.set_inheritable(wire, False)
            die_with_parent(server_pid)
            child.run_child(wire, niceness)
        except BaseException:  # noqa: BLE001 (the child must not return into the server's loop)
            traceback.print_exc()
        finally:
            os._exit(1)

    def _report_and_reap(self) -> None:
        for serial, pid in list(self._pids.items()):
            if serial not in self._ended:
                status = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT | os.WNOHANG)
                if status is None:
                    continue
                code = status.si_status if status.si_code == os.CLD_EXITED else -status.si_status
                self._ended.add(serial)
                self._control.sendall(ANSWER.pack(serial, code))
            if serial in self._released:
                os.waitpid(pid, 0)
                del self._pids[serial]
                self._ended.discard(serial)
        self._released &= self._pids.keys()


def main(parent_pid: int, modules: list[str]) -> None:
    """Import ``modules`` and serve fork requests until the parent ends."""
    die_with_parent(parent_pid)
    child.forbid_core_files()
    control = socket.socket(fileno=os.dup(0))
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    forking = ForkServer(control)
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError:
            traceback.print_exc()  # a task that needs the module reports the error
    gc.collect()
    gc.freeze()  # a collection in a child would write to, and so copy, every page
    forking.serve_requests()


if __name__ == "__main__":
    main(int(sys.argv[1]), [name for name in sys.argv[2].split(",") if name])
