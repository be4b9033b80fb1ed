"""``plan-motion`` from a scenario to its files, each checked against mechanics, and every way in which it can end."""

import asyncio
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pyarrow.parquet as pq
import pytest

from stridelab.centroidal.problem import Weights
from stridelab.centroidal.solver import KKT_ERROR_MAX
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.validation.validate import validate_and_build
from stridelab.conventions import g
from stridelab.errors import InvalidInput, NotEstimable, NotFound, StridelabError
from stridelab.machine.models_folder import models_dir
from stridelab.pipelines import plan_centroidal, plan_problem
from stridelab.pipelines import plan_motion as pipeline
from stridelab.reachability.card import ReachabilityCard
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.loader import load_robot
from stridelab.schemas.plans import CertificateSummary, CostWeights
from stridelab.schemas.scenarios import Scenario
from stridelab.service.jobs.attempt_runner import add_last_progress
from stridelab.service.kinds.plan_motion import run as plan_motion
from stridelab.service.kinds.provenance import known_references
from stridelab.service.kinds.result_tables import read_metadata
from stridelab.service.processes.child import with_json
from stridelab.service.processes.pool import IsolatedPool
from support.command_line import RecordedProgress, quiet
from support.robots.plans import Planned, changed, plan_task, run, short_walk, stopping_after

CENTROIDAL_FILES = {"centroidal.parquet", "centroidal.csv", "iterations.parquet", "iterations.csv", "scenario.json"}
MOTION_FILES = {
    *("motion.npz", "motion.parquet", "motion.csv", "joints.parquet", "joints.csv"),
    *("joint_trajectory.json", "joint_trajectory.yaml", "poses.f32", "poses.json", "forces.f32"),
    *("motion.viser", "motion.html", "replay_in_mujoco.py"),
}
REPLAY_FILES = {"replay.npz", "replay.parquet", "replay.csv", "replay_poses.f32", "replay_forces.f32"}
ALL_FILES = CENTROIDAL_FILES | MOTION_FILES | REPLAY_FILES | {"certificate.json"}
STAGES = ["check", "reachability", "centroidal", "whole body", "certificate", "replay", "export"]


def test_the_files_are_those_of_the_contract(walked: Planned) -> None:
    assert {artifact.name for artifact in walked.outcome.artifacts} == ALL_FILES
    assert {path.name for path in walked.folder.iterdir()} == ALL_FILES
    json.dumps(walked.outcome.to_json(), allow_nan=False)


def test_the_summary_has_the_result_of_every_stage(walked: Planned) -> None:
    summary = walked.summary
    assert (summary.converged, summary.robot, summary.n_phases) == (True, "talos", len(short_walk().phases))
    assert summary.duration_s == pytest.approx(sum(phase.duration_s for phase in short_walk().phases))
    assert list(summary.stage_times_s) == STAGES
    cones = "circular-cones" if summary.solver == "native" else "forces"
    assert (summary.formulation, summary.measure, summary.node_rate_hz) == (cones, DEFAULT_MEASURE, 10.0)
    assert summary.kkt_error is not None
    assert summary.kkt_error <= KKT_ERROR_MAX
    assert summary.weights == CostWeights(**asdict(Weights()))
    beside = {"surface_force", "point_force"}
    assert summary.objective == pytest.approx(sum(v for name, v in summary.cost_terms.items() if name not in beside))
    assert summary.certificate is not None
    assert summary.certificate.passed, [check for check in summary.certificate.checks if not check.passed]
    assert summary.replay is not None
    assert summary.replay.completed
    assert summary.replay.com_error_max_m < 0.03
    assert summary.warnings == []


def test_progress_goes_through_the_stages_with_the_time_of_the_motion(walked: Planned) -> None:
    progress = walked.progress
    named = list(dict.fromkeys(message.partition(":")[0] for message in progress.messages))
    assert named == [*STAGES, "done"]
    assert progress.fractions[-1] == 1.0
    for stage in ("whole body", "replay"):
        ticking = [m for m in progress.messages if m.startswith(f"{stage}: ")]
        assert ticking[0] == f"{stage}: 0.0 of {walked.summary.duration_s:.1f} s"
        assert len(ticking) >= 10
        for message in ticking[1:]:
            percent, _, clock = message.removeprefix(f"{stage}: ").partition(" %, ")
            done_s, _, all_s = clock.removesuffix(" s").partition(" of ")
            assert abs(float(percent) - 100 * float(done_s) / float(all_s)) < 2, "the percentage is that of the stage"


def test_references_name_the_methods(walked: Planned) -> None:
    assert set(walked.outcome.references) <= known_references()
    assert {
        "carpentier2017thesis",
        "stasse2017talos",
        "arnstrom2022daqp",
        "todorov2012mujoco",
    } <= set(walked.outcome.references)
    solver = pipeline.SOLVER_REFERENCES.get(walked.summary.solver)
    assert solver is None or solver in walked.outcome.references


def test_the_centroidal_table_obeys_newton(walked: Planned, tmp_path: Path) -> None:
    """From the file alone: m (c'' - g) is the sum of the forces; where these are constant, c and c' integrate c''."""
    table = "centroidal.parquet"
    stepped = run(tmp_path, short_walk(), whole_body=False)
    assert (walked.summary.shape, stepped.summary.shape) == ("cubic", "constant")
    for plan in (walked, stepped):
        time_s, com, v, a = newton(plan, table)
    h = np.diff(time_s)[:, None]
    np.testing.assert_allclose(com[1:], com[:-1] + h * v[:-1] + 0.5 * h**2 * a[:-1], atol=1e-7)
    np.testing.assert_allclose(v[1:], v[:-1] + h * a[:-1], atol=1e-7)


def newton(walked: Planned, table: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times and the CoM's motion, after a look at its forces."""
    names = pq.read_schema(walked.folder / table).names
    mass_kg = read_metadata(walked.folder / table)["provenance"]["mass_kg"]
    assert mass_kg == pytest.approx(load_robot("talos").mass_kg)
    time_s = walked.columns(table, "time_s")[:, 0]
    com, v, a = (
        walked.columns(table, *(f"com_{d}{x}_{u}" for x in "xyz")) for d, u in (("", "m"), ("v", "m_s"), ("a", "m_s2"))
    )
    force = np.column_stack(
        [
            walked.columns(table, *(n for n in names if n.startswith("f_") and n.endswith(f"_{x}_n"))).sum(axis=1)
            for x in "xyz"
        ]
    )
    np.testing.assert_allclose(mass_kg * (a - g), force, atol=1e-6)
    return time_s, com, v, a


def test_a_foot_in_the_air_has_no_force_in_the_tables(walked: Planned) -> None:
    for phase, stage in enumerate(short_walk().phases):
        standing = {contact.effector for contact in stage.contacts}
        for foot in ("left_foot", "right_foot"):
            forces = walked.columns("centroidal.parquet", *(f"f_{foot}_{k}_z_n" for k in range(4)))
            rows = walked.columns("centroidal.parquet", "phase")[:, 0] == phase
            assert (forces[rows].sum() > 0.0) == (foot in standing)


def test_the_motion_obeys_the_equations_of_motion(walked: Planned) -> None:
    """From motion.npz alone: inverse dynamics of q, v, a are the joint torques and the contact forces, nothing else."""
    robot, arrays = load_robot("talos"), walked.arrays()
    model = robot.model
    data = model.createData()
    for i in np.linspace(0, len(arrays["time_s"]) - 1, 12).astype(int):
        q, v, a = (arrays[name][i] for name in "qva")
        missing = pin.rnea(model, data, q, v, a) - np.concatenate([np.zeros(6), arrays["tau"][i]])
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for effector in arrays["effectors"]:
            tool = robot.effectors[str(effector)]
            frame = model.getFrameId(tool.frame)
            J = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            centre = data.oMf[frame]
            for point, force in zip(arrays[f"points_{effector}"], arrays[f"forces_{effector}"][i], strict=True):
                arm = centre.rotation @ tool.T_frame_contact.act(point[None])[0]
                missing -= J.T @ np.concatenate([force, np.cross(arm, force)])
        assert np.abs(missing).max() < 1e-6
    assert arrays["joint_names"].tolist() == list(robot.joint_names)


def test_feet_stand_where_the_scenario_puts_them_and_the_com_is_that_of_the_joints(walked: Planned) -> None:
    robot, arrays = load_robot("talos"), walked.arrays()
    data = robot.model.createData()
    com = walked.columns("motion.parquet", "com_x_m", "com_y_m", "com_z_m")
    error = walked.columns("motion.parquet", "com_error_m")[:, 0]
    ends_s = np.cumsum([phase.duration_s for phase in short_walk().phases])
    for phase, end_s in zip(short_walk().phases, ends_s, strict=True):
        i = round((end_s - 0.02) * 250.0)
        pin.centerOfMass(robot.model, data, arrays["q"][i])
        np.testing.assert_allclose(data.com[0], com[i], atol=1e-9)
        pin.framesForwardKinematics(robot.model, data, arrays["q"][i])
        for contact in phase.contacts:
            tool = robot.effectors[contact.effector]
            link = data.oMf[robot.model.getFrameId(tool.frame)]
            sole = link.translation + link.rotation @ tool.T_frame_contact.position_m
            np.testing.assert_allclose(sole, contact.position_m, atol=1e-3)
    assert error.max() < 1e-3


def test_scenario_and_certificate_can_be_read_back(walked: Planned) -> None:
    assert Scenario.model_validate_json((walked.folder / "scenario.json").read_text()) == short_walk()
    certificate = CertificateSummary.model_validate_json((walked.folder / "certificate.json").read_text())
    assert certificate == walked.summary.certificate


def test_without_the_whole_body_there_is_the_plan_only(tmp_path: Path) -> None:
    task = plan_task(whole_body=False).model_dump(mode="json")
    outcome = with_json(plan_motion.run)(task, tmp_path, quiet)
    assert {a["name"] for a in outcome["artifacts"]} == CENTROIDAL_FILES == {path.name for path in tmp_path.iterdir()}
    assert list(outcome["summary"]["stage_times_s"]) == ["check", "reachability", "centroidal", "export"]
    assert (outcome["summary"]["certificate"], outcome["summary"]["replay"]) == (None, None)


def refused(
    folder: Path, kind: type[StridelabError], scenario: Scenario | None = None, **options: Any
) -> StridelabError:
    with pytest.raises(kind) as failure:
        plan_motion.run(plan_task(scenario, **options), folder, quiet)
    assert type(failure.value) is kind
    assert list(folder.iterdir()) == [], "a failed run leaves nothing"
    return failure.value


def test_a_missing_solver_is_refused_before_any_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_problem, "native_unavailable_reason", lambda: "It was not built.")
    progress = RecordedProgress()
    with pytest.raises(NotEstimable) as failure:
        plan_motion.run(plan_task(solver="native"), tmp_path, progress)
    assert failure.value.code == "solver-unavailable"
    assert progress.messages == []


BAD = {
    "a foot in the air": (
        lambda body: body["phases"][2]["contacts"][0]["position_m"].__setitem__(2, 0.3),
        "phases[2].contacts[",
    ),
    "a phase without contacts": (lambda body: body["phases"][3].__setitem__("contacts", []), "phases[3]"),
    "negative time": (lambda body: body["phases"][1].__setitem__("duration_s", -0.5), "phases[1].duration_s"),
    "an unknown effector": (
        lambda body: body["phases"][0]["contacts"][0].__setitem__("effector", "tail"),
        "phases[0].contacts[tail]",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_an_invalid_scenario_is_refused_naming_the_phase(tmp_path: Path, name: str) -> None:
    change, where = BAD[name]
    error = refused(tmp_path, InvalidInput, changed(short_walk(), change))
    assert error.code == "scenario-invalid"
    assert any(fault.where.startswith(where) for fault in error.faults)
    assert error.faults[-1].where == "stage: check"
    assert error.faults[0].where in error.message


def test_an_unknown_robot_is_not_found(tmp_path: Path) -> None:
    error = refused(tmp_path, NotFound, changed(short_walk(), lambda body: body.__setitem__("robot", "marvin")))
    assert error.code == "robot-not-found"
    assert error.faults[-1].where == "stage: check"


def test_densities_of_another_description_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = replace(load_robot("talos"), sha256="cd" * 32)
    monkeypatch.setattr(pipeline, "load_robot", lambda _name: other)
    with pytest.raises(StridelabError) as refusal:
        run(tmp_path, short_walk(), whole_body=False)
    assert refusal.value.code == "reachability-of-another-robot"
    assert refusal.value.faults[0].where == "robot_sha256"
    assert refusal.value.faults[-1].where == "stage: reachability"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("requested", "used"), [(None, DEFAULT_MEASURE), ("uniform", "uniform"), ("conditioned",) * 2])
def test_the_requested_measure_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, requested: str | None, used: str
) -> None:
    """Null means the default one."""
    looked: list[str] = []

    def stand_in(_robot_name: str, measure: str) -> ReachabilityCard:
        looked.append(measure)
        raise NotFound("reachability-not-learned", "not in this test")

    monkeypatch.setattr(plan_problem, "load_card", stand_in)
    with pytest.raises(NotFound):
        run(tmp_path, short_walk(), whole_body=False, measure=requested)
    assert looked == [used]


def test_a_solver_that_does_not_converge_is_reported_with_status_and_iterations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def solve(*args: Any, **options: Any) -> Any:
        from stridelab.centroidal.solver import solve as genuine

        return replace(genuine(*args, **options), converged=False, status="Maximum_Iterations_Exceeded", iterations=200)

    monkeypatch.setattr(plan_centroidal, "solve", solve)
    error = refused(tmp_path, NotEstimable)
    assert error.code == "plan-not-converged"
    assert "Maximum_Iterations_Exceeded after 200 iterations" in error.message
    assert [fault.where for fault in error.faults] == ["solver", "stage: centroidal"]


def test_a_body_that_cannot_follow_keeps_plan_motion_and_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "WholeBodyController", stopping_after(1.2))
    stuck = run(tmp_path, short_walk(), whole_body=True, replay=True)
    error = stuck.outcome.failure
    assert error is not None
    assert error.code == "whole-body-failed"
    assert [fault.where for fault in error.faults] == ["phases[1]", "stage: whole body"]
    problem = stuck.outcome.to_json()["problem"]
    assert (problem["code"], problem["detail"]) == (error.code, error.message)
    stopped = stuck.summary.stopped
    assert stopped is not None
    assert (stopped.time_s, stopped.phase, stopped.level) == (1.2, 1, 0)
    assert stopped.names == ["torque of leg_right_4_joint"]
    assert (stuck.summary.certificate, stuck.summary.replay, stuck.summary.warnings) == (None, None, [])
    assert {path.name for path in tmp_path.iterdir()} == CENTROIDAL_FILES | MOTION_FILES
    about = json.loads((tmp_path / "poses.json").read_text())
    assert about["time_s"][-1] == pytest.approx(1.2)
    assert stuck.arrays()["q"].shape[0] == 301
    assert stuck.progress.messages[-1] == "stopped at 1.20 s"


def test_a_solver_that_hangs_is_ended_and_its_stage_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    heard: list[str] = []

    async def act() -> Any:
        async with IsolatedPool(["stridelab.service.kinds.plan_motion.run"]) as pool:
            return await pool.run(
                "support.robots.plans:plan_with_a_hanging_solver",
                plan_task().model_dump(mode="json"),
                tmp_path,
                timeout_s=45.0,
                memory_mb=4096,
                on_progress=lambda _fraction, message: heard.append(message),
            )

    outcome = asyncio.run(act())
    assert outcome.state == "timeout"
    problem = add_last_progress(outcome.problem, heard[-1])
    assert problem["errors"] == [{"where": "stage: centroidal", "message": f"last progress message: {heard[-1]}"}]
    assert list(tmp_path.iterdir()) == []


def test_a_suspicious_plan_is_remarked_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def solve(*args: Any, **options: Any) -> Any:
        from stridelab.centroidal.solver import solve as genuine

        return replace(genuine(*args, **options), iterations=51)

    monkeypatch.setattr(plan_centroidal, "solve", solve)
    summary = run(tmp_path, short_walk(), whole_body=False).summary
    assert [remark.code for remark in summary.warnings] == ["plan-slow-to-converge"]


def bundled(name: str) -> Scenario:
    return Scenario.model_validate_json((models_dir() / "scenarios" / f"{name}.json").read_text(encoding="utf-8"))


def test_six_stairs_are_climbed(tmp_path: Path) -> None:
    """The whole way on the stairs of the thesis' second experiment, with the bars that a useful motion has to keep."""
    climbed = run(tmp_path, bundled("six-stairs"), whole_body=True, replay=True)
    summary = climbed.summary
    assert summary.certificate is not None
    checks = {check.name: check for check in summary.certificate.checks}
    assert summary.certificate.passed, [check for check in summary.certificate.checks if not check.passed]
    assert checks["com_error_max"].value < 1e-3
    assert checks["landing_error_max"].value < 1e-3
    assert summary.replay is not None
    assert summary.replay.completed
    assert summary.replay.com_error_max_m < 0.03
    report, sequence = validate_and_build(bundled("six-stairs").model_dump(mode="json"), effector_shapes("talos"))
    assert sequence is not None, report.faults
    com = climbed.columns("motion.parquet", "com_z_m")[:, 0]
    assert com[-1] - com[0] == pytest.approx(6 * 0.10, abs=1e-3), "six stairs of ten centimetres"
