"""The HTTP interface as the pages see it, answered from memory: schemas are the real ones, numbers are synthetic.

The walk is that of ``support.fakes.recorded_walk``.
"""

import asyncio
import hashlib
import uuid
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any

import httpx
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from stridelab.client import Client
from stridelab.schemas.base import FaultItem, Problem, Remark
from stridelab.schemas.jobs import Artifact, Job, JobEvent, JobResult, Progress
from stridelab.schemas.plans import StoppedMotion
from stridelab.schemas.previews import SolverFacts, Solvers
from stridelab.schemas.recordings import PlateInfo, Recording, SubjectFields
from stridelab.schemas.robots import Measure
from stridelab.schemas.scenarios import Scenario, StoredScenario
from stridelab.schemas.service import Health
from stridelab.service.api.downloads import FILE_GONE
from stridelab.service.jobs.verdict import verdict_of
from support.fakes import courses, own_card, reachability, recorded_walk, results, robots, terrains
from support.fakes.recorded_walk import (
    DURATION_S,
    LABELS,
    LANDMARKS,
    RATE_HZ,
    SUMMARY,
    WINDOW_S,
    com_parquet,
    corners,
    tracks_parquet,
)

_NOW = datetime(2026, 1, 2, 3, 4, tzinfo=UTC)


class Loop(httpx.BaseTransport):
    """Asks an ASGI app from code that waits; one event loop per request."""

    def __init__(self, app: Starlette) -> None:
        self._inside = httpx.ASGITransport(app)

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        async def ask() -> httpx.Response:
            answer = await self._inside.handle_async_request(request)
            content = await answer.aread()
            return httpx.Response(answer.status_code, headers=answer.headers, content=content, request=request)

        # A thread of its own: the caller may run in an event loop.
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(asyncio.run, ask()).result()


class FakeService:
    """State of the fake: recordings, jobs, how fast jobs move, and for how many seconds it is too busy for new ones."""

    def __init__(self, step_s: float = 0.05) -> None:
        self.recordings: dict[str, Recording] = {}
        self.subjects = results.FakeSubjects(self.recordings)
        self.busy: int | None = None
        self.jobs: dict[str, Job] = {}
        self.inputs: dict[str, dict[str, Any]] = {}
        self.stopped: dict[str, StoppedMotion] = {}
        self.patches: list[dict[str, Any]] = []
        self.scenarios: dict[str, StoredScenario] = {}
        self.plans: dict[str, dict[str, bytes]] = {}
        self.results: dict[str, JobResult] = {}
        self.comparisons: dict[str, tuple[bool, dict[str, bytes]]] = {}
        self.failing: Problem | None = None
        self.card = own_card.OwnCard()
        self.measures, self.stale_measures = list[Measure](reachability.MEASURES), list[Measure]()
        self.robot_refusal: tuple[int, str, str] | None = None
        self.preparation, self.step_s, self.files_are_gone = robots.READY, step_s, False
        self.tracks, self.com, self.wheel = tracks_parquet(), com_parquet(), recorded_walk.wheel_parquet()

    def add_recording(self, filename: str = "walk.c3d", **fields: Any) -> Recording:
        """A recording that parsed well."""
        recording = Recording(
            id=uuid.uuid4().hex, sha256=fields.pop("sha256", "0" * 64), filename=filename,
            bytes=123456, created_at=_NOW, duration_s=fields.pop("duration_s", DURATION_S), n_frames=300,
            marker_rate_hz=RATE_HZ,
            force_rate_hz=1000.0, marker_set=fields.pop("marker_set", "plug-in-gait"), n_markers=len(LABELS),
            subject=fields.pop("subject", SubjectFields(height_m=1.71, sex="female")), mass_from_force_kg=60.2,
            plates=[
                PlateInfo(index=1, type=2, corners_m=corners(1.2, 0.1), loaded_s=[(0.6, 1.6)]),
                PlateInfo(index=2, type=2, corners_m=corners(2.0, -0.1), loaded_s=[(1.4, 2.4)]),
            ],
            windows_s=[WINDOW_S], up_axis="+z", walking_direction=[1.0, 0.0, 0.0], labels=list(LABELS),
            landmarks=LANDMARKS, missing_landmarks=["l_mt2", "r_mt2"], marker_map={},
            warnings=[Remark(code="gaps-filled", message="C7 is hidden for the last 0.5 s.")], **fields,
        )  # fmt: skip
        self.recordings[recording.id] = recording
        return recording

    def add_job(self, kind: str = "estimate-com", state: str = "queued", **fields: Any) -> Job:
        """A job in a state."""
        fields.setdefault("has_result", state == "succeeded")
        names = {key: one.filename for key, one in self.recordings.items()}
        names |= {key: one.name for key, one in self.scenarios.items()}
        fields.setdefault("about", names.get(fields.get("recording_id") or fields.get("scenario_id", "")))
        job = Job(
            id=uuid.uuid4().hex, kind=kind, state=state, priority=0, attempt=1, created_at=_NOW,
            progress=fields.pop("progress", Progress(fraction=1.0 if state == "succeeded" else 0.0)), **fields,
        )  # fmt: skip
        self.jobs[job.id] = job
        return job

    def add_scenario(self, *, bundled: bool = False, given: Scenario | None = None) -> StoredScenario:
        """A stored scenario."""
        stored_scenario = robots.stored(given or robots.scenario(), bundled=bundled)
        self.scenarios[stored_scenario.id] = stored_scenario
        return stored_scenario

    def add_plan(
        self,
        given: Scenario | None = None,
        *,
        whole_body: bool = True,
        replay: bool = False,
        scenario_id: str | None = None,
    ) -> Job:
        """A finished plan."""
        job = self.add_job("plan-motion", "succeeded")
        planned_scenario = given or robots.scenario()
        self.plans[job.id] = robots.plan_files(planned_scenario, whole_body=whole_body, replay=replay)
        self.inputs[job.id] = {"scenario_id": scenario_id}
        self.change(job.id, verdict=verdict_of(self.result(job.id).summary))
        return self.jobs[job.id]

    def add_receding(self, pushes: list[dict[str, Any]]) -> Job:
        """A finished walk with a receding horizon."""
        job = self.add_job("plan-receding", "succeeded")
        self.plans[job.id] = robots.receding_files()
        self.inputs[job.id] = {"scenario_id": "flat-walk", "pushes": pushes}
        return job

    def add_comparison(self, *, with_truth: bool = True) -> Job:
        """A finished comparison of estimators."""
        job = self.add_job(results.COMPARISON_KIND, "succeeded")
        self.comparisons[job.id] = (with_truth, results.tables(with_truth=with_truth))
        return job

    def change(self, job_id: str, **fields: Any) -> None:
        """Replace fields of a job."""
        self.jobs[job_id] = self.jobs[job_id].model_copy(update=fields)

    async def run(self, job_id: str) -> None:
        """Take a job through its states, unless it is cancelled."""
        for fraction in (0.0, 0.25, 0.5, 0.75):
            await asyncio.sleep(self.step_s)
            if self.jobs[job_id].state == "cancelled":
                return
            self.change(job_id, state="running", progress=Progress(fraction=fraction, message="fusing"))
        if self.failing is not None:
            self.change(job_id, state="failed", error=self.failing, finished_at=_NOW)
            return
        if self.jobs[job_id].kind == "plan-motion":
            self.plans[job_id] = robots.plan_files(self.scenarios[self.inputs[job_id]["scenario_id"]])
        changes = {"state": "succeeded", "has_result": True, "progress": Progress(fraction=1.0)}
        self.change(job_id, **changes, started_at=_NOW, finished_at=_NOW)

    def result(self, job_id: str) -> JobResult:
        """The result of a succeeded job."""
        job = self.jobs[job_id]
        job_input = self.inputs.get(job_id, {"recording_id": job.recording_id})
        if job_id in self.results:
            return self.results[job_id]
        if job_id in self.plans:
            receding = self.jobs[job_id].kind == "plan-receding"
            make_result = robots.receding_result if receding else robots.plan_result
            job_result = make_result(job_input, self.plans[job_id])
            if job_id in self.stopped:
                early_summary = {"stopped": self.stopped[job_id].model_dump(), "certificate": None, "replay": None}
                job_result.summary.update(early_summary)
            return job_result
        if job_id in self.comparisons:
            with_truth, files = self.comparisons[job_id]
            return results.comparison_result(job_input, files, with_truth=with_truth)
        known = results.RESULTS | {recorded_walk.KIND: recorded_walk.result, reachability.KIND: reachability.result}
        if job.kind in known:
            return known[job.kind](job_input)
        about: dict[str, Any] = {"kind": job.kind, "input": job_input, "versions": {"stridelab": "0.1.0"}}
        if job.kind == "simulate-recording":
            summary = {"recording_id": next(iter(self.recordings)), "speed_m_s": 1.2, "n_steps": 6, "warnings": []}
            return JobResult(**about, references=[], summary=summary, artifacts=[])
        artifacts = [
            Artifact(name="com.parquet", media_type="application/vnd.apache.parquet", bytes=len(self.com)),
            Artifact(name="com.csv", media_type="text/csv", bytes=12345),
        ]
        return JobResult(**about, references=["dumas2007"], summary=SUMMARY, artifacts=artifacts)

    def client(self) -> Client:
        """A synchronous client of the fake, without a network."""
        return Client("http://127.0.0.1", transport=Loop(self.app()))

    def app(self) -> Starlette:
        """The ASGI app."""
        api = "/api/v1"
        routes = [
            *self.subjects.routes(api),
            *(Route(f"{api}/{name}", self._health) for name in ("health", "caller")),
            Route(f"{api}/recordings", self._recordings, methods=["GET", "POST"]),
            Route(f"{api}/recordings/{{id}}", self._recording, methods=["GET", "PATCH", "DELETE"]),
            Route(f"{api}/recordings/{{id}}/tracks.parquet", self._tracks),
            Route(f"{api}/jobs", self._jobs),
            Route(f"{api}/jobs/{{id}}", self._job, methods=["GET", "DELETE"]),
            Route(f"{api}/jobs/{{kind}}", self._submit, methods=["POST"]),
            Route(f"{api}/jobs/{{id}}/events", self._events),
            Route(f"{api}/jobs/{{id}}/partial", results.no_parts(self.jobs)),
            Route(f"{api}/jobs/{{id}}/result", self._result),
            Route(f"{api}/jobs/{{id}}/artifacts/{{name}}", self._artifact),
            Route(f"{api}/scenarios", self._scenarios, methods=["GET", "POST"]),
            Route(f"{api}/scenarios/check", self._check, methods=["POST"]),
            Route(f"{api}/scenarios/compose", courses.compose, methods=["POST"]),
            *terrains.routes(api),
            Route(f"{api}/scenarios/{{id}}", self._scenario, methods=["GET", "PUT"]),
            Route(f"{api}/solvers", self._solvers),
            *(Route(api + name, lambda _: _answer({"items": []})) for name in results.EMPTY_LISTS),
            Route(f"{api}/robots", self._robots),
            Route(f"{api}/robots/{{name}}", self._robot),
            Route(f"{api}/robots/{{name}}/preparation", lambda _: _answer(self.preparation.model_dump(mode="json"))),
            Route(f"{api}/robots/{{name}}/card", self.card.answer, methods=["GET", "PUT"]),
            Route(f"{api}/robots/{{name}}/reachability", self._reachability),
            Route(
                f"{api}/robots/{{name}}/links", lambda _: Response(robots.links_glb(), media_type="model/gltf-binary")
            ),
        ]
        return Starlette(routes=routes)

    async def _recordings(self, request: Request) -> Response:
        if request.method == "GET":
            return _answer(results.listed_recordings(self.recordings.values(), request.query_params))
        form = await request.form()
        file = form["file"]
        assert not isinstance(file, str)
        name, content = file.filename or "", await file.read()
        await form.close()
        if not content.startswith(b"\x02P"):
            reason = f"{name} is neither a C3D file nor a ZIP."
            return _problem(422, "not-a-recording", reason, [(name, "no C3D header")])
        digest = hashlib.sha256(content).hexdigest()
        same = [known for known in self.recordings.values() if known.sha256 == digest]
        if same and "reuse" in request.query_params:
            return JSONResponse(same[-1].model_dump(mode="json"), 201, {"Stridelab-Reused": "true"})
        return _answer(self.add_recording(name, sha256=digest).model_dump(mode="json"), 201)

    async def _recording(self, request: Request) -> Response:
        key = request.path_params["id"]
        if key not in self.recordings:
            return _problem(404, "recording-not-found", "There is no such recording.")
        if request.method == "DELETE":
            del self.recordings[key]
            return Response(status_code=204)
        if request.method == "PATCH":
            patch = await request.json()
            self.patches.append(patch)
            names = ("marker_map", "static_recording_id", "subject_id")
            changes: dict[str, Any] = {k: v for k, v in patch.items() if k in names}
            if "subject" in patch:
                changes["subject"] = SubjectFields.model_validate(patch["subject"])
            self.recordings[key] = self.recordings[key].model_copy(update=changes)
        return _answer(self.recordings[key].model_dump(mode="json"))

    async def _tracks(self, request: Request) -> Response:
        if request.path_params["id"] not in self.recordings:
            return _problem(404, "recording-not-found", "There is no such recording.")
        return Response(self.tracks, media_type="application/vnd.apache.parquet")

    def _pooled(self, job: Job) -> list[str]:
        return self.inputs.get(job.id, {}).get("recording_ids") or [] if job.kind.startswith("gait-") else []

    async def _jobs(self, request: Request) -> Response:
        query = request.query_params
        matching = [
            job
            for job in reversed(self.jobs.values())
            if all(getattr(job, key) in query.getlist(key) for key in ("state", "kind", "scenario_id") if key in query)
            and query.get("recording_id", job.recording_id) in {job.recording_id, *self._pooled(job)}
        ]
        if "one_per_scenario" in query:
            matching = list({job.scenario_id: job for job in reversed(matching)}.values())
        shown = matching[: int(query.get("limit", 50))]
        return _answer({"items": [job.model_dump(mode="json") for job in shown], "next": None})

    async def _health(self, _: Request) -> Response:
        return _answer(Health(version="0.1.0", uptime_s=12.5).model_dump(mode="json"))

    async def _submit(self, request: Request) -> Response:
        if self.busy is not None:
            refused = _problem(429, "queue-full", "200 jobs are waiting already.")
            refused.headers["Retry-After"] = str(self.busy)
            return refused
        job_input = await request.json()
        job = self.add_job(request.path_params["kind"], recording_id=job_input.get("recording_id"))
        self.inputs[job.id] = job_input
        asyncio.get_running_loop().create_task(self.run(job.id))
        return _answer(job.model_dump(mode="json"), 202)

    async def _job(self, request: Request) -> Response:
        key = request.path_params["id"]
        if key not in self.jobs:
            return _problem(404, "job-not-found", "There is no such job.")
        if request.method == "DELETE":
            self.change(key, state="cancelled")
        return _answer(self.jobs[key].model_dump(mode="json"))

    async def _events(self, request: Request) -> Response:
        key = request.path_params["id"]

        async def stream() -> Any:
            last_state = None
            for seq in range(10_000):
                job = self.jobs[key]
                if job != last_state:
                    last_state = job
                    event = JobEvent(seq=seq, at=_NOW, state=job.state, attempt=1, progress=job.progress)
                    yield f"id: {seq}\nevent: progress\ndata: {event.model_dump_json()}\n\n"
                if job.state in ("succeeded", "cancelled", "failed"):
                    return
                await asyncio.sleep(0.02)

        return StreamingResponse(stream(), media_type="text/event-stream")

    async def _result(self, request: Request) -> Response:
        return _answer(self.result(request.path_params["id"]).model_dump(mode="json"))

    async def _scenarios(self, request: Request) -> Response:
        if request.method == "GET":
            newest = [s.model_dump(mode="json") for s in reversed(self.scenarios.values())]
            return _answer({"items": newest[: int(request.query_params.get("limit", 50))], "next": None})
        new_scenario = Scenario.model_validate(await request.json())
        return _answer(self.add_scenario(given=new_scenario).model_dump(mode="json"), 201)

    async def _scenario(self, request: Request) -> Response:
        key = request.path_params["id"]
        if key not in self.scenarios:
            return _problem(404, "scenario-not-found", "There is no such scenario.")
        if request.method == "PUT":
            if self.scenarios[key].bundled:
                return _problem(409, "scenario-read-only", "This scenario is a sample and cannot be changed.")
            if request.headers.get("if-match", "*") not in ("*", self.scenarios[key].etag):
                return _problem(412, "scenario-changed", "This scenario has been changed elsewhere since it was read.")
            new_scenario = Scenario.model_validate(await request.json())
            if wrong := robots.refusal(new_scenario):
                return _problem(422, "scenario-invalid", "This scenario cannot be used.", wrong)
            self.scenarios[key] = robots.stored(new_scenario, key=key)
        return _answer(self.scenarios[key].model_dump(mode="json"))

    async def _check(self, request: Request) -> Response:
        return _answer(robots.check(Scenario.model_validate(await request.json())).model_dump(mode="json"))

    async def _solvers(self, _: Request) -> Response:
        native = SolverFacts(name="native", available=False, missing="The C++ solver has not been built here.")
        return _answer(Solvers(auto="casadi", solvers=[native]).model_dump(mode="json"))

    async def _robots(self, _: Request) -> Response:
        listed = robots.robots(None if self.robot_refusal is None else self.robot_refusal[2])
        return _answer({"items": [item.model_dump(mode="json") for item in listed], "next": None})

    async def _robot(self, _: Request) -> Response:
        if self.robot_refusal is not None:
            return _problem(*self.robot_refusal)
        return _answer(self.card.mark_facts(robots.robot(self.measures, self.stale_measures)).model_dump(mode="json"))

    async def _reachability(self, request: Request) -> Response:
        measure = request.query_params.get("measure", "uniform")
        if measure not in self.measures:
            return _problem(404, "reachability-not-learned", "No such densities were learned.")
        return _answer(reachability.reach(measure).model_dump(mode="json"))

    async def _artifact(self, request: Request) -> Response:
        if self.files_are_gone:
            return _problem(404, "file-gone", FILE_GONE)
        _, compared = self.comparisons.get(request.path_params["id"], (False, None))
        files = self.plans.get(request.path_params["id"], compared)
        if files is not None:
            return Response(files[request.path_params["name"]], media_type="application/octet-stream")
        if request.path_params["name"] == reachability.FILE:
            return Response(reachability.job_file(), media_type="application/json")
        content = self.wheel if request.path_params["name"] == "wheel.parquet" else self.com
        return Response(content, media_type="application/vnd.apache.parquet")


def _answer(value: Any, status: int = 200) -> Response:
    return JSONResponse(value, status_code=status)


def _problem(status: int, code: str, detail: str, errors: list[tuple[str, str]] | None = None) -> Response:
    faults = [FaultItem(where=where, message=message) for where, message in errors or []]
    body = Problem(title=str(status), status=status, code=code, detail=detail, errors=faults)
    return Response(body.model_dump_json(), status_code=status, media_type="application/problem+json")
