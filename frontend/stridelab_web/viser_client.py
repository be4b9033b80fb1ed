"""viser's client as it is installed, unpacked into files that a browser may keep.

The installed page contains one small script. It unpacks styles and the application from an attribute (base 88,
zstandard, with a decoder in WebAssembly) and writes both into the document of every scene, where browsers cache neither
the text nor its compiled form. Here they are unpacked once and become files with their own addresses;
static/js/viewer/viser_start.js does the rest of the script.

One expression of the application is replaced: the lighting of a scene before the first message of its server. viser
uses an image of a city, which takes a second to decode and filter without a graphics card, and drops it at the first
message, because no scene here has one (``viewer/scene_parts.py``).

A second one starts later: the sorter of Gaussian splats compiles itself with ``Function(...)`` when the page is loaded,
which the policy of the frame refuses with an error on the console; no scene here has splats, so it is never needed.

The image of the city and the four copies of the sorter are left out of the text: 160 of its 2500 kB, and, because they
hardly compress, 45 of 650 kB that cross the network. So is the simplifier of meshes, a WebAssembly module as text that
coarsens copies of a mesh far from the camera, of which no scene here has any: 40 kB, 13 across the network.
"""

import gzip
import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from typing import Final

import numpy as np
import zstandard

ALPHABET: Final = b"!#$%()*+,-./0123456789:;=?@ABCDEFGHIJKLMNOPQRSTUVWXYZ[\\]^_abcdefghijklmnopqrstuvwxyz{|}~"
FOLDER: Final = "/static/viser/"
"""Address of the files in the web app; their names change with their content."""
FRAME_STYLES: Final = "/static/css/viser_frame.css"
"""Our own styles in the frame, which hide viser's panel."""
CONTENT_POLICY: Final = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src data:; connect-src 'self' data: blob:; worker-src blob:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""The application writes styles while it runs, so in its frame, and nowhere else, styles are not restricted."""
SUFFIXES: Final = {"text/css": ".css", "text/javascript": ".js", "application/wasm": ".wasm"}
DEFAULT_ENVIRONMENT: Final = b"environmentMap:null"
NO_ENVIRONMENT: Final = b"environmentMap:{hdri_data:null}"
SPLAT_SORTER: Final = re.compile(
    rb"=(fetch\([\w$]+\)\.then\(([\w$]+)=>\2\.arrayBuffer\(\)\)\.then\(([\w$]+)=>[\w$]+\(\{wasmBinary:\3\}\)\))"
)
"""The sorter as a promise, in the application and in the text of its worker."""
UNUSED_DATA: Final = re.compile(rb"data:(image/jpeg|application/wasm);base64,[A-Za-z0-9+/=]{10000,}")
"""The image of the city, and the sorter in the application and in the text of its worker, each twice."""
NO_DATA: Final = b"data:,"
SIMPLIFIER: Final = re.compile(rb"\(function\(\)\{var e=`b9H[^`]{20000,}`.*?\}\}\)\(\)", re.DOTALL)
NO_SIMPLIFIER: Final = b"({supported:!1})"
"""What the module itself says in a browser without WebAssembly."""
LATER: Final = (b"={then:(done,failed)=>", b".then(done,failed)}")
"""Before and after the same as an object that begins when it is awaited."""
_SCRIPT = re.compile(
    rb'<script data-p="(?P<packed>[^"]*)" data-ss="(?P<styles>\d+)" data-cs="(?P<code>\d+)">'
    rb'.*?gzWasm="(?P<decoder>[^"]*)".*?</script>',
    re.DOTALL,
)


@dataclass(frozen=True)
class ViserClient:
    """``page`` requests the three ``files`` by name; ``media_types`` has the same names."""

    page: bytes
    files: Mapping[str, bytes]
    media_types: Mapping[str, str]


@cache
def installed_client() -> ViserClient:
    """The client of the installed viser package. Raises ``ValueError`` if its form is unknown."""
    return unpack_page(files("viser").joinpath("client", "build", "index.html").read_bytes())


def unpack_page(html: bytes) -> ViserClient:
    """Split the page of viser into its files. Raises ``ValueError`` if its form is unknown."""
    script = _SCRIPT.search(html)
    if script is None:
        raise ValueError("the client page of this viser version has an unknown form: its scripts cannot be found")
    whole = zstandard.ZstdDecompressor().decompress(decode_base88(script["packed"]))
    end = int(script["styles"])
    parts = {
        "text/css": whole[:end],
        "text/javascript": reduce_code(whole[end : end + int(script["code"])]),
        "application/wasm": gzip.decompress(decode_base88(script["decoder"].replace(b"\\\\", b"\\"))),
    }
    names = {media_type: _file_name(content) + SUFFIXES[media_type] for media_type, content in parts.items()}
    page = html[: script.start()] + _resource_links(*(FOLDER + name for name in names.values())) + html[script.end() :]
    files = {names[media_type]: content for media_type, content in parts.items()}
    return ViserClient(page, files, {name: media_type for media_type, name in names.items()})


def reduce_code(code: bytes) -> bytes:
    """The application without what no scene here has. Raises as ``remove_environment``."""
    return remove_simplifier(remove_data(defer_splats(remove_environment(code))))


def remove_environment(code: bytes) -> bytes:
    """The application without its initial environment image. Raises ``ValueError`` if its form is unknown."""
    if code.count(DEFAULT_ENVIRONMENT) != 1:
        raise ValueError("the client of this viser version has an unknown form: its first environment cannot be found")
    return code.replace(DEFAULT_ENVIRONMENT, NO_ENVIRONMENT)


def defer_splats(code: bytes) -> bytes:
    """The application that starts its sorter of splats with the first splat. Raises as ``remove_environment``."""
    before, after = LATER
    deferred, n = SPLAT_SORTER.subn(lambda found: before + found[1] + after, code)
    if n != 2:
        raise ValueError("the client of this viser version has an unknown form: its sorter of splats cannot be found")
    return deferred


def remove_data(code: bytes) -> bytes:
    """The application without the data of what no scene here has. Raises as ``remove_environment``."""
    kinds = sorted(kind.decode() for kind in UNUSED_DATA.findall(code))
    if kinds != ["application/wasm"] * 4 + ["image/jpeg"]:
        raise ValueError("the client of this viser version has an unknown form: its unused data cannot be found")
    return UNUSED_DATA.sub(NO_DATA, code)


def remove_simplifier(code: bytes) -> bytes:
    """The application without its simplifier of meshes. Raises as ``remove_environment``."""
    reduced, n = SIMPLIFIER.subn(NO_SIMPLIFIER, code)
    if n != 1:
        raise ValueError("the client of this viser version has an unknown form: its simplifier cannot be found")
    return reduced


def decode_base88(text: bytes) -> bytes:
    """Decode base 88: five characters are four bytes, big-endian; k remaining characters are k - 1 bytes."""
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


def _file_name(content: bytes) -> str:
    return f"{version('viser')}-{hashlib.sha256(content).hexdigest()[:16]}"


def _resource_links(styles: str, code: str, decoder: str) -> bytes:
    return (
        f'<link rel="stylesheet" href="{styles}"><link rel="stylesheet" href="{FRAME_STYLES}">'
        f'<link rel="modulepreload" href="{code}">'
        f'<link rel="preload" href="{decoder}" as="fetch" crossorigin>'
        '<script type="module" src="/static/js/viewer/viser_start.js"></script>'
    ).encode()
