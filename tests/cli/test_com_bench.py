"""``stridelab com-bench``: a folder of people, what is left out of it, and a run that continues an interrupted one."""

import csv
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from stridelab.cli.compare import continued_map
from stridelab.errors import NotEstimable, StridelabError
from stridelab.pipelines import bench_estimators
from stridelab.pipelines.progress import Json
from stridelab.schemas.comparison import ComBenchSummary
from stridelab.schemas.methods import METHODS
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
