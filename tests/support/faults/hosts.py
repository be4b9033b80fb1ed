"""Two hosts for processes: network namespaces with a cable between them, and nothing else."""

import os
import shutil
import subprocess
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
        """Pull the cable: packets are lost, and nobody is told."""
        _ip("-n", f"{self.name}-a", "link", "set", _CABLE, "down")

    def plug(self) -> None:
        """Put it back."""
        _ip("-n", f"{self.name}-a", "link", "set", _CABLE, "up")


@contextmanager
def hosts() -> Iterator[Hosts]:
    """Skips the test where a process may not make network namespaces."""
    if shutil.which("ip") is None or os.geteuid() != 0:
        pytest.skip("hosts need root and the ip command")
    made = Hosts(f"lab{uuid.uuid4().hex[:8]}")
    here, there = f"{made.name}-a", f"{made.name}-b"
    if subprocess.run(["ip", "netns", "add", here], capture_output=True, check=False).returncode:
        pytest.skip("this machine allows no network namespaces")
    try:
        _ip("netns", "add", there)
        _ip("-n", here, "link", "add", _CABLE, "type", "veth", "peer", "name", _CABLE, "netns", there)
        for name, address in ((here, HERE), (there, THERE)):
            _ip("-n", name, "addr", "add", f"{address}/30", "dev", _CABLE)
            _ip("-n", name, "link", "set", _CABLE, "up")
            _ip("-n", name, "link", "set", "lo", "up")
        yield made
    finally:
        for name in (here, there):
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)
