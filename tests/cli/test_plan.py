"""``stridelab plan`` and ``demo``: what a local run writes and prints, and what is sent to a service."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from stridelab.cli import demo, remote
from stridelab.cli.app import app
from stridelab.cli.options import Delivery
from stridelab.cli.plan_motion import PlanRequest, plan_scenario, show_plan
from stridelab.client import ProblemError
from stridelab.errors import Conflict, InvalidInput, NotEstimable
from stridelab.schemas.jobs import Artifact, JobResult
from stridelab.schemas.plans import PlanMotionInput, PlanMotionSummary, ReplayOptions
from stridelab.schemas.scenarios import Scenario
from stridelab.service.kinds.plan_motion import run as plan_motion
from support.command_line import ScriptedService, problem, quiet
from support.robots.plans import changed, plan_task, short_walk, stopping_after

PLAN_FILES = {
    "centroidal.parquet",
    "centroidal.csv",
    "iterations.parquet",
    "iterations.csv",
    "scenario.json",
    "result.json",
    "references.bib",
}


@pytest.fixture
def walk(tmp_path: Path) -> str:
    path = tmp_path / "short-walk.json"
    path.write_text(short_walk().model_dump_json())
    return str(path)


def act(request: PlanRequest, out_dir: Path | None, **options: Any) -> None:
    plan_scenario(request, Delivery(out_dir, **options))


def test_the_result_is_that_of_the_job(walk: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    act(PlanRequest(walk, no_whole_body=True), tmp_path / "out", as_json=True)
    printed = JobResult.model_validate_json(capsys.readouterr().out)
    assert {path.name for path in (tmp_path / "out").iterdir()} == PLAN_FILES
    assert json.loads((tmp_path / "out" / "result.json").read_text()) == printed.model_dump(mode="json")
    (tmp_path / "job").mkdir()
    outcome = plan_motion.run(plan_task(whole_body=False), tmp_path / "job", quiet)
    times = ("stage_times_s", "solve_time_s", "build_time_s")
    assert {k: v for k, v in printed.summary.items() if k not in times} == {
        k: v for k, v in outcome.summary.items() if k not in times
    }
    assert (tmp_path / "out" / "centroidal.csv").read_bytes() == (tmp_path / "job" / "centroidal.csv").read_bytes()


def test_the_folder_is_named_after_the_scenario(walk: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    act(PlanRequest(walk, no_whole_body=True), None)
    assert (tmp_path / "short-walk-plan" / "result.json").is_file()
    with pytest.raises(Conflict):
        act(PlanRequest(walk, no_whole_body=True), None)


def test_a_replay_goes_with_the_whole_body() -> None:
    def stages_of(**options: Any) -> tuple[bool, bool | ReplayOptions]:
        job_input = PlanRequest("x", **options).to_input(short_walk())
        return job_input.whole_body, job_input.replay

    assert stages_of() == (True, True)
    assert stages_of(replay=False) == (True, False)
    assert stages_of(no_whole_body=True) == (False, False)
    with pytest.raises(InvalidInput) as refusal:
        PlanRequest("x", no_whole_body=True, replay=True)
    assert refusal.value.faults[0].where == "--replay"


def test_a_delay_of_the_replay_is_an_option_of_the_job() -> None:
    job_input = PlanRequest("x", replay_delay_ms=3.0).to_input(short_walk())
    assert job_input == PlanMotionInput(scenario=short_walk(), replay=ReplayOptions(delay_s=0.003))
    predicted = PlanRequest("x", replay_delay_ms=6.0, expected_delay_ms=6.0).to_input(short_walk())
    assert predicted.replay == ReplayOptions(delay_s=0.006, expected_delay_s=0.006)
    soft = PlanRequest("x", replay_delay_ms=10.0, expected_delay_ms=10.0, soft_gains=True).to_input(short_walk())
    assert soft.replay == ReplayOptions(delay_s=0.010, expected_delay_s=0.010, gains="soft")
    for without in ({"replay": False}, {"no_whole_body": True}):
        with pytest.raises(InvalidInput) as refusal:
            PlanRequest("x", replay_delay_ms=3.0, **without)  # type: ignore[arg-type]
        assert refusal.value.faults[0].where == "--delay"


def test_disturbances_of_the_replay_are_options_of_the_job() -> None:
    pushes = ["1.5:0,-20,0", "2:1,2,3:base_link"]
    job_input = PlanRequest("x", pushes=pushes, payload_kg=2.0, friction=0.25, sensors="estimated").to_input(
        short_walk()
    )
    assert job_input.replay == ReplayOptions.model_validate(
        {
            "pushes": [
                {"time_s": 1.5, "impulse_ns": [0.0, -20.0, 0.0]},
                {"time_s": 2.0, "impulse_ns": [1.0, 2.0, 3.0], "link": "base_link"},
            ],
            "payload_kg": 2.0, "friction": 0.25, "sensors": "estimated",
        }
    )  # fmt: skip


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"pushes": ["1.5"]}, "--push"),
        ({"pushes": ["1:0,0"]}, "--push"),
        ({"pushes": ["a:0,0,0"]}, "--push"),
        ({"pushes": ["nan:0,0,0"]}, "--push"),
        ({"pushes": ["-1:0,0,0"]}, "--push"),
        ({"friction": 0.0}, "--friction"),
        ({"friction": float("nan")}, "--friction"),
        ({"payload_kg": -1.0}, "--payload"),
        ({"payload_kg": 2.0, "replay": False}, "--payload"),
        ({"sensors": "estimated", "no_whole_body": True}, "--sensors"),
    ],
)
def test_a_disturbance_that_cannot_be_is_refused(options: dict[str, Any], where: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        PlanRequest("x", **options)
    assert [fault.where for fault in refusal.value.faults] == [where]


def test_options_of_the_solver_are_those_of_the_job() -> None:
    options = {"formulation": "wrench", "solver": "ipopt", "node_rate_hz": 20.0, "time_limit_s": 5.0}
    options |= {"free_durations": True, "duration_range": (0.8, 1.3), "price_per_s": 2.0, "fastest": True}
    job_input = PlanRequest("x", **options).to_input(short_walk())  # type: ignore[arg-type]
    assert {name: getattr(job_input, name) for name in options} == options
    plain = PlanRequest("x").to_input(short_walk())
    assert plain == PlanMotionInput(scenario=short_walk(), replay=True)


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"free_durations": True, "solver": "fatrop"}, "--free-durations"),
        ({"free_durations": True, "formulation": "circular-cones", "solver": "ipopt"}, "--free-durations"),
        ({"shape": "cubic", "solver": "fatrop"}, "--shape"),
        ({"shape": "cubic", "formulation": "wrench"}, "--shape"),
        ({"price_per_s": 1.0}, "--time-price"),
        ({"fastest": True, "no_whole_body": True}, "--fastest"),
        ({"fastest": True, "pushes": ["1:0,20,0"]}, "--fastest"),
        ({"duration_range": (1.1, 1.4)}, "--duration-range"),
        ({"duration_range": (0.7, float("nan"))}, "--duration-range"),
    ],
)
def test_invalid_bounds_of_durations_are_named(options: dict[str, Any], where: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        PlanRequest("x", **options)
    assert refusal.value.faults[0].where == where


def test_solved_durations_are_reported_and_written(
    walk: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    act(PlanRequest(walk, no_whole_body=True, free_durations=True, duration_range=(0.8, 1.2)), tmp_path / "out")
    assert "durations chosen " in capsys.readouterr().out
    written = Scenario.model_validate_json((tmp_path / "out" / "scenario.json").read_text())
    given_s, chosen_s = ([phase.duration_s for phase in one.phases] for one in (short_walk(), written))
    assert chosen_s != given_s
    assert sum(chosen_s) == pytest.approx(sum(given_s))
    priced = PlanRequest(walk, no_whole_body=True, free_durations=True, duration_range=(0.8, 1.2), price_per_s=50.0)
    act(priced, tmp_path / "priced")
    written = Scenario.model_validate_json((tmp_path / "priced" / "scenario.json").read_text())
    assert sum(phase.duration_s for phase in written.phases) < 0.9 * sum(given_s)


@pytest.mark.parametrize("options", [{"time_limit_s": 0.0}, {"time_limit_s": 1e4}])
def test_an_invalid_time_limit_is_named(options: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput) as refusal:
        PlanRequest("x", **options)
    assert refusal.value.faults[0].where == "--time-limit"


@pytest.mark.parametrize(
    ("option", "value"),
    [("--formulation", "moments"), ("--solver", "snopt"), ("--node-rate", "0.5"), ("--node-rate", "nan")],
)
def test_an_unknown_value_is_named_on_the_command_line(walk: str, option: str, value: str) -> None:
    answer = CliRunner().invoke(app, ["plan", walk, option, value])
    assert answer.exit_code == 2
    assert option in re.sub(r"\x1b\[[0-9;]*m", "", answer.output)


def test_an_infeasible_scenario_leaves_nothing(tmp_path: Path) -> None:
    bad = changed(short_walk(), lambda body: body["phases"][2]["contacts"][0]["position_m"].__setitem__(2, 0.3))
    (tmp_path / "bad.json").write_text(bad.model_dump_json())
    with pytest.raises(InvalidInput) as refusal:
        act(PlanRequest(str(tmp_path / "bad.json")), tmp_path / "out")
    assert "phases[2].contacts[" in refusal.value.message
    assert [path.name for path in tmp_path.iterdir()] == ["bad.json"]


CHECKS = [
    {"name": "com_error_max", "value": 1.6e-4, "unit": "m", "limit": 1e-3, "at_least": False, "passed": True},
    {
        "name": "terrain_distance_min", "value": -0.01, "unit": "m", "limit": 0.0, "at_least": True, "passed": False,
        "phase": 23, "effector": "leg_right_4_link", "time_s": 26.72,
    },
    {"name": "torque_ratio_max", "value": 0.5, "unit": "1", "limit": 1.0, "at_least": False, "passed": True},
]  # fmt: skip
REPLAY = {
    "completed": False, "fall_time_s": 12.2, "com_error_rms_m": 0.034, "com_error_max_m": 0.2514,
    "foot_slip_max_m": 0.0271, "landing_error_max_m": 0.0123, "hand_force_mean_n": 6.0,
    "torque_ratio_max": 0.89, "real_time_factor": 8.0,
}  # fmt: skip


def fallen() -> dict[str, Any]:
    """Summary of a plan whose motion fails its certificate and whose replay falls."""
    gaps = {"dynamics_gap": 0.0, "terminal_gap": 0.0, "cone_margin_n": 0.0, "normal_force_min_n": 0.0}
    summary = PlanMotionSummary.model_validate(
        {
            "scenario_name": "Stairs [steep]", "robot": "talos", "duration_s": 36.4, "n_phases": 31,
            "converged": True, "solver": "ipopt", "objective": -48.54, "cost_terms": {}, "iterations": 17,
            "solve_time_s": 1.42, "build_time_s": 0.2, "stage_times_s": {"check": 0.1, "whole body": 3.4},
            "verification": gaps, "certificate": {"passed": False, "checks": CHECKS}, "replay": REPLAY,
            "warnings": [{"code": "replay-fell", "message": "Replayed in physics, the robot falls."}],
        }
    )  # fmt: skip
    return summary.model_dump(mode="json")


def test_an_incomplete_replay_reports_what_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    summary, message = fallen(), "A loaded foot slips by 68 mm; at most 20 mm are allowed."
    summary["replay"] |= {"fall_time_s": None, "remarks": [{"code": "replay-slipped", "message": message}]}
    result = JobResult(kind="plan-motion", input={}, versions={}, references=[], summary=summary, artifacts=[])
    show_plan(result, tmp_path)
    output = " ".join(capsys.readouterr().out.split())
    assert "replay not completed: CoM error" in output
    assert "fell at" not in output
    assert f"replay-slipped {message}" in output


def test_the_tables_name_failed_checks_and_their_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = Artifact(name="motion.html", media_type="text/html", bytes=1)
    result = JobResult(kind="plan-motion", input={}, versions={}, references=[], summary=fallen(), artifacts=[page])
    show_plan(result, tmp_path)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Stairs [steep]: 36.4 s in 31 phases"
    checks = [line.split() for line in lines if line.startswith(("passed", "failed"))]
    assert [line[:2] for line in checks] == [
        ["passed", "com_error_max"],
        ["failed", "terrain_distance_min"],
        ["passed", "torque_ratio_max"],
    ]
    assert "-0.01 ≥ 0 m" in lines[3]
    assert lines[3].endswith("phase 23, leg_right_4_link, 26.72 s")
    assert lines[4].endswith("0.5 ≤ 1"), "what has no unit shows none"
    assert "certificate not passed" in lines
    replay = next(line for line in lines if line.startswith("replay"))
    for words in (
        "fell at 12.2 s",
        "34.0 mm RMS",
        "251.4 mm",
        "land up to 12.3 mm off",
        "slip 27.1 mm",
        "89%",
        "hand force 6 N",
    ):
        assert words in replay
    assert any("replay-fell" in line for line in lines)
    assert "verdict Not certified: terrain distance; the robot falls at 12.2 s in the replay" in lines
    assert lines[-1] == f"To see the motion, open {tmp_path / 'motion.html'} in a browser."


def test_a_motion_that_stops_is_written_with_its_reason_and_ends_as_the_error(
    walk: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from stridelab.pipelines import plan_motion as pipeline

    monkeypatch.setattr(pipeline, "WholeBodyController", stopping_after(0.4))
    with pytest.raises(NotEstimable) as refusal:
        act(PlanRequest(walk), tmp_path / "out")
    assert refusal.value.code == "whole-body-failed"
    assert (tmp_path / "out" / "motion.html").is_file()
    summary = json.loads((tmp_path / "out" / "result.json").read_text())["summary"]
    assert summary["stopped"]["time_s"] == 0.4
    assert "stopped at 0.40 s in phase 0: level 0" in capsys.readouterr().out


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ScriptedService:
    job_input = ScriptedService()
    result = {"versions": {"stridelab": "9"}, "references": [], "summary": fallen()}
    job_input.done = {"kind": "plan-motion", "input": {}, "result": result}
    job_input.files = tmp_path / "there"
    job_input.files.mkdir()
    job_input.artifact = "motion.viser"
    (job_input.files / "motion.viser").write_bytes(b"recorded")
    monkeypatch.setattr(remote, "Client", job_input)
    return job_input


def test_the_scenario_is_sent_to_the_service_and_the_files_are_downloaded(
    service: ScriptedService, walk: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    act(PlanRequest(walk), tmp_path / "out", server="http://lab:8000", token="secret")
    calls = dict(service.calls)
    assert calls["client"] == ("http://lab:8000", "secret")
    kind, job_input, key = calls["submit"]
    assert (kind, job_input.scenario, job_input.scenario_id, job_input.replay, key) == (
        "plan-motion",
        short_walk(),
        None,
        True,
        True,
    )
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert files == {"motion.viser", "result.json", "references.bib"}
    assert json.loads((tmp_path / "out" / "result.json").read_text())["versions"] == {"stridelab": "9"}
    assert "certificate not passed" in capsys.readouterr().out


def test_a_scene_is_scaled_to_the_robot(tmp_path: Path) -> None:
    act(PlanRequest("flat-walk", robot="g1", no_whole_body=True), tmp_path / "out")
    planned = Scenario.model_validate_json((tmp_path / "out" / "scenario.json").read_text())
    assert planned.robot == "g1"
    assert planned.description.endswith("Scaled to legs of 0.69 m.")
    with pytest.raises(InvalidInput, match="cannot be scaled to a robot; these can: flat-walk") as refusal:
        act(PlanRequest("wall-step", robot="g1"), tmp_path / "other")
    assert refusal.value.code == "scene-not-scalable"


def test_the_service_scales_a_scene_to_its_robot(
    service: ScriptedService, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    requests: list[object] = []

    def scaled_scene(body: object) -> Scenario:
        requests.append(body)
        return short_walk()

    monkeypatch.setattr(service, "scaled_scene", scaled_scene)
    act(PlanRequest("six-stairs", robot="mine"), tmp_path / "out", server="http://lab:8000")
    assert requests == [{"robot": "mine", "scene": "six-stairs"}]
    assert dict(service.calls)["submit"][1].scenario == short_walk()


def test_an_argument_that_is_no_file_is_the_id_of_a_stored_scenario(service: ScriptedService, tmp_path: Path) -> None:
    act(PlanRequest("0123abcd"), tmp_path / "out", server="http://lab:8000")
    job_input = dict(service.calls)["submit"][1]
    assert (job_input.scenario_id, job_input.scenario) == ("0123abcd", None)


def test_a_plan_that_fails_on_the_service_is_not_estimable_with_its_stage(
    service: ScriptedService, walk: str, tmp_path: Path
) -> None:
    service.ends = ("failed", problem(422, "plan-not-converged"))
    service.refuse["result"] = ProblemError(problem(409, "job-not-succeeded"), None)
    with pytest.raises(NotEstimable) as refusal:
        act(PlanRequest(walk), tmp_path / "out", server="http://lab:8000")
    assert refusal.value.code == "plan-not-converged"
    assert not (tmp_path / "out").exists()


def test_a_motion_that_stops_on_the_service_is_downloaded_before_the_error(
    service: ScriptedService, walk: str, tmp_path: Path
) -> None:
    service.ends = ("failed", problem(422, "whole-body-failed"))
    with pytest.raises(NotEstimable) as refusal:
        act(PlanRequest(walk), tmp_path / "out", server="http://lab:8000")
    assert refusal.value.code == "whole-body-failed"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"motion.viser", "result.json", "references.bib"}


def test_a_scenario_that_the_service_refuses_is_invalid_input(
    service: ScriptedService, walk: str, tmp_path: Path
) -> None:
    service.refuse["submit"] = ProblemError(problem(422, "scenario-invalid"), None)
    with pytest.raises(InvalidInput):
        act(PlanRequest(walk), tmp_path / "out", server="http://lab:8000")


def test_the_demo_does_both_main_jobs(walk: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    demo.run_demo(out_dir=tmp_path / "demo", force=False, stairs=walk)
    output = capsys.readouterr().out
    com_files = {"com.parquet", "com.csv", "com.c3d", "result.json", "references.bib", "truth.parquet", "truth.csv"}
    assert {path.name for path in (tmp_path / "demo" / "walk").iterdir()} == com_files
    climb = {path.name for path in (tmp_path / "demo" / "climb").iterdir()}
    assert PLAN_FILES | {"motion.npz", "motion.viser", "motion.html", "replay.npz", "certificate.json"} <= climb
    for words in ("RMS error, mm", "markers only", "certificate passed", "replay completed", "motion.html"):
        assert words in output
    assert str(tmp_path / "demo" / "climb" / "motion.html") in output


def test_the_demo_refuses_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "climb").mkdir()
    with pytest.raises(Conflict):
        demo.run_demo(out_dir=tmp_path, force=False)
    assert [path.name for path in tmp_path.iterdir()] == ["climb"]
