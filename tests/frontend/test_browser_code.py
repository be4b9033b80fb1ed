"""Third-party browser code comes from the installed packages and runs under a policy that names it."""

import re
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from types import SimpleNamespace

import httpx
import pytest
import zstandard

from stridelab_web import assets, viser_client
from support.fakes.service import FakeService
from support.fakes.web_app import make_client


def test_plotly_is_the_installed_one_and_can_be_kept(
    browse: Callable[[str], httpx.Response], fake: FakeService
) -> None:
    web = make_client(fake)
    for coding in ("gzip", "zstd"):
        answer = web.get("/static/plotly.min.js", headers={"Accept-Encoding": coding})
        assert answer.content == files("plotly").joinpath("package_data/plotly.min.js").read_bytes()
        assert (answer.headers["content-encoding"], answer.headers["vary"]) == (coding, "Accept-Encoding")
    again = web.get("/static/plotly.min.js", headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304


def test_styles_that_plotly_would_write_are_known() -> None:
    assert assets.plotly_style_ids()


def test_the_client_of_viser_is_unpacked() -> None:
    client = viser_client.installed_client()
    kinds = {client.media_types[name]: content for name, content in client.files.items()}
    assert set(kinds) == {"text/css", "text/javascript", "application/wasm"}
    for word in (b"nodePoseData", b"nodeRefFromName", b"poseUpdateState", b"requestRender", b"__viserZstdWasm"):
        assert word in kinds["text/javascript"], "static/js takes hold of it by this name"
    assert kinds["application/wasm"].startswith(b"\0asm")
    assert b"mantine" in kinds["text/css"]
    for name in client.files:
        assert f'"{viser_client.FOLDER}{name}"'.encode() in client.page
    assert client.page.count(b"<script") == 1, "and no script is written into the page itself"


def test_the_application_is_the_installed_one_but_for_five_kinds_of_places() -> None:
    html = files("viser").joinpath("client", "build", "index.html").read_bytes()
    script = re.search(rb'data-p="([^"]*)" data-ss="(\d+)" data-cs="(\d+)"', html)
    assert script is not None
    whole = zstandard.ZstdDecompressor().decompress(viser_client.decode_base88(script[1]))
    original = whole[int(script[2]) : int(script[2]) + int(script[3])]
    result = viser_client.installed_client()
    code = next(content for name, content in result.files.items() if name.endswith(".js"))
    before, after = viser_client.LATER
    assert (code.count(viser_client.NO_ENVIRONMENT), code.count(before), code.count(after)) == (1, 2, 2)
    (simplifier,) = viser_client.SIMPLIFIER.findall(original)
    assert simplifier.count(b"(function(){") == 1, "one module and nothing after it"
    assert simplifier.count(b"{") == simplifier.count(b"}")
    assert b"meshopt_simplify" in simplifier
    assert b"meshopt_simplify" not in code
    assert code.count(viser_client.NO_SIMPLIFIER) == 1
    back = code.replace(viser_client.NO_SIMPLIFIER, simplifier)
    back = back.replace(viser_client.NO_ENVIRONMENT, viser_client.DEFAULT_ENVIRONMENT)
    back = back.replace(before, b"=").replace(after, b"")
    assert viser_client.NO_DATA.join(viser_client.UNUSED_DATA.split(original)[::2]) == back
    assert viser_client.reduce_code(original) == code
    assert len(code) < len(original) - 190_000


@pytest.mark.parametrize("code", [b"{fog:null}", b"{environmentMap:null},{environmentMap:null}"])
def test_an_application_of_another_form_is_refused(code: bytes) -> None:
    with pytest.raises(ValueError, match="an unknown form"):
        viser_client.remove_environment(code)
    with pytest.raises(ValueError, match="an unknown form"):
        viser_client.defer_splats(code)
    with pytest.raises(ValueError, match="an unknown form"):
        viser_client.remove_data(code)
    with pytest.raises(ValueError, match="an unknown form"):
        viser_client.remove_simplifier(code)


def test_policy_of_the_frame_allows_files_of_this_service_alone() -> None:
    policy = viser_client.CONTENT_POLICY
    scripts = next(part for part in policy.split("; ") if part.startswith("script-src")).split()[1:]
    assert scripts == ["'self'", "'wasm-unsafe-eval'"]
    assert "default-src 'none'" in policy
    assert "http" not in policy


def test_a_page_of_another_form_is_refused() -> None:
    with pytest.raises(ValueError, match="an unknown form"):
        viser_client.unpack_page(b"<html><script>new()</script></html>")


@pytest.mark.parametrize("content", [b"", b"a", b"ab", b"abc", b"abcd", b"abcde\xff\x00"])
def test_base_88_is_undone(content: bytes) -> None:
    assert viser_client.decode_base88(encode88(content)) == content


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


def test_frame_loads_files_that_are_cached_for_ever(browse: Callable[[str], httpx.Response], fake: FakeService) -> None:
    client, web = viser_client.installed_client(), make_client(fake)
    answer = browse("/view/scene/recording/some/-/")
    assert answer.content == client.page
    assert answer.headers["content-security-policy"] == viser_client.CONTENT_POLICY
    for name, content in client.files.items():
        for coding in ("gzip", "zstd", "identity"):
            file = web.get(f"{viser_client.FOLDER}{name}", headers={"Accept-Encoding": coding})
            assert file.headers.get("content-encoding", "identity") == coding
            assert file.headers["content-type"].startswith(client.media_types[name])
            assert "immutable" in file.headers["cache-control"]
            assert (file.content if coding != "zstd" else decompressed(file)) == content
    assert web.get(f"{viser_client.FOLDER}1.0.0-0123456789abcdef.js").status_code == 404


def decompressed(file: httpx.Response) -> bytes:
    """Whether httpx has undone zstandard depends on what is installed beside it."""
    whole = file.content
    return whole if not whole.startswith(b"\x28\xb5\x2f\xfd") else zstandard.ZstdDecompressor().decompress(whole)


def test_viewers_that_open_together_compress_the_client_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def installed_client() -> SimpleNamespace:
        time.sleep(0.05)
        calls.append("read")
        return SimpleNamespace(files={"together.js": b"viser " * 1000})

    monkeypatch.setattr(viser_client, "installed_client", installed_client)
    with ThreadPoolExecutor(4) as threads:
        packed = [*threads.map(assets.viser_zstd, ["together.js"] * 4)]
    assert len(calls) == 1
    assert {zstandard.ZstdDecompressor().decompress(one) for one in packed} == {b"viser " * 1000}
