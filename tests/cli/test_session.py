"""``stridelab estimate`` with several recordings: a folder each, with the clock and the mass of their session."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.cli.session import Member, sessions_of
from stridelab.errors import StridelabError
from stridelab.pipelines.session_values import TrialFacts
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Subject
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.recordings.export_files import write_trc
from support.service.stored_rows import facts

QUICK = ("--method", "complementary")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three recordings of one walk with other noise, and the person standing."""
    home = tmp_path_factory.mktemp("lab")
    walk = HumanWalker(mass_kg=64.0, duration_s=3.0, seed=4).walk()
    for k in range(3):
        noise = MeasurementNoise(marker_m=0.002, mass_model=0.1, latency_s=0.018)
        recording = record(walk, noise, k, lab="two_plates").recording
        write_c3d(home / f"walk{k}.c3d", recording)
        if k == 0:
            first_frame = {label: track[:1].repeat(30, axis=0) for label, track in recording.markers_m.items()}
            still = replace(
                recording, markers_m=first_frame, plates=(), events=(), walking_direction=None, subject=Subject()
            )
            write_c3d(home / "standing.c3d", still)
    return home


def run(*words: object) -> Any:
    return CliRunner().invoke(app, ["estimate", *map(str, words), *QUICK])


def summary(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "result.json").read_text())["summary"])


@pytest.fixture(scope="module")
def results(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out") / "session"
    answer = run(folder, "--out", out)
    assert answer.exit_code == 0, answer.output
    return out


def test_every_walk_of_a_folder_has_a_result_with_the_values_of_the_session(results: Path) -> None:
    assert {path.name for path in results.iterdir()} == {"walk0-com", "walk1-com", "walk2-com"}
    summaries = [summary(results / f"walk{k}-com") for k in range(3)]
    assert {one["latency_source"] for one in summaries} == {"session"}
    assert {one["latency_n_trials"] for one in summaries} == {3}
    assert len({one["latency_applied_s"] for one in summaries}) == 1
    assert summaries[0]["latency_s"] == pytest.approx(0.018, abs=0.002)
    assert len({one["latency_trial_s"] for one in summaries}) == 3
    for one in summaries:
        assert one["session"]["static_recording_id"] == "standing"
        assert "static-from-session" in {remark["code"] for remark in one["warnings"]}


def test_measures_name_the_static_trial_as_such(folder: Path, tmp_path: Path) -> None:
    answer = CliRunner().invoke(app, ["measures", str(folder), "--out", str(tmp_path / "measures"), *QUICK])
    assert answer.exit_code == 0, answer.output
    left_out = summary(tmp_path / "measures")["left_out"]
    assert [(one["filename"], one["code"]) for one in left_out] == [("standing.c3d", "static-trial")]


def test_a_single_file_uses_its_own(folder: Path, results: Path, tmp_path: Path) -> None:
    answer = run(folder / "walk1.c3d", "--out", tmp_path / "one")
    assert answer.exit_code == 0, answer.output
    one = summary(tmp_path / "one")
    assert (one["latency_source"], one["latency_n_trials"], one["session"]) == ("trial", 1, None)
    assert one["latency_s"] != summary(results / "walk1-com")["latency_s"]
    assert one["latency_sd_s"] > summary(results / "walk1-com")["latency_sd_s"]


def test_the_order_of_the_files_does_not_matter(folder: Path, results: Path, tmp_path: Path) -> None:
    files = [folder / f"walk{k}.c3d" for k in (2, 0, 1)]
    answer = run(*files, folder / "standing.c3d", "--out", tmp_path, "--json")
    assert answer.exit_code == 0, answer.output
    assert summary(tmp_path / "walk1-com") == summary(results / "walk1-com")
    printed = json.loads(answer.stdout[answer.stdout.index("[") :])
    assert [one["input"]["recording_id"] for one in printed] == ["walk2.c3d", "walk0.c3d", "walk1.c3d"]


def test_a_walk_without_an_estimate_is_named_and_the_others_are_estimated(folder: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(b"no recording at all")
    answer = run(folder / "walk0.c3d", folder / "walk1.c3d", broken, "--out", tmp_path / "out")
    assert answer.exit_code == 0, answer.output
    assert "broken" in answer.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"walk0-com", "walk1-com"}


@pytest.mark.parametrize(
    ("words", "code"),
    [(("--server", "http://127.0.0.1:1"), "option-invalid"), (("--latency", "x"), "option-invalid")],
)
def test_invalid_values_are_refused(folder: Path, tmp_path: Path, words: tuple[str, ...], code: str) -> None:
    answer = run(folder, *words, "--out", tmp_path / "out")
    assert answer.exit_code != 0
    assert isinstance(answer.exception, StridelabError | SystemExit)
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())


def test_nothing_is_overwritten(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "walk1-com").mkdir()
    (tmp_path / "walk1-com" / "mine.txt").write_text("mine")
    assert run(folder, "--out", tmp_path).exit_code != 0
    assert [path.name for path in tmp_path.iterdir()] == ["walk1-com"]


def test_a_folder_without_recordings_is_refused_and_exports_as_text_are_named(tmp_path: Path) -> None:
    """The forces of a TSV file are in others, and a CSV file may be a table of subjects."""
    (tmp_path / "walk.tsv").write_text("NO_OF_FRAMES\t0\n")
    answer = run(tmp_path)
    assert answer.exit_code != 0
    assert "exports as TSV or CSV are named themselves" in str(answer.exception) + answer.output


def member(name: str, parent: str, height_m: float | None = None, day: str | None = None) -> Member:
    known = {"height_m": height_m, "mass_kg": None if height_m is None else 60.0}
    return Member(Path(parent) / name, name, TrialFacts(name, name, name, facts(subject=known, recorded_on=day)))


def test_recordings_are_grouped_by_person_and_day() -> None:
    first = [member("a1", "/lab/a", 1.7), member("a2", "/lab/a", 1.7), member("a_static", "/lab/a")]
    second = [member("b1", "/lab/b", 1.8), member("b_static", "/lab/b")]
    sessions = sessions_of([*first, *second])
    assert sessions["a1"] == sessions["a2"] == sessions["a_static"] != sessions["b1"] == sessions["b_static"]
    assert len(set(sessions_of(first).values())) == 1
    assert len(set(sessions_of([*first, *second], one_person=True).values())) == 1
    days = [member("c1", "/lab", 1.7, "2026-01-02"), member("c2", "/lab", 1.7, "2026-01-03")]
    assert len(set(sessions_of(days).values())) == 2
    strangers = [*first, *second, member("x", "/lab/x"), member("y", "/lab/y")]
    sessions = sessions_of(strangers)
    assert len({sessions["x"], sessions["y"], sessions["a1"], sessions["b1"]}) == 4


def test_a_trc_of_a_folder_is_estimated_unless_it_is_the_export_of_a_trial(folder: Path, tmp_path: Path) -> None:
    for name, recording in (("walk0", "walk0"), ("other", "walk1")):
        write_trc(tmp_path / f"{name}.trc", read_recording(folder / f"{recording}.c3d"))
    shutil.copyfile(folder / "walk0.c3d", tmp_path / "walk0.c3d")
    out = tmp_path / "out"
    answer = CliRunner().invoke(app, ["estimate", str(tmp_path), "--method", "geometry", "--out", str(out)])
    assert answer.exit_code == 0, answer.output
    assert {path.name for path in out.iterdir()} == {"walk0-com", "other-com"}
    assert "no-force-file" not in {remark["code"] for remark in summary(out / "walk0-com")["warnings"]}
    assert "no-force-file" in {remark["code"] for remark in summary(out / "other-com")["warnings"]}
