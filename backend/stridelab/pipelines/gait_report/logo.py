"""The logo of the laboratory: a PNG, or an SVG that loads and runs nothing."""

import base64
import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from PIL import Image, UnidentifiedImageError

from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.files.xml_tree import BrokenXmlError, parse_xml

SETTING: Final = "STRIDELAB_LAB_LOGO"
MAX_BYTES: Final = 500_000
MAX_PIXELS: Final = 4000
"""Largest width and height of a PNG."""
_PNG: Final = b"\x89PNG\r\n\x1a\n"
_ACTIVE: Final = frozenset({"script", "foreignObject", "iframe"})
_ADDRESS: Final = re.compile(r"@import|url\(\s*['\"]?(?!#)", re.IGNORECASE)


@dataclass(frozen=True)
class Logo:
    """``content`` is the file; ``size`` are width and height of a PNG in pixels, None for an SVG."""

    content: bytes
    media_type: str
    size: tuple[int, int] | None

    @property
    def data_url(self) -> str:
        """The file as a URL without an address."""
        return f"data:{self.media_type};base64,{base64.b64encode(self.content).decode('ascii')}"


def read_logo(path: Path) -> Logo:
    """Read and check a logo.

    Raises ``InvalidInput`` (``logo-invalid``) if it cannot be read, is larger than ``MAX_BYTES``, is neither PNG nor
    SVG, is damaged, or is an SVG with scripts or addresses of other files.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise _invalid(error.strerror or "it cannot be read") from error
    if len(content) > MAX_BYTES:
        raise _invalid(f"it has more than {MAX_BYTES // 1000} kB")
    if content.startswith(_PNG):
        return Logo(content, "image/png", _png_size(content))
    _check_svg(content)
    return Logo(content, "image/svg+xml", None)


def _png_size(content: bytes) -> tuple[int, int]:
    try:
        with Image.open(io.BytesIO(content), formats=["PNG"]) as picture:
            width, height = picture.size
            if max(width, height) > MAX_PIXELS:
                raise _invalid(f"{width} x {height} pixels; at most {MAX_PIXELS} in each direction")
            picture.load()
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise _invalid("the PNG is damaged") from error
    return width, height


def _check_svg(content: bytes) -> None:
    try:
        root = parse_xml(content.decode("utf-8"))
    except (BrokenXmlError, UnicodeDecodeError) as error:
        reason = str(error) if isinstance(error, BrokenXmlError) else "it is not UTF-8 text"
        raise _invalid(f"it is no PNG, and read as SVG {reason}") from error
    if _local_name(root.tag) != "svg":
        raise _invalid("it is neither PNG nor SVG")
    for element in root.iter():
        if _local_name(element.tag) in _ACTIVE:
            raise _invalid(f"the SVG contains <{_local_name(element.tag)}>")
        if _local_name(element.tag) == "style" and _ADDRESS.search(element.text or ""):
            raise _invalid("a style of the SVG names another file")
        for name, value in element.attrib.items():
            outside = _local_name(name) == "href" and not value.startswith(("#", "data:image/png"))
            if outside or _local_name(name).lower().startswith("on") or _ADDRESS.search(value):
                raise _invalid(f"the SVG contains {_local_name(name)}={value[:40]!r}")


def _local_name(name: str) -> str:
    """Name without the prefix of its namespace."""
    return name.rpartition(":")[2]


def _invalid(reason: str) -> InvalidInput:
    return InvalidInput(
        "logo-invalid", f"The logo of the laboratory cannot be used: {reason}.", [Fault(SETTING, reason)]
    )
