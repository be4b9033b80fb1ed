"""``stridelab com-bench``: a folder of people, what is left out of it, and a run that continues an interrupted one."""

import csv
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from stridelab.cli.compare import continued_map
from stridelab.errors import NotEstimable, StridelabError
from stridelab.pipelines import bench_estimators
from stridelab.pipelines.progress import Json
from stridelab.schemas.comparison import BenchMember, ComBenchSummary, ComBenchTask
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.methods import METHODS
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.kinds.com_bench import run as com_bench
from support.command_line import SAMPLE, Run


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """One good recording, the same again under another name, and a damaged one."""
    for name in ("ann/walk.c3d", "ben/again.c3d"):
        (tmp_path / "lab" / name).parent.mkdir(parents=True)
        shutil.copyfile(SAMPLE / "recording.c3d", tmp_path / "lab" / name)
    (tmp_path / "lab" / "ben" / "cut.c3d").write_bytes((SAMPLE / "recording.c3d").read_bytes()[:3000])
    return tmp_path / "lab"


def test_a_folder_is_scored_and_the_files_without_a_score_are_listed(
    run: Run, lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    ran = run("com-bench", lab, "--out", "bench", "--rows", "rows.jsonl")
    assert ran.code == 0, ran.err
    assert "1 recordings of 1 people" in ran.out
    result = json.loads((tmp_path / "bench" / "result.json").read_text())
    summary = ComBenchSummary.model_validate(result["summary"])
    assert {(one.filename, one.code) for one in summary.left_out} == {
        ("ben/again.c3d", "recording-twice"),
        ("ben/cut.c3d", "truncated-file"),
    }
    columns = {column.name: column for column in summary.columns}
    path = columns["grounded_force_path_along"]
    assert (path.n, path.recordings, path.unit, path.orders) == (1, 1, "m", True)
    assert set(path.scores) == set(METHODS)
    assert all(0.0 < score.value < 0.05 and score.ci95 is None for score in path.scores.values())
    assert "few-people" in {remark.code for remark in summary.warnings}
    assert summary.quality.verdict == "good"
    with (tmp_path / "bench" / "scores.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert {(row["recording"], row["subject"]) for row in rows} == {("ann/walk.c3d", "ann")}
    value = next(r for r in rows if r["column"] == path.name and r["method"] == "geometry")
    assert float(value["value"]) == pytest.approx(path.scores["geometry"].value ** 2)

    def refuse(_item: Json) -> Json:
        raise AssertionError("computed again")

    monkeypatch.setattr(bench_estimators, "score_recording", refuse)
    (lab / "ben" / "cut.c3d").unlink()
    again = run("com-bench", lab, "--out", "bench", "--rows", "rows.jsonl", "--force", "--json")
    assert again.code == 0, again.err
    assert json.loads(again.out)["summary"]["columns"] == result["summary"]["columns"]


def test_a_folder_of_damaged_files_is_refused_with_each_reason(run: Run, lab: Path) -> None:
    for name in ("ann/walk.c3d", "ben/again.c3d"):
        (lab / name).unlink()
    ran = run("com-bench", lab, "--out", "bench")
    assert ran.code != 0
    assert "nothing-scored" in ran.err
    assert "truncated-file" in ran.err
    assert not Path("bench").exists()


def test_an_interrupted_run_keeps_its_results_and_computes_the_others(tmp_path: Path) -> None:
    items: list[Json] = []
    for k in range(3):
        (tmp_path / str(k)).mkdir()
        (tmp_path / str(k) / "trial").write_text(f"content {k}")
        items.append({"task": {}, "folder": str(tmp_path / str(k))})
    computed: list[list[str]] = []

    def map_items(_work: object, items: list[Json]) -> Iterator[tuple[int, Json | StridelabError]]:
        computed.append([Path(item["folder"]).name for item in items])
        for index, item in enumerate(items):
            if Path(item["folder"]).name == "1":
                yield index, NotEstimable("no-step", "There is no step.")
            else:
                yield index, {"n": item["folder"]}

    rows = tmp_path / "rows.jsonl"
    first = continued_map(map_items, rows)(dict, items)
    assert next(iter(first))[0] == 0  # and then it is interrupted
    with rows.open("a") as lines:
        lines.write('{"key": "hal')
    later = dict(continued_map(map_items, rows)(dict, items))
    assert computed == [["0", "1", "2"], ["1", "2"]]
    assert later[0] == {"n": items[0]["folder"]}
    assert isinstance(later[1], NotEstimable)
    assert dict(continued_map(map_items, rows)(dict, items))[2] == {"n": items[2]["folder"]}
    assert computed[-1] == ["1"]
    (tmp_path / "0" / "trial").write_text("another walk")
    dict(continued_map(map_items, rows)(dict, items))
    assert computed[-1] == ["0", "1"]


def test_the_job_and_the_command_share_their_map() -> None:
    assert com_bench.map_recordings.keywords["preload"] == ("stridelab.pipelines.bench_estimators",)


def walk_over_plates(person: int, offset_m: list[float], laboratory: list[list[int]]) -> tuple[BenchMember, Json]:
    """A member, and an answer with exact evidence of offsets (x and y of two plates, height) that differ by 0.1 mm."""
    source = RecordingSource(file="trial", filename=f"walk {person}.c3d")
    task = EstimateComTask(recording=source, input=EstimateComInput(recording_id=f"r{person}"))
    member = BenchMember(recording_id=f"r{person}", folder=".", task=task, subject=f"person {person}")
    gram = np.diag([1.0, 2.0, 3.0, 2.0, 0.5])
    right = gram @ (np.array(offset_m) + 1e-4 * (-1) ** person)
    return member, {"plates": {"laboratory": laboratory, "gram": gram.tolist(), "right": right.tolist()}}


def test_plates_that_are_misplaced_are_named_with_their_offsets() -> None:
    """The plates of one laboratory, by their indices in the files; those of another one are where they should be."""
    walks = [walk_over_plates(k, [0.0, 0.0, -0.012, 0.001, -0.06], [[3, 0, 0], [5, 60, 0]]) for k in range(6)]
    walks += [walk_over_plates(k, [0.0, 0.0, 0.002, 0.0, -0.01], [[3, 100, 0], [5, 160, 0]]) for k in range(6, 12)]
    task = ComBenchTask(members=[member for member, _ in walks], seed=0)
    remarks = bench_estimators._plate_remarks(task, {k: answer for k, (_, answer) in enumerate(walks)})
    assert [remark.code for remark in remarks] == ["plates-misplaced"]
    assert remarks[0].message == (
        "By 6 people who walked over them, the moments of the plates do not refer to where the files state: "
        "plate 3 by +6.0 mm along x and -0.5 mm along y (SD 0.0 and 0.0; relative to the mean of the plates), "
        "plate 5 by -6.0 mm along x and +0.5 mm along y (SD 0.0 and 0.0; relative to the mean of the plates), "
        "all plates by -60 mm vertically (SD 0; the segment table accounts for 20). "
        "Corners or origins are wrong; state moment_offset_m of the plates."
    )
    assert bench_estimators._plate_remarks(task, {k: walks[k][1] for k in range(4)}) == []
