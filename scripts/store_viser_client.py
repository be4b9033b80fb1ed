"""Stores a build of viser's client in the pages, for ``scripts/viser-client``."""

import hashlib
import json
import sys
from collections.abc import Iterator
from importlib.metadata import distribution, version
from importlib.resources import files
from pathlib import Path

import zstandard

from stridelab_web.viser_client import BUILT

REPLACEMENTS = Path(__file__).parents[1] / "frontend" / "viser_client"
ZSTD_LEVEL = 22
IN_WORKER = ("@msgpack/msgpack", "await-lock", "zstddec")
"""Packages of the worker that receives messages."""


def sources_sha256() -> str:
    """One hash of everything that the client is built from: viser's sources and lock, the patch, the replacements."""
    digest = hashlib.sha256()
    for name, content in _sources():
        digest.update(f"{name}\n{len(content)}\n".encode() + content)
    return digest.hexdigest()


def _sources() -> Iterator[tuple[str, bytes]]:
    viser = Path(str(files("viser") / "client"))
    for folder in (viser, REPLACEMENTS):
        shipped = [viser / "package-lock.json", *(viser / "src").rglob("*")]
        for path in sorted(shipped if folder == viser else folder.rglob("*")):
            if path.is_file():
                yield path.relative_to(folder).as_posix(), path.read_bytes()


def store_client(client: Path, built: Path) -> None:
    """Store the script of the folder ``built``, compressed, its licences, and the hash of its sources.

    The bundler lists the packages of the page; those of its worker are in the folder ``client``.
    """
    BUILT.mkdir(exist_ok=True)
    script = zstandard.ZstdCompressor(level=ZSTD_LEVEL).compress((built / "client.js").read_bytes())
    (BUILT / "client.js.zst").write_bytes(script)
    (BUILT / "licenses.md").write_text("\n".join(_licenses(client, built)))
    built_from = {"viser": version("viser"), "sources_sha256": sources_sha256()}
    (BUILT / "built_from.json").write_text(json.dumps(built_from, indent=2) + "\n")
    sys.stdout.write(f"{BUILT / 'client.js.zst'}: {len(script)} bytes\n")


def _licenses(client: Path, built: Path) -> Iterator[str]:
    viser = distribution("viser").read_text("licenses/LICENSE")
    yield (built / "licenses.md").read_text()
    yield f"## viser - {version('viser')} (Apache-2.0)\n\nChanged: see frontend/viser_client.\n\n{viser}"
    for name in IN_WORKER:
        (path,) = (client / "node_modules" / name).glob("LICENSE*")
        yield f"## {name}\n\n{path.read_text()}"


if __name__ == "__main__":
    store_client(Path(sys.argv[1]), Path(sys.argv[2]))
