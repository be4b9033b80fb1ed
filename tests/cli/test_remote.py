"""``estimate --server`` asks the service in the right order and brings home what a run here would write."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from stridelab.cli import remote
from stridelab.cli.options import Delivery, EstimateRequest, Estimation, Preparation, Walk
from stridelab.client import ProblemError
from stridelab.errors import Busy, Forbidden, InvalidInput, NotEstimable, StridelabError, UnreadableFile
from stridelab.schemas.jobs import JobResult
from support.command_line import DONE, SAMPLE, ScriptedService, problem

WALK = Walk(SAMPLE / "recording.c3d")


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> ScriptedService:
    scripted = ScriptedService()
    monkeypatch.setattr(remote, "Client", scripted)
    return scripted


def ask(folder: Path, walk: Walk = WALK, **options: Any) -> JobResult:
    folder.mkdir(exist_ok=True)
    request = EstimateRequest(walk, **options)
    return remote.estimate_remotely(request, folder, Delivery(server="http://lab:8000", token="secret"))


def test_upload_job_and_download_in_order(service: ScriptedService, tmp_path: Path) -> None:
    result = ask(tmp_path, replace(WALK, height_m=1.7))
    names = [call for call, _ in service.calls]
    assert names == ["client", "upload", "submit", "events", "wait", "result", "download", "close"]
    calls = dict(service.calls)
    assert calls["client"] == ("http://lab:8000", "secret")
    assert calls["upload"][1].height_m == 1.7
    assert calls["submit"][1].recording_id == "id-of-recording.c3d"
    assert calls["submit"][2] is True
    assert {p.name for p in tmp_path.iterdir()} == {"com.csv", "result.json", "references.bib"}
    assert result.versions == DONE["result"]["versions"], "the versions are those of the machine that computed"


def test_static_trial_map_and_plates_are_set_before_the_job(service: ScriptedService, tmp_path: Path) -> None:
    static = tmp_path / "static.c3d"
    static.write_bytes(b"x")
    ask(tmp_path / "out", preparation=Preparation(static, ["l_asis=A"], [2]))
    patch = next(value for call, value in service.calls if call == "patch")[1]
    assert patch.static_recording_id == "id-of-static.c3d"
    assert patch.marker_map == {"l_asis": "A"}
    assert patch.plates[2].use is False


def test_a_marker_set_is_sent_as_the_map_of_the_recording(service: ScriptedService, tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text('name = "own"\nrequired = ["c7"]\n[unpaired]\nc7 = ["cv7", "CV7"]', encoding="utf-8")
    service.labels = ["CV7", "A"]
    ask(tmp_path / "out", preparation=Preparation(marker=["l_asis=A"], marker_set=own))
    patch = next(value for call, value in service.calls if call == "patch")[1]
    assert patch.marker_map == {"l_asis": "A", "c7": "CV7"}
    service.labels = ["A"]
    with pytest.raises(InvalidInput, match=r"does not fit recording\.c3d: no label for c7"):
        ask(tmp_path / "again", preparation=Preparation(marker_set=own))


@pytest.mark.parametrize(
    ("call", "status", "kind"),
    [
        ("upload", 422, UnreadableFile),
        ("submit", 422, InvalidInput),
        ("upload", 401, Forbidden),
        ("submit", 429, Busy),
        ("upload", 500, StridelabError),
    ],
)
def test_a_refusal_of_the_service_is_the_same_error_as_locally(
    service: ScriptedService, tmp_path: Path, call: str, status: int, kind: type[StridelabError]
) -> None:
    service.refuse[call] = ProblemError(problem(status, "some-code"), 3.0)
    with pytest.raises(kind) as refusal:
        ask(tmp_path)
    assert type(refusal.value) is kind
    assert refusal.value.code == "some-code"
    if kind is not Busy:
        assert refusal.value.faults[0].where == "w"


def test_a_failed_job_is_not_estimable_with_its_own_code(service: ScriptedService, tmp_path: Path) -> None:
    service.ends = ("failed", problem(422, "no-plates"))
    with pytest.raises(NotEstimable) as refusal:
        ask(tmp_path)
    assert refusal.value.code == "no-plates"


def test_a_cancelled_job_is_reported(service: ScriptedService, tmp_path: Path) -> None:
    service.ends = ("cancelled", None)
    with pytest.raises(StridelabError) as refusal:
        ask(tmp_path)
    assert refusal.value.code == "job-cancelled"


def test_ctrl_c_cancels_the_job_on_the_service(service: ScriptedService, tmp_path: Path) -> None:
    service.refuse["wait"] = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        ask(tmp_path)
    assert ("cancel", "j") in service.calls


@pytest.mark.parametrize("name", ["../evil", "a/b", "..", ""])
def test_file_names_of_the_service_do_not_leave_the_output_folder(
    service: ScriptedService, tmp_path: Path, name: str
) -> None:
    service.artifact = name
    with pytest.raises(StridelabError) as refusal:
        ask(tmp_path / "out")
    assert refusal.value.code == "service-not-understood"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_nothing_is_sent_for_invalid_options(service: ScriptedService, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput):
        ask(tmp_path, estimation=Estimation(latency="soon"))
    assert service.calls == []
