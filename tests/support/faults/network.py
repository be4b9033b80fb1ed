"""A network that can be cut: a TCP relay in front of a server, which stops forwarding but closes nothing.

``python -m support.faults.network SOCKET ADDRESS PORT`` is one that is never cut, for another host.
"""

import contextlib
import socket
import sys
import threading
from collections.abc import Iterator


class Cut:
    """While it is pulled, bytes are taken from nobody and given to nobody, as with a cable that lies on the floor."""

    def __init__(self, target: str, address: str, port: int = 0) -> None:
        self._target = target
        self._whole = threading.Event()
        self._whole.set()
        self._listener = socket.create_server((address, port))
        self._sockets: list[socket.socket] = [self._listener]
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    @property
    def port(self) -> int:
        return int(self._listener.getsockname()[1])

    def pull(self) -> None:
        """Cut it."""
        self._whole.clear()

    def plug(self) -> None:
        """Let everything that waits go on."""
        self._whole.set()

    def close(self) -> None:
        """End every connection."""
        self.plug()
        for each in list(self._sockets):
            with contextlib.suppress(OSError):  # ended by the other side already
                each.shutdown(socket.SHUT_RDWR)
        for thread in list(self._threads):
            thread.join(10)
        for each in self._sockets:
            each.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # closed
            while True:
                near = self._listener.accept()[0]
                self._sockets.append(near)
                self._whole.wait()
                far = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                self._sockets.append(far)
                far.connect(self._target)
                for one, other in ((near, far), (far, near)):
                    thread = threading.Thread(target=self._forward, args=(one, other), daemon=True)
                    self._threads.append(thread)
                    thread.start()

    def _forward(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while piece := source.recv(65536):
                self._whole.wait()
                sink.sendall(piece)
        with contextlib.suppress(OSError):
            sink.shutdown(socket.SHUT_WR)


@contextlib.contextmanager
def relay(target: str) -> Iterator[Cut]:
    """A relay to a server's Unix socket, on a TCP port of the loopback address."""
    made = Cut(target, "127.0.0.1")
    try:
        yield made
    finally:
        made.close()


if __name__ == "__main__":
    Cut(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    threading.Event().wait()
