"""What the pages ask the HTTP interface, and nothing else."""

from typing import Any

import httpx
from pydantic import TypeAdapter

from stridelab.schemas.base import Page, Problem
from stridelab.schemas.jobs import Job, JobResult
from stridelab.schemas.recordings import Recording
from stridelab_web.config import WebConfig


class BackendProblem(Exception):
    """The interface refused; ``problem`` says why."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.problem = problem


class Backend:
    """The calls of the pages, typed with the schemas."""

    def __init__(self, config: WebConfig) -> None:
        headers = {"Authorization": f"Bearer {config.token}"} if config.token else {}
        self._http = httpx.AsyncClient(
            base_url=f"{config.base_url}/api/v1", transport=config.transport, headers=headers, timeout=60.0
        )

    async def _get(self, path: str, **query: Any) -> httpx.Response:
        answer = await self._http.get(path, params={k: v for k, v in query.items() if v not in (None, "")})
        if answer.is_error:
            raise BackendProblem(Problem.model_validate_json(answer.content))
        return answer

    async def recordings(self, *, limit: int = 50, cursor: str = "") -> Page[Recording]:
        answer = await self._get("/recordings", limit=limit, cursor=cursor)
        return TypeAdapter(Page[Recording]).validate_json(answer.content)

    async def recording(self, recording_id: str) -> Recording:
        return Recording.model_validate_json((await self._get(f"/recordings/{recording_id}")).content)

    async def tracks(self, recording_id: str) -> bytes:
        return (await self._get(f"/recordings/{recording_id}/tracks.parquet")).content

    async def jobs(
        self, *, limit: int = 50, cursor: str = "", state: str = "", kind: str = "", recording_id: str = ""
    ) -> Page[Job]:
        answer = await self._get("/jobs", limit=limit, cursor=cursor, state=state, kind=kind, recording_id=recording_id)
        return TypeAdapter(Page[Job]).validate_json(answer.content)

    async def job(self, job_id: str) -> Job:
        return Job.model_validate_json((await self._get(f"/jobs/{job_id}")).content)

    async def result(self, job_id: str) -> JobResult:
        return JobResult.model_validate_json((await self._get(f"/jobs/{job_id}/result")).content)

    async def artifact(self, job_id: str, name: str) -> bytes:
        return (await self._get(f"/jobs/{job_id}/artifacts/{name}")).content
