"""Bulk uploads: what is stored with whose name on it, and what hostile zips and tables come to."""

import hashlib
import io
import struct
import zipfile
from pathlib import Path
from typing import Any

import httpx
import pytest

from stridelab.client import Client
from stridelab.service.api.recordings import batch
from support.service.database import TestDatabases
from support.service.web_server import Served, served

BATCH = "/api/v1/recordings/batch"
MB = 1_000_000


@pytest.fixture(scope="module")
def service(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A service that takes 1 MB a file and 2 MB in all."""
    with (
        postgres.fresh() as url,
        served(url, tmp_path_factory.mktemp("data"), max_upload_mb=1, max_batch_mb=2) as running,
    ):
        yield running


def send(http: httpx.Client, *files: tuple[str, bytes], table: str | None = None) -> httpx.Response:
    parts: list[tuple[str, Any]] = [("file", (name, content)) for name, content in files]
    return http.post(BATCH, files=parts, data={} if table is None else {"subjects": table}, timeout=120.0)


def problem(answer: httpx.Response, status: int) -> Any:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    return answer.json()


def stored(answer: httpx.Response) -> Any:
    assert answer.status_code == 201, answer.text
    return answer.json()


def zipped(*members: tuple[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return content.getvalue()


def another(trial: bytes, n: int) -> bytes:
    """The same recording with other bytes: a C3D's tail is padding."""
    return trial + bytes([n]) * 512


def count_stored(service: Served, http: httpx.Client) -> tuple[int, int]:
    files = [key for key in service.stored_files() if key.startswith(("uploads/", "recordings/", "spool/"))]
    return len(http.get("/api/v1/recordings").json()["items"]), len(files)


def test_files_a_zip_and_a_table_can_be_uploaded_together(service: Served, http: httpx.Client, trial: Path) -> None:
    content = trial.read_bytes()
    lab = zipped(
        ("lab/P02.c3d", another(content, 2)),
        ("lab/standing.c3d", another(content, 3)),
        ("lab/notes.txt", b"nothing"),
        ("__MACOSX/lab/._P02.c3d", b"litter"),
    )
    table = (
        "file;subject;group;height_m;age;sex;static\n"
        "walk.c3d;P01;adults;1.80;31;m;\n"
        "lab/P02.c3d;P02;children;1.31;9;;standing.c3d\n"
    )
    answer = send(http, ("walk.c3d", content), ("lab.zip", lab), ("broken.c3d", b"no c3d at all"), table=table)
    assert answer.status_code == 201, answer.text
    body = answer.json()
    assert [one["filename"] for one in body["recordings"]] == ["walk.c3d", "P02.c3d", "standing.c3d"]
    walk, p02, standing = body["recordings"]
    assert walk["subject"]["name"] == "P01"
    assert walk["subject"]["sex"] == "male"
    assert p02["subject"]["height_m"] == 1.31
    assert p02["static_recording_id"] == standing["id"]
    assert body["studied"] == [walk["id"], p02["id"]]
    assert [(row["recording_id"], row["group"]) for row in body["subjects"]] == [
        (walk["id"], "adults"),
        (p02["id"], "children"),
    ]
    (refused,) = body["refused"]
    assert refused["filename"] == "broken.c3d"
    assert refused["message"]
    assert http.get(f"/api/v1/recordings/{p02['id']}/file").content == another(content, 2)
    assert not any(key.startswith("spool/") for key in service.stored_files())
    study_input = {"recording_ids": body["studied"], "subjects": body["subjects"]}
    assert http.post("/api/v1/jobs/study-population", json=study_input).status_code == 202
    twice = http.post("/api/v1/jobs/study-population", json={"recording_ids": [walk["id"], walk["id"]]})
    assert problem(twice, 422)["code"] == "invalid-request"
    unknown = http.post("/api/v1/jobs/study-population", json={"recording_ids": [walk["id"], "nobody"]})
    assert "nobody" in problem(unknown, 404)["detail"]


def test_a_reader_that_was_taken_over_cannot_pass_off_other_files(
    postgres: TestDatabases, tmp_path: Path, trial: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the child says of a file's place and hash would otherwise decide what this service stores and hands out."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    content = trial.read_bytes()
    with postgres.fresh() as url, served(url, tmp_path) as service, service.http() as http:
        monkeypatch.setattr(batch, "PARSE_BATCH", "support.service.hostile_readers:claim_another_file")
        assert problem(send(http, ("a.c3d", content)), 422)["code"] == "parser-crashed"
        assert service.stored_files() == set()
        monkeypatch.setattr(batch, "PARSE_BATCH", "support.service.hostile_readers:claim_another_hash")
        (recording,) = stored(send(http, ("a.c3d", content)))["recordings"]
        assert recording["sha256"] == hashlib.sha256(content).hexdigest()
        assert http.get(f"/api/v1/recordings/{recording['id']}/file").content == content


def test_the_same_bytes_twice_count_once(http: httpx.Client, trial: Path) -> None:
    content = another(trial.read_bytes(), 9)
    body = stored(send(http, ("a.c3d", content), ("b.c3d", content)))
    assert [one["filename"] for one in body["recordings"]] == ["a.c3d"]
    assert [(one["filename"], one["code"]) for one in body["refused"]] == [("b.c3d", "recording-twice")]
    again = stored(send(http, ("c.c3d", content)))
    ids = [body["recordings"][0]["id"], again["recordings"][0]["id"]]
    assert (
        problem(http.post("/api/v1/jobs/study-population", json={"recording_ids": ids}), 422)["code"]
        == "recording-twice"
    )


def test_the_client_uploads_many_files(service: Served, trial: Path, tmp_path: Path) -> None:
    paths = []
    for n in (20, 21):
        paths.append((f"walk {n}.c3d", tmp_path / f"{n}.c3d"))
        paths[-1][1].write_bytes(another(trial.read_bytes(), n))
    sent_bytes: list[int] = []
    with Client(service.base_url) as client:
        body = client.upload_batch(
            paths, "file,subject\nwalk 20.c3d,P20\n", progress=lambda done, _: sent_bytes.append(done)
        )
        assert [one.filename for one in body.recordings] == ["walk 20.c3d", "walk 21.c3d"]
        assert body.subjects[0].subject == "P20"
        assert client.upload_batch(paths[:1]).recordings[0].sha256 == body.recordings[0].sha256
    assert sent_bytes[-1] == sum(path.stat().st_size for _, path in paths)


def bomb() -> bytes:
    """3 MB of zeros in a few kB, with a directory that says 10 bytes."""
    honest = bytearray(zipped(("trial.c3d", b"\0" * (3 * MB))))
    for signature, offset in ((b"PK\x01\x02", 24), (b"PK\x03\x04", 22)):
        honest[honest.index(signature) + offset : honest.index(signature) + offset + 4] = struct.pack("<I", 10)
    return bytes(honest)


HOSTILE = {
    "zip-bomb": zipped(("trial.c3d", b"\0" * int(1.5 * MB))),
    "zip-too-many-files": zipped(*((f"{n}.c3d", b"x") for n in range(501))),
    "zip-several-tables": zipped(("a.c3d", b"x"), ("a.csv", b"file\n"), ("b.csv", b"file\n")),
}


@pytest.mark.parametrize("code", ["zip-bomb", "zip-too-many-files", "zip-several-tables"])
def test_nothing_of_a_hostile_zip_is_stored(service: Served, http: httpx.Client, trial: Path, code: str) -> None:
    before = count_stored(service, http)
    answer = send(http, ("fine.c3d", another(trial.read_bytes(), 40)), ("lab.zip", HOSTILE[code]))
    assert problem(answer, 422)["code"] == code
    assert count_stored(service, http) == before


def test_a_zip_with_a_false_size_is_refused(service: Served, http: httpx.Client) -> None:
    before = count_stored(service, http)
    assert problem(send(http, ("lab.zip", bomb())), 422)["code"] in {"zip-bomb", "zip-damaged", "nothing-readable"}
    assert count_stored(service, http) == before


def test_paths_in_a_zip_do_not_leave_the_folder(
    service: Served, http: httpx.Client, trial: Path, tmp_path: Path
) -> None:
    content = trial.read_bytes()
    escape = f"../../../../../../..{tmp_path}/escaped.c3d"
    lab = zipped((escape, another(content, 50)), ("/etc/absolute.c3d", another(content, 51)))
    body = stored(send(http, ("lab.zip", lab)))
    assert [one["filename"] for one in body["recordings"]] == ["escaped.c3d", "absolute.c3d"]
    assert list(tmp_path.iterdir()) == []
    assert not Path("/etc/absolute.c3d").exists()


def test_a_zip_in_a_zip_is_one_trial_and_deeper_ones_are_not_opened(
    service: Served, http: httpx.Client, trial: Path
) -> None:
    before = count_stored(service, http)
    nested = zipped(("inner.zip", zipped(("deep.c3d", trial.read_bytes()))))
    refusal_body = problem(send(http, ("lab.zip", nested)), 422)
    assert refusal_body["code"] == "nothing-readable"
    assert refusal_body["errors"][0]["where"] == "inner.zip"
    assert count_stored(service, http) == before


@pytest.mark.parametrize(
    ("table", "where"),
    [
        ("file,height_m\nwalk.c3d,171\n", "line 2, column height_m"),
        ("file,age\nwalk.c3d,thirty\n", "line 2, column age"),
        ("file,sex\nwalk.c3d,x\n", "line 2, column sex"),
        ("file,size\nwalk.c3d,1.7\n", "line 1, column 2"),
        ("subject,height_m\nP01,1.7\n", "line 1"),
        ("file,subject\nwalk.c3d,P01,more\n", "line 2"),
        ("file,subject\nother.c3d,P01\n", "line 2, column file"),
        ("file,subject\nwalk.c3d,P01\n\nwalk.c3d,P02\n", "line 4, column file"),
        ("file,static\nwalk.c3d,standing.c3d\n", "line 2, column static"),
        ('file,subject\nwalk.c3d,"P01\n', "subjects"),
        ("file,subject\n,P01\n", "line 2, column file"),
    ],
)
def test_a_bad_table_names_line_and_column(http: httpx.Client, trial: Path, table: str, where: str) -> None:
    refusal_body = problem(send(http, ("walk.c3d", trial.read_bytes()), table=table), 422)
    assert refusal_body["code"] == "subject-table-invalid"
    assert where in {error["where"] for error in refusal_body["errors"]}


def test_two_tables_are_refused(http: httpx.Client, trial: Path) -> None:
    lab = zipped(("walk.c3d", trial.read_bytes()), ("people.csv", b"file\nwalk.c3d\n"))
    assert problem(send(http, ("lab.zip", lab), table="file\nwalk.c3d\n"), 422)["code"] == "subject-table-twice"


def test_the_form_has_limits(service: Served, http: httpx.Client, trial: Path) -> None:
    before = count_stored(service, http)
    assert problem(send(http, ("big.c3d", b"\0" * (2 * MB + 300_000))), 413)["code"] == "upload-too-large"
    assert problem(send(http, ("walk.c3d", trial.read_bytes()), table="x" * (MB + 1)), 422)["code"] == "invalid-request"
    without = http.post(BATCH, files={"subjects": (None, "file\n")})
    assert problem(without, 422)["code"] == "file-missing"
    assert problem(send(http, ("empty.c3d", b"")), 422)["code"] == "nothing-readable"
    large = send(http, ("walk.c3d", another(trial.read_bytes(), 60)), ("large.c3d", b"\0" * (MB + 100_000)))
    assert [one["code"] for one in large.json()["refused"]] == ["upload-too-large"]
    assert count_stored(service, http)[0] == before[0] + 1
