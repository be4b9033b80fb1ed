"""The main job from the command line: the files, the numbers and the table, on the shipped sample."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from stridelab.cli.estimate import estimate_recording, simulate_walk
from stridelab.cli.options import Delivery, EstimateRequest, Estimation, Preparation, Walk
from stridelab.errors import InvalidInput, NotEstimable, UnreadableFile
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.reader import read_recording
from stridelab.schemas.jobs import EstimateComInput, EstimateComSummary, JobResult
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.service.local_runs import write_result
from support.command_line import SAMPLE, estimate_task, quiet
from support.recordings.body_model_files import rocking_members, write_zip
from support.recordings.export_files import write_trc

WALK = Walk(SAMPLE / "recording.c3d")
FILES = {"com.parquet", "com.csv", "com.c3d", "result.json", "references.bib"}


def run(delivery: Delivery, walk: Walk = WALK, **options: Any) -> None:
    estimate_recording(EstimateRequest(walk, **options), delivery)


def test_the_result_is_that_of_the_job(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(Delivery(tmp_path / "out", as_json=True), replace(WALK, height_m=1.71))
    printed = JobResult.model_validate_json(capsys.readouterr().out)
    assert {p.name for p in (tmp_path / "out").iterdir()} == FILES
    assert json.loads((tmp_path / "out" / "result.json").read_text()) == printed.model_dump(mode="json")
    task = estimate_task(SAMPLE / "recording.c3d", tmp_path / "job", latency="apply")
    outcome = estimate_com.run(task, tmp_path / "job", quiet)
    assert printed.summary == outcome.summary
    assert (tmp_path / "out" / "com.csv").read_bytes() == (tmp_path / "job" / "com.csv").read_bytes()
    for artifact in printed.artifacts:
        assert (tmp_path / "out" / artifact.name).stat().st_size == artifact.bytes
    for key in printed.references:
        assert f"{{{key}," in (tmp_path / "out" / "references.bib").read_text()


def test_the_table_shows_the_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(Delivery(tmp_path / "out"))
    output = capsys.readouterr().out
    for word in ("window", "smoother", "60.0 kg", "force latency", "latency-applied", "com.parquet"):
        assert word in output


def test_options_reach_the_job(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = Estimation(segment_table="dumas2007", cutoffs="0.2,2", window="1.95,2.6")
    run(Delivery(tmp_path / "out", as_json=True), replace(WALK, mass_kg=61.0), estimation=options)
    result = JobResult.model_validate_json(capsys.readouterr().out)
    summary = EstimateComSummary.model_validate(result.summary)
    assert summary.mass_kg == 61.0
    assert summary.segment_table == "dumas2007"
    assert summary.window_s == pytest.approx((1.95, 2.6))
    assert result.input["cutoffs"] == [0.2, 2.0]


def test_a_forced_second_run_replaces_the_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(Delivery(tmp_path / "out"))
    run(Delivery(tmp_path / "out", force=True), method="geometry")
    assert json.loads((tmp_path / "out" / "result.json").read_text())["summary"]["method"] == "geometry"
    assert "geometry" in capsys.readouterr().out


def test_stated_errors_of_the_smoother_reach_the_job() -> None:
    stated = Estimation(prior=["plate_force_n=5", "momentum_m_s=0.001,0.002"], no_learn=True, segment_momentum=True)
    job_input = EstimateRequest(WALK, estimation=stated).to_input("r", EstimateComInput)
    assert job_input.smoother is not None
    assert job_input.smoother.priors.model_dump(exclude_none=True) == {
        "plate_force_n": 5.0,
        "momentum_m_s": (0.001, 0.002),
    }
    assert (job_input.smoother.learn, job_input.smoother.segment_momentum) == (False, True)
    plain = EstimateRequest(WALK).to_input("r", EstimateComInput)
    assert plain.smoother is None, "nothing stated leaves the choice of the method open"


def test_belt_speeds_are_settings_of_their_plates() -> None:
    stated = Preparation(belt_speed=["1=1.2", "2=0.8"], without_plate=[2, 3], moment_offset=["1=0.005,0,-0.06"])
    switches = EstimateRequest(WALK, preparation=stated).plate_switches()
    assert {index: one.model_dump(exclude_none=True) for index, one in switches.items()} == {
        1: {"belt_speed_m_s": 1.2, "moment_offset_m": (0.005, 0.0, -0.06)},
        2: {"use": False, "belt_speed_m_s": 0.8},
        3: {"use": False},
    }


@pytest.mark.parametrize("text", ["1.2", "left=1.2", "1=fast", "1=-1", "1=40"])
def test_an_impossible_belt_speed_is_refused_by_its_option(text: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        EstimateRequest(WALK, preparation=Preparation(belt_speed=[text])).plate_switches()
    assert refused.value.faults[0].where == "--belt-speed"


@pytest.mark.parametrize("text", ["1=0.005", "left=0,0,0", "1=0,0,-60"])
def test_an_impossible_moment_offset_is_refused_by_its_option(text: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        EstimateRequest(WALK, preparation=Preparation(moment_offset=[text])).plate_switches()
    assert refused.value.faults[0].where == "--moment-offset"


def test_a_belt_under_a_walk_over_the_floor_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refused:
        run(Delivery(tmp_path / "out"), preparation=Preparation(belt_speed=["1=1.2"]))
    assert refused.value.code == "belt-speed-contradicts-feet"
    assert not (tmp_path / "out").exists()


def test_simulate_then_estimate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fields = {"seed": 5, "duration_s": 2.0}
    simulate_walk(fields, noise=("marker_m=0.002",), out_dir=tmp_path / "walk", force=False, as_json=False)
    assert {p.name for p in (tmp_path / "walk").iterdir()} == {
        "recording.c3d",
        "truth.parquet",
        "truth.csv",
        "result.json",
        "references.bib",
    }
    assert json.loads((tmp_path / "walk" / "result.json").read_text())["input"]["noise"]["marker_m"] == 0.002
    assert "steps at" in capsys.readouterr().out


def test_a_result_without_references_is_written_too(tmp_path: Path) -> None:
    from stridelab.schemas.jobs import SimulateRecordingInput
    from stridelab.service.kinds.base import Outcome

    write_result(tmp_path, "simulate-recording", SimulateRecordingInput(), Outcome({}, (), ()))
    assert (tmp_path / "references.bib").read_text().strip() == ""


def test_a_trc_alone_by_geometry_and_the_refusal_that_names_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    walk = Walk(write_trc(tmp_path / "walk.trc", read_recording(WALK.file)))
    with pytest.raises(NotEstimable) as refusal:
        run(Delivery(tmp_path / "out"), walk)
    assert refusal.value.code == "no-plates"
    assert "geometry" in refusal.value.message
    run(Delivery(tmp_path / "out"), walk, method="geometry")
    assert {p.name for p in (tmp_path / "out").iterdir()} == FILES
    assert "geometry" in capsys.readouterr().out


def test_a_broken_trc_is_named_by_the_line(tmp_path: Path) -> None:
    lines = write_trc(tmp_path / "walk.trc", read_recording(WALK.file)).read_text().splitlines()
    (tmp_path / "walk.trc").write_text("\n".join(lines[:3]))
    with pytest.raises(UnreadableFile) as refusal:
        run(Delivery(tmp_path / "out"), Walk(tmp_path / "walk.trc"), method="geometry")
    assert refusal.value.message.startswith("The TRC file walk.trc is broken: the file ends after line 3")
    assert not (tmp_path / "out").exists()


def test_an_unsuitable_static_trial_is_remarked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The walk of a taller body, given as the static trial."""
    walk = read_recording(WALK.file)
    taller = replace(walk, markers_m={label: 1.1 * track for label, track in walk.markers_m.items()}, carried={})
    write_c3d(tmp_path / "other.c3d", taller)
    run(Delivery(tmp_path / "out"), method="geometry", preparation=Preparation(static=tmp_path / "other.c3d"))
    output = " ".join(capsys.readouterr().out.split())
    assert "The subject moves in the static trial other.c3d" in output
    assert "The static trial other.c3d shows a different body from this recording" in output


def test_a_model_and_forces_are_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    members = rocking_members()
    for name, text in members.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    model, angles, forces = (tmp_path / name for name in members)
    run(Delivery(tmp_path / "out", as_json=True), Walk(angles), preparation=Preparation(model=model, forces=[forces]))
    one_zip = write_zip(tmp_path / "rocking_ik.zip", members)
    result = JobResult.model_validate_json(capsys.readouterr().out)
    run(Delivery(tmp_path / "zipped", as_json=True), Walk(one_zip))
    assert result.summary == JobResult.model_validate_json(capsys.readouterr().out).summary
    assert result.summary["segment_table"] == "carried"
    assert (tmp_path / "out" / "com.csv").read_bytes() == (tmp_path / "zipped" / "com.csv").read_bytes()


def test_files_of_one_name_and_files_that_do_not_exist_are_refused(tmp_path: Path) -> None:
    for name, text in rocking_members().items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    angles = tmp_path / "rocking_ik.mot"
    with pytest.raises(UnreadableFile, match="no such file"):
        run(Delivery(tmp_path / "out"), Walk(angles), preparation=Preparation(model=tmp_path / "other.osim"))
    with pytest.raises(InvalidInput, match="same name"):
        run(Delivery(tmp_path / "out"), Walk(angles), preparation=Preparation(model=angles))
    assert not (tmp_path / "out").exists()
