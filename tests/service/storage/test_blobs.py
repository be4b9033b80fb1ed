import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from obstore.store import S3Store

from stridelab.errors import InvalidInput, NotFound, Unavailable
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore
from support.service.external_services import ADDRESS, ObjectStoreHandler, object_store


@pytest.fixture(params=["folder", "object store"])
def any_store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[BlobStore]:
    if request.param == "folder":
        yield BlobStore.from_url((tmp_path / "blobs").as_uri())
    else:
        with object_store(tmp_path / "objects") as options:
            yield BlobStore.from_url(ADDRESS, options)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "blobs with space"


@pytest.fixture
def store(folder: Path) -> BlobStore:
    return BlobStore.from_url(folder.as_uri())


def test_file_comes_back_as_it_went_in(any_store: BlobStore, tmp_path: Path) -> None:
    store = any_store
    content = bytes(range(256)) * 40_000  # 10 MB: more than one part
    source, target = tmp_path / "in", tmp_path / "out"
    source.write_bytes(content)

    async def act() -> None:
        assert await store.put_file("recordings/ab/file.c3d", source) == len(content)
        assert await store.get_file("recordings/ab/file.c3d", target) == len(content)
        pieces = [chunk async for chunk in store.stream("recordings/ab/file.c3d")]
        assert len(pieces) > 1
        assert b"".join(pieces) == content
        info = await store.info("recordings/ab/file.c3d")
        assert info is not None
        assert info.bytes == len(content)

    asyncio.run(act())
    assert target.read_bytes() == content


@pytest.mark.parametrize("kept_bytes", [None, 0, 10])
def test_a_store_that_confirms_and_stores_nothing_is_unavailable(
    kept_bytes: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store_whole = ObjectStoreHandler._store

    def store_part(self: ObjectStoreHandler, path: Path, content: bytes) -> None:
        if kept_bytes is not None:
            store_whole(self, path, content[:kept_bytes])

    monkeypatch.setattr(ObjectStoreHandler, "_store", store_part)
    (tmp_path / "x").write_bytes(b"eleven byte")
    with object_store(tmp_path / "objects") as options:
        store = BlobStore.from_url(ADDRESS, options)
        with pytest.raises(Unavailable) as refused:
            asyncio.run(store.put_file("results/a/1/x.csv", tmp_path / "x"))
    assert refused.value.code == "storage-unavailable"


@pytest.mark.parametrize("sent_bytes", [0, 10])
def test_a_store_that_answers_with_a_part_of_a_file_is_unavailable(
    sent_bytes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x").write_bytes(b"eleven byte")
    answer_whole = ObjectStoreHandler._answer

    def answer_part(self: ObjectStoreHandler, status: int, content: bytes = b"", **about: Any) -> None:
        is_read = self.command == "GET" and "path" in about
        answer_whole(self, status, content[:sent_bytes] if is_read else content, **about)

    async def act(store: BlobStore) -> None:
        await store.put_file("results/a/1/x.csv", tmp_path / "x")
        monkeypatch.setattr(ObjectStoreHandler, "_answer", answer_part)
        with pytest.raises(Unavailable) as refused:
            await store.get_file("results/a/1/x.csv", tmp_path / "copy")
        assert refused.value.code == "storage-unavailable"

    with object_store(tmp_path / "objects") as options:
        asyncio.run(act(BlobStore.from_url(ADDRESS, options)))


def test_prefix_is_deleted_by_whole_segments(any_store: BlobStore, tmp_path: Path) -> None:
    store = any_store
    (tmp_path / "x").write_bytes(b"x")

    async def act() -> None:
        for key in ("results/a/1/x.csv", "results/a/1/deep/y.csv", "results/a/10/x.csv", "results/ab/1/x.csv"):
            await store.put_file(key, tmp_path / "x")
        assert await store.delete_prefix("results/a/1") == 2
        assert await store.delete_prefix("results/a/1") == 0
        assert [info.key async for info in store.list_prefix("results")] != []
        assert not await store.exists("results/a/1/x.csv")
        assert await store.exists("results/a/10/x.csv")
        assert await store.exists("results/ab/1/x.csv")
        await store.delete("results/ab/1/x.csv")
        await store.delete("results/ab/1/x.csv")
        assert [info.key async for info in store.list_prefix("results")] == ["results/a/10/x.csv"]

    asyncio.run(act())


def test_more_files_than_one_answer_holds_are_listed_and_deleted(any_store: BlobStore, tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"x")

    async def act() -> None:
        await asyncio.gather(*(any_store.put_file(f"results/a/1/{n}", tmp_path / "x") for n in range(1100)))
        assert len([info async for info in any_store.list_prefix("results")]) == 1100
        assert await any_store.delete_prefix("results/a") == 1100
        assert [info async for info in any_store.list_prefix("results")] == []

    asyncio.run(act())


def test_folder_keeps_no_empty_folders(store: BlobStore, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"x")

    async def act() -> None:
        await store.put_file("results/ab/1/x.csv", tmp_path / "x")
        await store.delete("results/ab/1/x.csv")

    asyncio.run(act())
    assert not (folder / "results" / "ab").exists()


def test_missing_blob_is_named_by_its_file(any_store: BlobStore, tmp_path: Path) -> None:
    with pytest.raises(NotFound, match=r"com\.csv") as caught:
        asyncio.run(any_store.get_file("results/a/1/com.csv", tmp_path / "out"))
    assert caught.value.code == "blob-not-found"


def test_failing_storage_is_unavailable(store: BlobStore, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"x")
    (folder / "results").write_text("a file where a folder should be", encoding="utf-8")
    with pytest.raises(Unavailable) as caught:
        asyncio.run(store.put_file("results/a/x", tmp_path / "x"))
    assert caught.value.code == "storage-unavailable"


@pytest.mark.parametrize(
    "key", ["", "/etc/passwd", "../x", "a/../b", "a//b", "a/", ".hidden", "a b", "ä", "a\0b", "x" * 500]
)
def test_keys_that_no_code_makes_are_refused(store: BlobStore, key: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        asyncio.run(store.exists(key))
    assert caught.value.code == "blob-key-invalid"


@given(st.text(max_size=20))
def test_no_key_leaves_the_folder(key: str) -> None:
    from stridelab.service.storage.blobs import _require_key

    try:
        _require_key(key)
    except InvalidInput:
        return
    root = Path("/store")
    assert (root / key).resolve().is_relative_to(root)
    assert not key.startswith("/")


@pytest.mark.parametrize("url", ["", "folder", "file://", "file://host/share", "ftp://x/y", "s3://", "memory:///"])
def test_only_folders_and_s3(url: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        BlobStore.from_url(url)
    assert caught.value.code == "blob-url-invalid"


def test_an_s3_url_makes_an_s3_store() -> None:
    store = BlobStore.from_url("s3://bucket/prefix")
    assert type(store.backend).__name__ == "S3Store"


def test_address_and_keys_of_the_object_store_come_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "credentials"
    file.write_text("# of the lab\nendpoint = http://objects:8333\naccess_key_id=lab\n\nsecret_access_key=a=b\n")
    settings = Settings(blob_url="s3://bucket/prefix", blob_credentials_file=file)
    store = BlobStore.from_url(settings.blob_address, settings.blob_options)
    assert isinstance(store.backend, S3Store)
    assert store.backend.config["endpoint"] == "http://objects:8333"
    assert store.backend.config["secret_access_key"] == "a=b"
    file.write_text("colour=blue\nsecret_access_key=hidden\n")
    with pytest.raises(InvalidInput, match="colour") as caught:
        BlobStore.from_url(settings.blob_address, settings.blob_options)
    assert caught.value.code == "blob-credentials-invalid"
    assert "hidden" not in caught.value.message
    file.write_text("")
    assert settings.blob_options == {}
