"""Third-party browser code comes from the installed packages and runs under a policy that names it."""

import gzip
import json
import re
from collections.abc import Callable, Iterator
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import httpx
import pytest
import zstandard

from store_viser_client import sources_sha256
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


def test_the_client_of_viser_was_built_from_what_is_here() -> None:
    """Who changes viser's version, the patch or a replacement runs scripts/viser-client."""
    built_from = json.loads((viser_client.BUILT / "built_from.json").read_text())
    assert built_from == {"viser": version("viser"), "sources_sha256": sources_sha256()}


def test_the_client_of_viser_has_no_panel_and_names_its_licences() -> None:
    client = viser_client.built_client()
    script = gzip.decompress(client.script_gzip)
    for word in (b"nodePoseData", b"nodeRefFromName", b"poseUpdateState", b"requestRender", b"viserScene"):
        assert word in script, "static/js takes hold of it by this name"
    for word in (b"mantine", b"tabler", b"meshopt"):
        assert word not in script
    assert len(client.script_gzip) < 370_000
    assert client.page.count(b"<script") == 1
    assert f'src="{viser_client.FOLDER}{client.name}"'.encode() in client.page
    licences = (viser_client.BUILT / "licenses.md").read_text()
    for name in ("viser", "three", "react", "react-dom", "@react-three/fiber", "zstddec", "@msgpack/msgpack"):
        assert f"## {name}" in licences


def test_the_scene_adds_only_nodes_that_the_client_draws() -> None:
    """Those of frontend/viser_client/replacements/nothing.ts would not be seen."""
    drawn = {"frame", "grid", "icosphere", "image", "label", "light_ambient", "mesh_simple", "point_cloud"}
    sources = (Path(viser_client.__file__).parent / "viewer").glob("*.py")
    added = {name for path in sources for name in re.findall(r"\.add_([a-z_]+)\(", path.read_text())}
    assert added == drawn


@pytest.fixture
def unread_client() -> Iterator[None]:
    viser_client.built_client.cache_clear()
    yield
    viser_client.built_client.cache_clear()


@pytest.mark.usefixtures("unread_client")
def test_a_client_for_another_viser_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viser_client, "version", lambda _: "0.9.9")
    with pytest.raises(ValueError, match=r"built for viser .*scripts/viser-client"):
        viser_client.built_client()


def test_policy_of_the_frame_allows_files_of_this_service_alone() -> None:
    policy = viser_client.CONTENT_POLICY
    scripts = next(part for part in policy.split("; ") if part.startswith("script-src")).split()[1:]
    assert scripts == ["'self'", "'wasm-unsafe-eval'"]
    assert "default-src 'none'" in policy
    assert "http" not in policy


def test_frame_loads_a_script_that_is_cached_for_ever(
    browse: Callable[[str], httpx.Response], fake: FakeService
) -> None:
    client, web = viser_client.built_client(), make_client(fake)
    answer = browse("/view/scene/recording/some/-/")
    assert answer.content == client.page
    assert answer.headers["content-security-policy"] == viser_client.CONTENT_POLICY
    for coding in ("gzip", "zstd", "identity"):
        file = web.get(f"{viser_client.FOLDER}{client.name}", headers={"Accept-Encoding": coding})
        assert file.headers.get("content-encoding", "identity") == coding
        assert file.headers["content-type"].startswith("text/javascript")
        assert "immutable" in file.headers["cache-control"]
        script = decompressed(file) if coding == "zstd" else file.content
        assert gzip.decompress(client.script_gzip) == script
    assert web.get(f"{viser_client.FOLDER}1.0.0-0123456789abcdef.js").status_code == 404


def decompressed(file: httpx.Response) -> bytes:
    """Whether httpx has undone zstandard depends on what is installed beside it."""
    whole = file.content
    return whole if not whole.startswith(b"\x28\xb5\x2f\xfd") else zstandard.ZstdDecompressor().decompress(whole)
