"""The address of every kind of page, with something on it: results, waiting, failed and empty ones, and refusals."""

import io
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from stridelab.schemas.base import FaultItem, Problem
from stridelab.schemas.jobs import Artifact, JobResult, JobVerdict, Progress
from stridelab.schemas.receding import PushBasinSummary
from stridelab.schemas.reproduction import ClaimResult, ReproduceSummary
from stridelab.schemas.sweeps import SweepAxis, SweepSummary
from stridelab_web.pages.home import SAMPLE_RECORDING
from support.fakes import imitation, reachability, recorded_walk, results
from support.fakes.service import FakeService

ROBOT = "boxes"


def every_page(fake: FakeService) -> dict[str, str]:
    """Fill ``fake`` with one of everything, and say under which address each page shows it."""
    walk, person = fake.add_recording('<b>walk</b> "1".c3d'), fake.add_recording("standing.c3d")
    sample, own = fake.add_scenario(bundled=True), fake.add_scenario()
    somebody = fake.subjects.add("<i>P07</i>", height_m=1.71)
    fake.recordings[walk.id] = walk.model_copy(update={"subject_id": somebody.subject_id})
    fake.recordings[SAMPLE_RECORDING] = walk.model_copy(update={"id": SAMPLE_RECORDING, "bundled": True})
    estimate = fake.add_job("estimate-com", "succeeded", recording_id=walk.id)
    wheel = fake.add_job(recorded_walk.KIND, "succeeded", recording_id=walk.id)
    plan = fake.add_plan(replay=True, scenario_id=sample.id)
    receding = fake.add_receding([{"time_s": 1.0, "velocity_m_s": [0.0, 0.1, 0.0]}])
    jobs = {
        "estimate": estimate.id,
        "comparison": fake.add_comparison().id,
        "wheel": wheel.id,
        "receding": receding.id,
        "measures": fake.add_job(results.MEASURES_KIND, "succeeded").id,
        "learned": fake.add_job(reachability.KIND, "succeeded").id,
        "sweep": _keep(fake, "sweep", *_sweep()),
        "pushes": _keep(fake, "push-basin", *push_basin_result()),
        "imitation": _keep(fake, imitation.KIND, *imitation.imitation_result()),
        "reproduction-of-one": _keep(fake, "reproduce", *_reproduction()),
        "running": fake.add_job(state="running", progress=Progress(fraction=0.5, message="fusing")).id,
        "failed": fake.add_job(state="failed", error=_PROBLEM, log_tail="step 3 of 7\nstopped\n" * 40).id,
    }
    planning = fake.add_job(
        "plan-motion",
        "running",
        progress=Progress(fraction=0.4, message="whole body: 3 of 9 phases"),
        scenario_id=own.id,
    )
    fake.change(plan.id, verdict=_FELL)
    fake.change(estimate.id, verdict=_DOUBTFUL)
    fake.change(wheel.id, verdict=_AGREE)
    return {
        "home": "/",
        "recordings": "/recordings",
        "recording": f"/recordings/{walk.id}",
        "sample": f"/recordings/{SAMPLE_RECORDING}",
        "subjects": "/subjects",
        "subject": f"/subjects/{somebody.subject_id}",
        "scenarios": "/scenarios",
        "new scenario": "/scenarios/new",
        "terrain from a file": "/scenarios/new/file",
        "scenario": f"/scenarios/{own.id}",
        "live": "/live",
        "help": "/help/theory/smoother",
        "live-robots": "/live/robots",
        "sweeps": "/sweeps",
        "settings": "/settings",
        "robots": "/robots",
        "robot": f"/robots/{ROBOT}",
        "population-new": f"/population?recording={person.id}",
        "population": f"/population/{fake.add_job(results.POPULATION_KIND, 'succeeded').id}",
        "reproduction": "/reproduction",
        "jobs": "/jobs",
        **{name: f"/jobs/{job_id}" for name, job_id in jobs.items()},
        "plan": f"/plans/{plan.id}",
        "plan-waiting": f"/plans/{fake.add_job('plan-motion', queue_position=2).id}",
        "plan-running": f"/plans/{planning.id}",
        "login": "/login?wrong=1",
        "no-page": "/nothing",
        "no-recording": "/recordings/nothing",
        "no-scene": "/view/",
        "view-recording": f"/view/?recording={walk.id}&job={estimate.id}",
        "view-plan": f"/view/?plan={plan.id}",
        "view-scenario": f"/view/?scenario={own.id}",
        "view-planning": f"/view/?scenario={own.id}&planning={planning.id}",
        "view-robot": f"/view/?robot={ROBOT}",
    }


_FELL = JobVerdict(
    outcome="failed", code="replay-fell", message="Not certified: terrain distance; the robot falls at 3.2 s"
)
_DOUBTFUL = JobVerdict(outcome="doubtful", code="sensors-doubtful", message="Doubtful: force residual")
_AGREE = JobVerdict(outcome="passed", code="sensors-agree", message="Sensors agree")
_PROBLEM = Problem(
    title="Unprocessable",
    status=422,
    code="no-window",
    detail="No interval is measured.",
    errors=[FaultItem(where="plate 2", message="never loaded")],
)


def _keep(fake: FakeService, kind: str, summary: dict[str, Any], files: dict[str, bytes]) -> str:
    job = fake.add_job(kind, "succeeded")
    artifacts = [
        Artifact(
            name=name, media_type="image/svg+xml" if name.endswith(".svg") else "application/x", bytes=len(content)
        )
        for name, content in files.items()
    ]
    fake.results[job.id] = JobResult(
        kind=kind, input={}, versions={"stridelab": "0.1.0"}, references=[], summary=summary, artifacts=artifacts
    )
    fake.plans[job.id] = files
    return job.id


def _sweep() -> tuple[dict[str, Any], dict[str, bytes]]:
    stride = SweepAxis(field="stride", unit="m", values=[0.5, 1.0, 1.5], present=0.9)
    outcomes = ["feasible", "infeasible", "refused"]
    summary = SweepSummary(
        scenario_name="Steps", robot=ROBOT, axes=[stride], points=3, feasible=1, refused=1, infeasible=1, failed=0,
        solvers={"native": 3}, solve_time_s=0.01, wall_time_s=1.0, processes=2, warnings=[],
    )  # fmt: skip
    file = io.BytesIO()
    why = ["", "no motion was found", "the step is too long"]
    pq.write_table(pa.table({"outcome": outcomes, "objective": [1.5, None, None], "why": why}), file)
    return summary.model_dump(mode="json"), {"sweep.parquet": file.getvalue()}


def push_basin_result() -> tuple[dict[str, Any], dict[str, bytes]]:
    """Summary and files of a push basin with every outcome."""
    outcomes = ["survived", "unexplained", "proved-lost", "survived"]
    summary = PushBasinSummary(
        scenario_name="Steps", robot=ROBOT, duration_s=8.0, speed_m_s=0.3, impulse_ns=27.1, n=4, seed=1, survived=2,
        proved_lost=1, unexplained=1, arrived=2, completed=1, survived_ci95=(0.15, 0.85), provable=True,
        certified=True, wall_time_s=9.0, processes=2, warnings=[],
    )  # fmt: skip
    reason = "falls 1.57 s after the push; not proved that no motion would have saved it"
    columns = {
        "time_s": [0.5, 2.0, 4.5, 7.5], "direction_rad": [0.1, 1.6, -1.5, 3.0], "outcome": outcomes,
        "reason": ["A loaded foot slips by 21 mm.", reason, "no motion within the premises", ""],
    }  # fmt: skip
    file = io.BytesIO()
    pq.write_table(pa.table(columns), file)
    return summary.model_dump(mode="json"), {"pushes.parquet": file.getvalue()}


def _reproduction() -> tuple[dict[str, Any], dict[str, bytes]]:
    claim = ClaimResult(
        key="a",
        says="a claim",
        thesis=0.25,
        ours=0.0125,
        unit="m",
        verdict="beaten",
        note="",
        evidence="simulated",
        n=5,
    )
    summary = ReproduceSummary(
        item="fig-2.6", title="Spectra", verdict="beaten", thesis={"a": 0.25}, ours={"a": 0.0125}, claims=[claim],
        seeds=5, note="What it means.",
    )  # fmt: skip
    drawing = b'<svg xmlns="http://www.w3.org/2000/svg" width="300" height="200"><rect width="300" height="200"/></svg>'
    return summary.model_dump(mode="json"), {"fig-2.6.svg": drawing}
