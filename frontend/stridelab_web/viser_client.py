"""viser's client without its panel, as ``scripts/viser-client`` builds it from the sources in the viser package.

The client that the package contains is one page that unpacks itself in every scene, with a panel, splats and meshes of
other formats: 710 kB by gzip, of which no scene here needs half. ``frontend/viser_client`` says which parts
are left out, and a small patch gives the page around the frame one object, ``viserScene``, with the client's stores and
the root of its scene. The result is one script, which browsers may keep; who changes viser's version or a replacement
builds it again, and a test compares what it was built from.
"""

import gzip
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Final

import zstandard

FOLDER: Final = "/static/viser/"
"""Address of the script in the web app; its name changes with its content."""
FRAME_STYLES: Final = "/static/css/viser_frame.css"
BUILT: Final = Path(__file__).parent / "static" / "viser"
"""The script ``client.js.zst``, ``licenses.md`` of what it contains, and ``built_from.json``."""
CONTENT_POLICY: Final = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self' data: blob:; worker-src blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Its worker decodes messages by WebAssembly, which it carries as text."""


@dataclass(frozen=True)
class ViserClient:
    """The page of a frame, and its one script, ``name``, compressed as ``script_zstd`` and ``script_gzip``."""

    page: bytes
    name: str
    script_zstd: bytes
    script_gzip: bytes


@cache
def built_client() -> ViserClient:
    """The client for the installed viser package. Raises ``ValueError`` if it was built for another version."""
    built_from: Mapping[str, str] = json.loads((BUILT / "built_from.json").read_text())
    if built_from["viser"] != version("viser"):
        raise ValueError(
            f"the client was built for viser {built_from['viser']}: build it again by scripts/viser-client"
        )
    script_zstd = (BUILT / "client.js.zst").read_bytes()
    script = zstandard.ZstdDecompressor().decompress(script_zstd)
    name = f"{built_from['viser']}-{hashlib.sha256(script).hexdigest()[:16]}.js"
    return ViserClient(_frame_page(name), name, script_zstd, gzip.compress(script, compresslevel=9, mtime=0))


def _frame_page(name: str) -> bytes:
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Scene</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="stylesheet" href="{FRAME_STYLES}"><script type="module" src="{FOLDER}{name}"></script>'
        '</head><body><div id="root"></div></body></html>'
    ).encode()
