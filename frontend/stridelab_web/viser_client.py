"""viser's client page as it is installed, and the content policy under which its scripts may run.

The page holds one small script. That unpacks styles and the application from an attribute (base 88, zstandard) and
adds both to the document, so the browser meets two inline scripts. Both are fixed by the installed version and are
allowed by their hashes. The application generates styles while it runs, so in this frame, and nowhere else, styles
are not restricted; nothing can be fetched from outside.
"""

import base64
import gzip
import hashlib
import re
from functools import cache
from importlib.resources import files

import numpy as np
import zstandard

ALPHABET = b"!#$%()*+,-./0123456789:;=?@ABCDEFGHIJKLMNOPQRSTUVWXYZ[\\]^_abcdefghijklmnopqrstuvwxyz{|}~"
_SCRIPT = re.compile(
    rb'<script data-p="(?P<packed>[^"]*)" data-ss="(?P<styles>\d+)" data-cs="(?P<code>\d+)">(?P<loader>.*?)</script>',
    re.DOTALL,
)


@cache
def page() -> bytes:
    """The client page of the installed viser package: one HTML file."""
    return files("viser").joinpath("client", "build", "index.html").read_bytes()


@cache
def page_gzip() -> bytes:
    """The page, compressed once."""
    return gzip.compress(page(), mtime=0)


@cache
def content_policy() -> str:
    """Value of Content-Security-Policy for the page. Raises ``ValueError`` where the page has another form."""
    hashes = " ".join(f"'sha256-{_sha256(script)}'" for script in scripts(page()))
    return (
        f"default-src 'none'; script-src {hashes} 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
        "img-src 'self' data: blob:; font-src data:; connect-src 'self' data: blob:; worker-src blob:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
    )


def scripts(html: bytes) -> tuple[bytes, bytes]:
    """The two scripts that the page runs: its loader, and the application that the loader unpacks."""
    found = _SCRIPT.search(html)
    if found is None:
        raise ValueError("the client page of this viser version has another form: its scripts cannot be found")
    unpacked = zstandard.ZstdDecompressor().decompress(decode88(found["packed"]))
    styles, code = int(found["styles"]), int(found["code"])
    return found["loader"], unpacked[styles : styles + code]


def decode88(text: bytes) -> bytes:
    """Five characters are four bytes, big-endian; a rest of k characters is k - 1 bytes."""
    value_of = np.zeros(256, dtype=np.uint64)
    value_of[np.frombuffer(ALPHABET, dtype=np.uint8)] = np.arange(len(ALPHABET), dtype=np.uint64)
    digits = value_of[np.frombuffer(text, dtype=np.uint8)]
    whole, rest = digits[: len(digits) // 5 * 5].reshape(-1, 5), digits[len(digits) // 5 * 5 :]
    numbers = whole @ (np.uint64(88) ** np.arange(4, -1, -1, dtype=np.uint64))
    head = numbers.astype(">u4").tobytes()
    tail = 0
    for digit in rest:
        tail = tail * len(ALPHABET) + int(digit)
    return head + (tail.to_bytes(len(rest) - 1, "big") if len(rest) else b"")


def _sha256(script: bytes) -> str:
    return base64.b64encode(hashlib.sha256(script).digest()).decode()
