"""Networks that fail: hosts with a cable between them, and a relay that can be cut.

Two hosts for processes: network namespaces with a cable between them, and nothing else.

A network that can be cut: a TCP relay in front of a server, which stops forwarding but closes nothing.

``python -m support.faults.network SOCKET ADDRESS PORT`` is one that is never cut, for another host.
"""

import contextlib
import os
import shutil
import socket
import subprocess
import sys
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

HERE, THERE = "192.0.2.1", "192.0.2.2"  # addresses for documentation: nobody's network
_CABLE = "cable"


@dataclass(frozen=True)
class Hosts:
    """``here`` and ``there`` go before the command line of what shall run on one of them."""

    name: str

    @property
    def here(self) -> tuple[str, ...]:
        return ("ip", "netns", "exec", f"{self.name}-a")

    @property
    def there(self) -> tuple[str, ...]:
        return ("ip", "netns", "exec", f"{self.name}-b")

    def pull(self) -> None:
        """Pull the cable: packets are lost without an error to either side."""
        _ip("-n", f"{self.name}-a", "link", "set", _CABLE, "down")

    def plug(self) -> None:
        """Put it back."""
        _ip("-n", f"{self.name}-a", "link", "set", _CABLE, "up")


@contextmanager
def hosts() -> Iterator[Hosts]:
    """Skips the test where a process may not make network namespaces."""
    if shutil.which("ip") is None or os.geteuid() != 0:
        pytest.skip("hosts need root and the ip command")
    new_hosts = Hosts(f"lab{uuid.uuid4().hex[:8]}")
    here, there = f"{new_hosts.name}-a", f"{new_hosts.name}-b"
    if subprocess.run(["ip", "netns", "add", here], capture_output=True, check=False).returncode:
        pytest.skip("this machine allows no network namespaces")
    try:
        _ip("netns", "add", there)
        _ip("-n", here, "link", "add", _CABLE, "type", "veth", "peer", "name", _CABLE, "netns", there)
        for name, address in ((here, HERE), (there, THERE)):
            _ip("-n", name, "addr", "add", f"{address}/30", "dev", _CABLE)
            _ip("-n", name, "link", "set", _CABLE, "up")
            _ip("-n", name, "link", "set", "lo", "up")
        yield new_hosts
    finally:
        for name in (here, there):
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)


class Cut:
    """While the cable is pulled, no bytes are read or forwarded, as with an unplugged cable."""

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
    cut = Cut(target, "127.0.0.1")
    try:
        yield cut
    finally:
        cut.close()


if __name__ == "__main__":
    Cut(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    threading.Event().wait()
