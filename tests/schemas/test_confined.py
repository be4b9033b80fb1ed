"""Every kind of job does its work in the sandbox that the registry gives it, in a real child of the worker's pool."""

import asyncio
import json
import shutil
import stat
import zipfile
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from stridelab.schemas.comparison import BenchMember, ComBenchTask, CompareEstimatorsTask
from stridelab.schemas.cycloid import FitCycloidTask
from stridelab.schemas.imitation.contract import ImitateInput, ImitateSummary, ImitateTask
from stridelab.schemas.jobs import SimulateRecordingInput
from stridelab.schemas.measures import GaitMeasuresTask, GaitReportInput, GaitReportTask, MeasuresMember
from stridelab.schemas.population import PersonFields, PopulationMember, StudyPopulationTask
from stridelab.schemas.receding import PlanRecedingInput, PlanRecedingTask, PushBasinInput, PushBasinTask
from stridelab.schemas.reproduction import ReproduceInput, ReproduceTask
from stridelab.schemas.sweeps import SweepInput, SweepTask
from stridelab.schemas.tasks import SimulateRecordingTask
from stridelab.service.kinds.registry import COMPUTING, KINDS
from stridelab.service.kinds.robots import upload
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.stored_robots import write_staged_robot
from support.command_line import SAMPLE, estimate_task
from support.robots.humanoid import Humanoid, archive
from support.robots.plans import plan_task, short_walk
from support.robots.scenario_bodies import box
from support.robots.scenario_bodies import task as contacts

TRIAL = SAMPLE / "recording.c3d"


def compared(folder: Path) -> Any:
    staged = estimate_task(TRIAL, folder)
    return CompareEstimatorsTask.model_validate(staged.model_dump())


def fitted(folder: Path) -> Any:
    return FitCycloidTask.model_validate(estimate_task(TRIAL, folder).model_dump())


def studied(folder: Path) -> Any:
    members = []
    for name in ("a", "b"):
        task = FitCycloidTask.model_validate(estimate_task(TRIAL, folder / name).model_dump())
        members.append(PopulationMember(recording_id=name, folder=name, task=task, person=PersonFields(subject=name)))
    return StudyPopulationTask(members=members)


def received(folder: Path) -> dict[str, Any]:
    with zipfile.ZipFile(folder / "upload-0000", "w") as archive:
        archive.write(TRIAL, "walk.c3d")
    limits = {"file_bytes": 10**8, "total_bytes": 10**8, "timeout_s": 60.0, "memory_mb": 1024}
    files = [{"file": "upload-0000", "filename": "lab.zip"}]
    return {"task": json.dumps({"files": files, **limits})}


def swept(_folder: Path) -> Any:
    scenario, vary = short_walk(), {"stride": (0.5, 0.6, 2)}
    job_input = SweepInput(scenario=scenario, vary=vary, solver="ipopt", node_rate_hz=5.0)
    return SweepTask(scenario=scenario, input=job_input)


def receding(_folder: Path) -> Any:
    return PlanRecedingTask(scenario=short_walk(), input=PlanRecedingInput(scenario=short_walk()))


def pushed(_folder: Path) -> Any:
    return PushBasinTask(scenario=short_walk(), input=PushBasinInput(scenario=short_walk(), speed_m_s=0.1, n=1))


def benched(folder: Path) -> Any:
    task = estimate_task(TRIAL, folder / "a")
    return ComBenchTask(members=[BenchMember(recording_id="a", folder="a", task=task)])


def measured(folder: Path) -> Any:
    (folder / "recording-000").mkdir()
    task = estimate_task(TRIAL, folder / "recording-000")
    return GaitMeasuresTask(members=[MeasuresMember(recording_id="r", folder="recording-000", task=task)])


def commissioned(folder: Path) -> Any:
    def ignore(_fraction: float, _message: str) -> None:
        pass

    (folder / "upload").write_bytes(archive({"small.urdf": Humanoid(arms=False).urdf()}))
    read = upload.read_robot(upload.ReadRobotTask(file="upload", filename="small.zip", name="small"), folder, ignore)
    task = upload.ProposeCardTask(name="small", title="small", assumed=read.summary["assumed"])
    with pytest.MonkeyPatch.context() as patch:  # the child alone makes the robot known
        patch.setattr("stridelab.machine.models_folder._added_folders", [])
        card = upload.propose(task, folder, ignore).summary["card"]
    shutil.rmtree(folder / "models")
    write_staged_robot(folder, "small", card)
    return {"input": {"robot": "small", "samples": 500, "search_s": 0.01}}


def imitated(folder: Path) -> Any:
    task = estimate_task(TRIAL, folder)
    job_input = ImitateInput(recording_id="r", robot="talos", step_share=0.7, pace=0.5, wheel=False)
    return ImitateTask.model_validate(task.model_dump() | {"input": job_input})


def reported(folder: Path) -> Any:
    members = measured(folder).members
    job_input = GaitReportInput(recording_ids=["r"], title="Confined")
    return GaitReportTask(members=members, input=job_input, created_on=date(2026, 5, 4))


STAGED: dict[str, Callable[[Path], Any]] = {
    "estimate-com": lambda folder: estimate_task(TRIAL, folder, method="complementary"),
    "compare-estimators": compared,
    "fit-cycloid": fitted,
    "com-bench": benched,
    "gait-measures": measured,
    "imitate": imitated,
    "gait-report": reported,
    "study-population": studied,
    "simulate-recording": lambda _: SimulateRecordingTask(input=SimulateRecordingInput(duration_s=2.0)),
    "plan-contacts": lambda _: {"input": contacts([box("floor", (-1.0, 2.0), 0.0)], 0.8, 0.0)},
    "plan-motion": lambda _: plan_task(film="gif"),
    "plan-receding": receding,
    "push-basin": pushed,
    "read-batch": received,
    "reproduce": lambda _: ReproduceTask(input=ReproduceInput(item="fig-2.2")),
    "sweep": swept,
    "commission-robot": commissioned,
    "learn-reachability": lambda _: {"input": {"robot": "talos", "samples": 8000, "effectors": ["left_foot"]}},
}
FILMER = """#!/bin/sh
wc -c > "$TMPDIR/bytes"
for path; do :; done
echo film > "$path"
"""


@pytest.mark.parametrize("name", sorted(STAGED))
def test_every_kind_runs_confined(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    programs, folder = tmp_path / "programs", tmp_path / "work"
    programs.mkdir()
    folder.mkdir()
    filmer = programs / "ffmpeg"
    filmer.write_text(FILMER)
    filmer.chmod(filmer.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{programs}:/usr/bin:/bin")
    monkeypatch.chdir(tmp_path)  # no place to read or to write from
    kind, staged = KINDS[name], STAGED[name](folder)
    task = staged if isinstance(staged, dict) else staged.model_dump(mode="json")

    async def run() -> IsolatedOutcome:
        preload = [module for module in COMPUTING if module == kind.run.partition(":")[0]]
        async with IsolatedPool(preload) as pool:
            limits: dict[str, Any] = {"timeout_s": 300.0, "memory_mb": kind.memory_mb or 3072}
            return await pool.run(kind.run, task, folder, **limits, low_priority=False, sandbox=kind.sandbox)

    outcome = asyncio.run(run())
    assert outcome.state == "ok", (outcome.problem, outcome.log_tail)
    assert "problem" not in outcome.value, outcome.value["problem"]
    artifacts = [item["name"] for item in outcome.value["artifacts"]]
    assert artifacts or name == "read-batch"
    assert all((folder / item).stat().st_size > 0 for item in artifacts)
    if name == "plan-motion":
        assert {"motion.gif", "motion.viser"} <= set(artifacts)
    if name == "imitate":
        summary = ImitateSummary.model_validate(outcome.value["summary"])
        assert summary.certificate.passed
        assert summary.replay.completed
        assert any(attempt.passed for attempt in summary.attempts)
        length = next(row for row in summary.comparison if row.name == "step_length")
        assert length.robot is not None
        assert length.scaled is not None
        assert length.robot == pytest.approx(summary.step_share * length.scaled, rel=0.1)
        assert {"poses.f32", "replay.npz", "comparison.csv", "curves.csv"} <= set(artifacts)
    if name == "read-batch":
        (read,) = outcome.value["read"]["files"]
        assert (folder / read["tracks"]).stat().st_size > 0


def test_every_sandboxed_kind_is_tested() -> None:
    assert set(STAGED) == {name for name, kind in KINDS.items() if kind.sandbox is not None}
