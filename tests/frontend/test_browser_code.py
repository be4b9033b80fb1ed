"""Third-party browser code comes from the installed packages and runs under a policy that names it."""

import base64
import gzip
import hashlib
from collections.abc import Callable
from importlib.resources import files

import httpx
import pytest

from stridelab_web import assets, viser_client
from support.fake_service import FakeService
from support.web import make_client


def test_plotly_is_the_installed_one_and_can_be_kept(
    browse: Callable[[str], httpx.Response], fake: FakeService
) -> None:
    web = make_client(fake)
    answer = web.get("/static/plotly.min.js")
    assert answer.content == files("plotly").joinpath("package_data/plotly.min.js").read_bytes()
    assert answer.headers["content-encoding"] == "gzip"
    again = web.get("/static/plotly.min.js", headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304


def test_styles_that_plotly_would_write_are_known() -> None:
    assert assets.plotly_style_ids()


def test_application_inside_the_viser_page_is_found() -> None:
    loader, application = viser_client.scripts(viser_client.page())
    assert b"ZSTD_decompress" in loader
    for name in (b"nodePoseData", b"nodeRefFromName", b"poseUpdateState", b"requestRender"):
        assert name in application, "static/js/scene.js moves nodes by this name"


def test_policy_of_the_frame_allows_exactly_those_two_scripts() -> None:
    policy = viser_client.content_policy()
    scripts = next(part for part in policy.split("; ") if part.startswith("script-src")).split()[1:]
    hashes = [
        f"'sha256-{base64.b64encode(hashlib.sha256(s).digest()).decode()}'"
        for s in viser_client.scripts(viser_client.page())
    ]
    assert scripts == [*hashes, "'wasm-unsafe-eval'"]
    assert "default-src 'none'" in policy
    assert "http" not in policy


def test_a_page_of_another_form_is_refused() -> None:
    with pytest.raises(ValueError, match="another form"):
        viser_client.scripts(b"<html><script>new()</script></html>")


@pytest.mark.parametrize("content", [b"", b"a", b"ab", b"abc", b"abcd", b"abcde\xff\x00"])
def test_base_88_is_undone(content: bytes) -> None:
    assert viser_client.decode88(encode88(content)) == content


def encode88(content: bytes) -> bytes:
    """The encoder of viser's build, written from its description: 4 bytes are 5 characters, k bytes are k + 1."""
    text = bytearray()
    for start in range(0, len(content), 4):
        part = content[start : start + 4]
        value, digits = int.from_bytes(part, "big"), []
        for _ in range(len(part) + 1):
            value, digit = divmod(value, len(viser_client.ALPHABET))
            digits.append(viser_client.ALPHABET[digit])
        text += bytes(reversed(digits))
    return bytes(text)


def test_frame_is_the_installed_page(browse: Callable[[str], httpx.Response]) -> None:
    answer = browse("/view/scene/recording/some/-/")
    assert answer.content == viser_client.page() == gzip.decompress(viser_client.page_gzip())
    assert answer.headers["content-security-policy"] == viser_client.content_policy()


def test_frame_is_sent_once(fake: FakeService) -> None:
    web = make_client(fake)
    tag = web.get("/view/scene/recording/some/-/").headers["etag"]
    again = web.get("/view/scene/plan/other/-/", headers={"If-None-Match": tag})
    assert (again.status_code, again.content) == (304, b"")
