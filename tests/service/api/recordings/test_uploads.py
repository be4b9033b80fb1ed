"""Uploads: what is stored, what is refused, and that nothing is half stored."""

import hashlib
import io
import socket
import zipfile
from pathlib import Path

import httpx
import psutil
import pyarrow.parquet as pq
import pytest

from stridelab.service.api.recordings import endpoints, parse
from stridelab.service.api.recordings import service as storing
from stridelab.service.filenames import safe_filename
from support.service.database import TestDatabases
from support.service.stored_rows import add_recording, facts
from support.service.web_server import Served, fault_places, refusal_code, served, upload

RECORDINGS = "/api/v1/recordings"


async def understood(_parts: object, folder: Path, *_: object, **_options: object) -> parse.Parsed:
    (folder / "tracks.parquet").write_bytes(b"PAR1")
    return parse.Parsed(facts(), folder / "tracks.parquet")


@pytest.fixture
def parsed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is uploaded counts as understood: for tests of what comes after, or before."""
    monkeypatch.setattr(endpoints, "parse_recording", understood)


def test_an_upload_is_understood_when_it_is_answered(http: httpx.Client, service: Served, trial: Path) -> None:
    content = trial.read_bytes()
    answer = upload(http, content, height_m="1.71", sex="female", subject_name="P07", mass_kg="")
    assert answer.status_code == 201, answer.text
    body = answer.json()
    assert answer.headers["location"] == f"{RECORDINGS}/{body['id']}"
    assert body["sha256"] == hashlib.sha256(content).hexdigest()
    assert body["bytes"] == len(content)
    assert body["n_markers"] == 12
    assert body["marker_rate_hz"] == 100.0
    assert body["subject"] == {"name": "P07", "height_m": 1.71, "mass_kg": None, "sex": "female", "age_years": None}
    assert http.get(f"{RECORDINGS}/{body['id']}").json() == body
    file = http.get(f"{RECORDINGS}/{body['id']}/file")
    assert file.content == content
    assert file.headers["content-disposition"].startswith('attachment; filename="walk.c3d"')
    tracks = pq.read_table(io.BytesIO(http.get(f"{RECORDINGS}/{body['id']}/tracks.parquet").content))
    assert tracks.num_rows == body["n_frames"]
    assert {"time_s", "LASI_x_m", "LASI_z_m"} <= set(tracks.column_names)
    assert not any(key.startswith("spool/") for key in service.stored_files())


@pytest.mark.usefixtures("parsed_at_once")
def test_the_same_file_twice_is_two_recordings_and_one_blob(http: httpx.Client, service: Served) -> None:
    content = b"the same" * 1000
    first = upload(http, content).json()
    before = service.stored_files()
    again = upload(http, content, "other name.c3d").json()
    assert again["id"] != first["id"]
    assert again["sha256"] == first["sha256"] == hashlib.sha256(content).hexdigest()
    (added,) = service.stored_files() - before
    assert added.startswith(f"recordings/{again['id']}/")
    assert http.delete(f"{RECORDINGS}/{first['id']}").status_code == 204
    assert http.get(f"{RECORDINGS}/{again['id']}/file").content == content
    assert http.delete(f"{RECORDINGS}/{again['id']}").status_code == 204
    assert f"uploads/{first['sha256']}" not in service.stored_files()


def reused(http: httpx.Client, content: bytes, name: str = "walk.c3d") -> httpx.Response:
    return http.post(RECORDINGS, params={"reuse": "true"}, files={"file": (name, content)})


@pytest.mark.usefixtures("parsed_at_once")
def test_the_same_file_again_returns_the_newest_recording_if_reuse_is_requested(
    http: httpx.Client, service: Served
) -> None:
    content = b"once and again" * 1000
    first = reused(http, content)
    assert "stridelab-reused" not in first.headers, "there is no earlier one"
    newest = upload(http, content, "walk 2.c3d").json()
    before, listed = service.stored_files(), http.get(RECORDINGS).json()
    again = reused(http, content, "other name.c3d")
    assert again.headers["stridelab-reused"] == "true"
    assert again.json() == newest
    assert again.headers["location"] == f"{RECORDINGS}/{newest['id']}"
    assert (service.stored_files(), http.get(RECORDINGS).json()) == (before, listed)
    other = reused(http, content + b"!").json()["id"]
    assert other not in {first.json()["id"], newest["id"]}, "other bytes are another recording"
    for recording in (first.json(), newest):
        http.delete(f"{RECORDINGS}/{recording['id']}")
    anew = reused(http, content)
    assert anew.status_code == 201
    assert "stridelab-reused" not in anew.headers, "the earlier ones are deleted"


@pytest.mark.usefixtures("parsed_at_once")
def test_the_same_file_again_repairs_the_damaged_one(http: httpx.Client, service: Served) -> None:
    content = b"soon damaged" * 1000
    recording = reused(http, content).json()
    (service.data / "blobs" / f"uploads/{recording['sha256']}").write_bytes(b"damaged")
    assert reused(http, content).json()["id"] == recording["id"]
    assert http.get(f"{RECORDINGS}/{recording['id']}/file").content == content


def test_somebody_elses_upload_of_the_same_bytes_is_not_reused(http: httpx.Client, service: Served) -> None:
    content = b"of a colleague"
    digest = hashlib.sha256(content).hexdigest()
    for owner in ("colleague", None):
        columns = {"owner": owner, "bundled": owner is None, "blob_key": f"uploads/{digest}"}
        service.run(add_recording(service.parts, content=content, **columns))
    assert refusal_code(reused(http, content))[0] == 422, "it is read like any new file, and is no recording"


@pytest.mark.usefixtures("parsed_at_once")
def test_the_last_recording_takes_its_file_along(http: httpx.Client, service: Served, trial: Path) -> None:
    before = service.stored_files()
    content = trial.read_bytes() + b"\0" * 512
    recording = upload(http, content).json()
    assert f"uploads/{recording['sha256']}" in service.stored_files()
    assert http.delete(f"{RECORDINGS}/{recording['id']}").status_code == 204
    assert service.stored_files() == before
    for path in ("", "/file", "/tracks.parquet"):
        assert refusal_code(http.get(f"{RECORDINGS}/{recording['id']}{path}")) == (404, "recording-not-found")
    assert refusal_code(http.delete(f"{RECORDINGS}/{recording['id']}")) == (404, "recording-not-found")


def damaged() -> dict[str, bytes]:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zip_file:
        zip_file.writestr("readme.txt", "no trial")
    return {
        "text": b"time,x,y\n0,1,2\n",
        "zip without a trial": archive.getvalue(),
        "head of a C3D only": b"\x02\x50" + b"\0" * 510,
    }


@pytest.mark.parametrize("name", damaged())
def test_an_unreadable_file_is_refused_and_not_stored(http: httpx.Client, service: Served, name: str) -> None:
    before, rows = service.stored_files(), len(http.get(RECORDINGS).json()["items"])
    answer = upload(http, damaged()[name])
    assert answer.status_code == 422
    assert answer.json()["code"] not in {"internal-error", "invalid-request"}
    assert answer.json()["errors"]
    assert service.stored_files() == before
    assert len(http.get(RECORDINGS).json()["items"]) == rows


def test_a_cut_off_trial_is_refused(http: httpx.Client, trial: Path) -> None:
    content = trial.read_bytes()
    assert upload(http, content[: len(content) // 2]).status_code == 422


def test_an_empty_file_and_a_missing_file(http: httpx.Client) -> None:
    assert refusal_code(upload(http, b"")) == (422, "empty-file")
    assert refusal_code(http.post(RECORDINGS, files={"data": ("a.c3d", b"x")})) == (422, "file-missing")
    twice = [("file", ("a.c3d", b"x")), ("file", ("b.c3d", b"x"))]
    assert refusal_code(http.post(RECORDINGS, files=twice)) == (422, "invalid-request")


@pytest.mark.parametrize(
    ("media_type", "content", "expected"),
    [
        ("application/json", b"{}", (415, "unsupported-media-type")),
        ("multipart/form-data", b"x", (415, "unsupported-media-type")),
        ("application/octet-stream", b"\x02\x50", (415, "unsupported-media-type")),
        ("multipart/form-data; boundary=b", b"nonsense", (400, "malformed-request")),
        ("multipart/form-data; boundary=b", b"", (400, "malformed-request")),
        ("multipart/form-data; boundary=b", b"--b--\r\n", (422, "file-missing")),
        (
            "multipart/form-data; boundary=b",
            b'--b\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\ncut off',
            (400, "malformed-request"),
        ),
    ],
)
def test_bodies_that_are_no_form_are_refused(
    http: httpx.Client, media_type: str, content: bytes, expected: tuple[int, str]
) -> None:
    assert refusal_code(http.post(RECORDINGS, content=content, headers={"Content-Type": media_type})) == expected


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("height_m", "171"),
        ("height_m", "tall"),
        ("height_m", "nan"),
        ("height_m", "-1.7"),
        ("mass_kg", "inf"),
        ("mass_kg", "0"),
        ("age_years", "200"),
        ("sex", "f"),
        ("subject_name", "a\x00b"),
        ("subject_name", "x" * 81),
        ("shoe_size", "42"),
    ],
)
def test_absurd_form_fields_are_named(http: httpx.Client, trial: Path, field: str, value: str) -> None:
    answer = upload(http, trial.read_bytes(), **{field: value})
    assert refusal_code(answer) == (422, "invalid-request")
    assert fault_places(answer) == [field]


def test_all_absurd_fields_are_named_at_once(http: httpx.Client, trial: Path) -> None:
    answer = upload(http, trial.read_bytes(), height_m="171", mass_kg="x", shoe_size="42")
    assert set(fault_places(answer)) == {"height_m", "mass_kg", "shoe_size"}


def test_a_field_that_is_too_long(http: httpx.Client) -> None:
    assert refusal_code(upload(http, b"x", subject_name="x" * 5000)) == (422, "invalid-request")


@pytest.mark.parametrize(
    ("claimed", "listed_name"),
    [
        ("../../etc/passwd", "passwd"),
        ("C:\\Users\\someone\\walk.c3d", "walk.c3d"),
        ("/absolute.c3d", "absolute.c3d"),
        ("..", "recording"),
        ("", "recording"),
        ("a\r\nSet-Cookie: x=1.c3d", "aSet-Cookie x=1.c3d"),
        ("a\x00b.c3d", "ab.c3d"),
        ("\u202egpj.c3d", "gpj.c3d"),
        ('quo"te.c3d', "quote.c3d"),
        ("<script>.c3d", "script.c3d"),
        ("Prüfling 7.c3d", "Prüfling 7.c3d"),
        ("x" * 300 + ".c3d", "x" * 116 + ".c3d"),
    ],
)
def test_hostile_file_names_become_harmless(claimed: str, listed_name: str) -> None:
    assert safe_filename(claimed) == listed_name


@pytest.mark.usefixtures("parsed_at_once")
def test_a_hostile_name_does_no_harm_on_its_way_back(http: httpx.Client, trial: Path) -> None:
    recording = upload(http, trial.read_bytes(), "../../Gang Ü;\\x.c3d").json()
    assert recording["filename"] == "x.c3d"
    recording = upload(http, trial.read_bytes(), "Gang Ü; a=b.c3d").json()
    header = http.get(f"{RECORDINGS}/{recording['id']}/file").headers["content-disposition"]
    assert header == "attachment; filename=\"Gang _; a=b.c3d\"; filename*=UTF-8''Gang%20%C3%9C%3B%20a%3Db.c3d"


def raw_upload(service: Served, length: int | None, body_bytes: int, *headers: bytes) -> tuple[bytes, int]:
    """Send a form by hand, announcing ``length`` or in chunks, until something is answered.

    Returns the answer and the bytes that had been sent when it came.
    """
    piece = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.c3d"\r\n\r\n'
    announced = b"Transfer-Encoding: chunked" if length is None else b"Content-Length: %d" % length
    multipart = b"Content-Type: multipart/form-data; boundary=b"
    head = [b"POST /api/v1/recordings HTTP/1.1", b"Host: 127.0.0.1", multipart, announced, *headers]
    place = httpx.URL(service.base_url)
    answer, n_sent = b"", 0
    with socket.create_connection((place.host, place.port)) as wire:
        wire.sendall(b"\r\n".join(head) + b"\r\n\r\n")
        while not answer and n_sent < body_bytes:
            wire.settimeout(30)
            wire.sendall(b"%x\r\n%s\r\n" % (len(piece), piece) if length is None else piece)
            n_sent += len(piece)
            piece = b"\0" * 200_000
            answer = hear(wire, 0.02)
        return answer or hear(wire, 30.0), n_sent


def hear(wire: socket.socket, patience_s: float) -> bytes:
    wire.settimeout(patience_s)
    try:
        return wire.recv(65536)
    except TimeoutError:
        return b""


@pytest.fixture(scope="module")
def narrow(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory):  # type: ignore[no-untyped-def]
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data"), max_upload_mb=2) as running:
        yield running


def test_an_upload_over_the_limit_is_refused_from_its_announcement(service: Served) -> None:
    answer, n_sent = raw_upload(service, 128_000_000 + 200_000, 128_200_000)
    assert answer.startswith(b"HTTP/1.1 413 ")
    assert n_sent < 5_000_000
    # A client that asks first need not send a byte of it.
    answer, n_sent = raw_upload(service, 128_200_000, 0, b"Expect: 100-continue")
    assert answer.startswith(b"HTTP/1.1 413 ")
    assert n_sent == 0


def test_an_upload_over_the_limit_is_refused_at_the_byte_that_exceeds_it(narrow: Served) -> None:
    answer, n_sent = raw_upload(narrow, None, 60_000_000)
    assert answer.startswith(b"HTTP/1.1 413 ")
    assert n_sent < 20_000_000
    assert narrow.stored_files() == set()


def test_a_client_that_sends_on_still_receives_the_refusal(narrow: Served) -> None:
    with narrow.http() as http:
        for _ in range(3):
            assert refusal_code(upload(http, b"\0" * 30_000_000)) == (413, "upload-too-large")
        for _ in range(3):
            answer = http.post(RECORDINGS, content=(b"\0" * 1_000_000 for _ in range(30)))
            assert refusal_code(answer) == (415, "unsupported-media-type")


@pytest.mark.usefixtures("parsed_at_once")
def test_a_large_upload_is_never_held_in_memory(service: Served) -> None:
    process = psutil.Process()
    before = process.memory_info().rss
    peak = before

    def pieces():  # type: ignore[no-untyped-def]
        nonlocal peak
        yield b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.c3d"\r\n\r\n'
        block = b"\0" * 1_000_000
        for _ in range(127):
            yield block
            peak = max(peak, process.memory_info().rss)
        yield b"\r\n--b--\r\n"

    headers = {"Content-Type": "multipart/form-data; boundary=b"}
    with service.http() as http:
        answer = http.post(RECORDINGS, content=pieces(), headers=headers)
    assert answer.status_code == 201
    assert answer.json()["bytes"] == 127_000_000
    assert peak - before < 40_000_000


def test_a_full_disk_is_reported(postgres: TestDatabases, tmp_path: Path) -> None:
    with postgres.fresh() as url, served(url, tmp_path, min_free_disk_mb=10**9) as full, full.http() as http:
        assert refusal_code(upload(http, b"x" * 10)) == (507, "disk-full")
        assert full.stored_files() == set()


def test_a_file_that_breaks_its_reader_breaks_nothing_else(
    postgres: TestDatabases, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    with postgres.fresh() as url, served(url, tmp_path, parse_timeout_s=1.0) as service, service.http() as http:
        for reader, code in (
            ("segfault", "parser-crashed"),
            ("hang", "parser-timed-out"),
            ("stumble", "unreadable-file"),
            ("refuse", "no-plates"),
        ):
            monkeypatch.setattr(parse, "PARSE_UPLOAD", f"support.service.computations:{reader}")
            assert refusal_code(upload(http, b"x" * 10)) == (422, code)
            assert service.stored_files() == set()
            assert http.get("/api/v1/health").status_code == 200


@pytest.mark.usefixtures("parsed_at_once")
def test_a_failing_store_leaves_nothing(service: Served, trial: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = service.stored_files()

    def broken(_: object) -> None:
        raise RuntimeError("after the files, before the end of the transaction")

    monkeypatch.setattr(storing, "recording_of", broken)
    with service.http() as http:
        assert upload(http, trial.read_bytes() + b"\0" * 1024).status_code == 500
        assert service.stored_files() == before


TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100\t100\t50\t1\tmm\n"
    "Frame#\tTime\tLASI\n\t\tX1\tY1\tZ1\n\n"
) + "".join(f"{i + 1}\t{i / 100}\t{i}\t900\t50\n" for i in range(50))


def test_a_trc_alone_is_a_recording_without_plates(http: httpx.Client) -> None:
    answer = upload(http, TRC.encode(), "standing 1.trc")
    assert answer.status_code == 201, answer.text
    body = answer.json()
    assert (body["filename"], body["plates"], body["labels"]) == ("standing 1.trc", [], ["LASI"])
    assert (body["n_frames"], body["marker_rate_hz"]) == (50, 100.0)
    assert "no-force-file" in {remark["code"] for remark in body["warnings"]}
    assert http.get(f"{RECORDINGS}/{body['id']}/file").content == TRC.encode()


def test_a_broken_trc_is_refused_by_its_name_and_line(http: httpx.Client, service: Served) -> None:
    before = service.stored_files()
    answer = upload(http, TRC.replace("\n9\t0.08\t8", "\n9\t0.08\tx").encode(), "walk 07.trc")
    assert refusal_code(answer) == (422, "trc-broken")
    assert "walk 07.trc is broken: line 15, column 3 holds 'x'" in answer.json()["detail"]
    assert fault_places(answer) == ["walk 07.trc"]
    assert service.stored_files() == before
