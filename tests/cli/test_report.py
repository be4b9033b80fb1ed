"""``stridelab report``: files, groups and exit codes; ``sl.gait_report`` gives the same."""

import json
from pathlib import Path

import pytest

import stridelab as sl
from stridelab.errors import InvalidInput
from stridelab.service.local_recordings import people_in
from support.command_line import SAMPLE, Run

TRIAL = SAMPLE / "recording.c3d"


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """A walk and a file that is none."""
    folder = tmp_path / "session"
    folder.mkdir()
    (folder / "walk.c3d").write_bytes(TRIAL.read_bytes())
    (folder / "broken.c3d").write_bytes(b"no recording")
    (folder / "notes.txt").write_text("not a recording")
    return folder


@pytest.fixture
def earlier_trial(tmp_path: Path) -> Path:
    """The same walk as another file: unlike the first by bytes behind its end."""
    path = tmp_path / "earlier.c3d"
    path.write_bytes(TRIAL.read_bytes() + bytes(512))
    return path


def test_a_folder_becomes_a_page_and_a_pdf(run: Run, session: Path, tmp_path: Path) -> None:
    ran = run("report", session, "--pdf", "--title", "Walk 7", "-o", "out")
    assert ran.code == 0, ran.err
    assert "left out broken.c3d" in ran.out
    assert (tmp_path / "out" / "report.pdf").read_bytes().startswith(b"%PDF-")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "<h1>Walk 7</h1>" in page
    assert "broken.c3d" in page
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["kind"] == "gait-report"
    assert {one["name"] for one in result["artifacts"]} >= {"report.html", "report.pdf", "measures.csv"}
    assert all(path.is_file() for path in (tmp_path / "out").iterdir())


def test_without_the_option_there_is_no_pdf(run: Run, tmp_path: Path) -> None:
    assert run("report", TRIAL).code == 0
    names = {path.name for path in (tmp_path / "report").iterdir()}
    assert "report.html" in names
    assert "report.pdf" not in names
    result = json.loads((tmp_path / "report" / "result.json").read_text())
    assert "report.pdf" not in {one["name"] for one in result["artifacts"]}
    assert run("report", TRIAL).code == 6, "an earlier result is not replaced unasked"


def test_the_lab_is_named_by_settings(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from stridelab.service.settings import current_settings

    monkeypatch.setenv("STRIDELAB_LAB_NAME", "Lab of <gait>")
    monkeypatch.setenv("STRIDELAB_LAB_LOGO", str(tmp_path / "missing.png"))
    current_settings.cache_clear()
    try:
        ran = run("report", TRIAL, "--json")
    finally:
        current_settings.cache_clear()
    assert ran.code == 0
    assert "Lab of &lt;gait&gt;" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "logo-not-used" in {one["code"] for one in json.loads(ran.out)["summary"]["warnings"]}


def test_a_person_is_compared_with_the_people_of_a_folder(run: Run, session: Path, earlier_trial: Path) -> None:
    (session / "walk.c3d").write_bytes(TRIAL.read_bytes() + bytes(1024))
    ran = run("report", TRIAL, "--reference", session, "--before", earlier_trial, "--json")
    assert ran.code == 0, ran.err
    summary = json.loads(ran.out)["summary"]
    assert summary["reference_people"] == 1
    assert [one["filename"] for one in summary["left_out"]] == ["broken.c3d"]
    assert {one["change"] for one in summary["changes"]} == {0.0}


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["empty"], 2, "no recording in empty"),
        (["missing.c3d"], 3, "missing.c3d"),
        (["session/broken.c3d"], 3, "no known format"),
        ([TRIAL, "--reference", "empty"], 2, "no recording in empty"),
        ([TRIAL, "--title", "x" * 121], 2, "title"),
        ([TRIAL, "--method", "guess"], 2, "method"),
    ],
)
def test_bad_input_leaves_nothing(
    run: Run, session: Path, tmp_path: Path, arguments: list[object], code: int, message: str
) -> None:
    (tmp_path / "empty").mkdir()
    ran = run("report", *arguments)
    assert ran.code == code, ran.err
    assert message in ran.err
    assert not (tmp_path / "report").exists()


def test_people_are_the_subfolders_and_the_files_beside_them(tmp_path: Path) -> None:
    for name in ("a/1.c3d", "a/day-2/2.c3d", "b/1.c3d", "c.c3d"):
        path = tmp_path / "group" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    people = people_in(tmp_path / "group")
    assert [[path.name for path in person] for person in people] == [["1.c3d", "2.c3d"], ["1.c3d"], ["c.c3d"]]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InvalidInput):
        people_in(tmp_path / "empty")


@pytest.mark.parametrize("group", ["before", "reference"])
def test_one_file_is_not_compared_with_itself(run: Run, session: Path, tmp_path: Path, group: str) -> None:
    """A change of exactly zero, or a person in the own reference group, would look like a result."""
    ran = run("report", TRIAL, f"--{group}", session)
    assert ran.code == 2, ran.err
    assert "is the same file as" in ran.err
    assert "walk.c3d" in ran.err
    assert not (tmp_path / "report").exists()
    with pytest.raises(InvalidInput) as refused:
        sl.gait_report(TRIAL, **({"before": [session]} if group == "before" else {"reference": session}))
    assert refused.value.code == "recording-twice"
    assert [Path(fault.where).name for fault in refused.value.faults] == ["walk.c3d"]


def test_the_library_writes_the_same_report(session: Path, earlier_trial: Path, tmp_path: Path) -> None:
    report = sl.gait_report(session, title="Walk 7", before=[earlier_trial])
    assert report.save(tmp_path / "walk.pdf").read_bytes() == report.pdf
    assert report.save(tmp_path / "walk.html").read_text(encoding="utf-8") == report.html
    assert [one.filename for one in report.summary.left_out] == ["broken.c3d"]
    assert report.summary.changes
    with pytest.raises(InvalidInput):
        sl.gait_report(session, height_m=17.0)
