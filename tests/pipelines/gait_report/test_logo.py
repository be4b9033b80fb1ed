"""The logo of the laboratory: a PNG or an inert SVG, else a reason."""

import io
from pathlib import Path

import pytest
from PIL import Image

from stridelab.errors import InvalidInput
from stridelab.pipelines.gait_report.logo import MAX_BYTES, read_logo

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">{}</svg>'


def png(width: int, height: int) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (width, height), "navy").save(file, "PNG")
    return file.getvalue()


def written(folder: Path, content: bytes | str) -> Path:
    path = folder / "logo"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_a_png_has_a_size_and_an_address_of_its_own(tmp_path: Path) -> None:
    logo = read_logo(written(tmp_path, png(30, 20)))
    assert logo.size == (30, 20)
    assert logo.data_url.startswith("data:image/png;base64,iVBOR")


@pytest.mark.parametrize(
    "inside",
    ['<path d="M0 0h9v9"/>', "<style>.a{fill:url(#b)}</style>", '<use href="#b"/>', '<g fill="url(#b)"/>'],
)
def test_an_inert_svg_is_accepted(tmp_path: Path, inside: str) -> None:
    logo = read_logo(written(tmp_path, SVG.format(inside)))
    assert (logo.media_type, logo.size) == ("image/svg+xml", None)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (SVG.format("<script>alert(1)</script>"), "script"),
        (SVG.format('<g onload="alert(1)"/>'), "onload"),
        (SVG.format('<image href="http://example.org/a.png"/>'), "href"),
        (SVG.format('<image xlink:href="file:///etc/passwd"/>'), "href"),
        (SVG.format("<style>@import 'a.css'</style>"), "style"),
        (SVG.format('<g fill="url(http://example.org/a)"/>'), "fill"),
        ("<!DOCTYPE svg [<!ENTITY a 'b'>]>" + SVG.format("&a;"), "document type"),
        ("<html></html>", "neither"),
        ("a logo", "not well-formed"),
        (b"\xff\xd8\xff\xe0 a photograph", "UTF-8"),
        (png(30, 20)[:60], "damaged"),
        (png(4001, 1), "pixels"),
        (b"x" * (MAX_BYTES + 1), "kB"),
        (b"", "not well-formed"),
    ],
)
def test_what_is_no_logo_is_refused_with_the_reason(tmp_path: Path, content: bytes | str, reason: str) -> None:
    with pytest.raises(InvalidInput, match=reason) as refused:
        read_logo(written(tmp_path, content))
    assert refused.value.code == "logo-invalid"
    assert refused.value.faults[0].where == "STRIDELAB_LAB_LOGO"


def test_a_missing_logo_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="No such file"):
        read_logo(tmp_path / "missing.png")
