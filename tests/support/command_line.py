"""Results of commands, callbacks for progress, staged folders for runs, and a client with scripted answers."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from stridelab.client import Client
from stridelab.machine.models_folder import models_dir
from stridelab.schemas.base import FaultItem, Problem
from stridelab.schemas.jobs import EstimateComInput, Job, JobEvent, JobResult, Progress
from stridelab.schemas.recordings import Recording, RecordingPatch, SubjectFields
from stridelab.schemas.tasks import EstimateComTask, RecordingSource


@dataclass(frozen=True)
class Ran:
    code: int
    out: str
    err: str


Run = Callable[..., Ran]
"""``run(*arguments)``: the command line with these arguments."""


SAMPLE = models_dir() / "recordings" / "sample-walk"


@dataclass
class RecordedProgress:
    """Progress callback that records its calls and asserts that fractions never fall and messages are not empty."""

    fractions: list[float] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)

    def __call__(self, fraction: float, message: str) -> None:
        assert 0.0 <= fraction <= 1.0
        assert not self.fractions or fraction >= self.fractions[-1]
        assert message
        self.fractions.append(fraction)
        self.messages.append(message)


def quiet(_fraction: float, _message: str) -> None:
    """A progress callback that does nothing."""


def estimate_task(
    file: Path, folder: Path, *, subject: SubjectFields | None = None, **options: object
) -> EstimateComTask:
    """Copy ``file`` into ``folder`` and ask for its centre of mass."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, folder / "trial")
    return EstimateComTask(
        recording=RecordingSource(file="trial", filename=file.name, subject=subject or SubjectFields()),
        input=EstimateComInput.model_validate({"recording_id": "r", **options}),
    )


INDEX = json.loads((SAMPLE / "sample.json").read_text())
DONE = INDEX["jobs"]["sample-walk-com"]
NOW = datetime(2024, 1, 1, tzinfo=UTC)


def problem(status: int, code: str) -> Problem:
    return Problem(
        title="t", status=status, code=code, detail="A sentence.", errors=[FaultItem(where="w", message="m")]
    )


class ScriptedService(Client):
    """``refuse`` makes one call fail; ``ends`` is the job's fate, ``done`` its result with one ``artifact``."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, Any]] = []
        self.refuse: dict[str, BaseException] = {}
        self.ends: tuple[str, Problem | None] = ("succeeded", None)
        self.artifact = "com.csv"
        self.done: dict[str, Any] = DONE
        self.files = SAMPLE
        self.labels: list[str] = INDEX["facts"]["labels"]

    def __call__(self, server: str, token: str | None) -> "ScriptedService":
        self.calls.append(("client", (server, token)))
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.calls.append(("close", None))

    def _note(self, call: str, value: Any) -> None:
        self.calls.append((call, value))
        if call in self.refuse:
            raise self.refuse[call]

    def upload(
        self,
        path: Path,
        subject: Any = None,
        *,
        filename: str | None = None,
        session_id: str | None = None,
        progress: Any = None,
    ) -> Recording:
        assert (filename, session_id) == (None, None), "no command states them"
        self._note("upload", (path.name, subject))
        if progress is not None:
            progress(10, 10)
        return self._recording(f"id-of-{path.name}", path.name)

    def patch_recording(self, recording_id: str, patch: RecordingPatch) -> Recording:
        self._note("patch", (recording_id, patch))
        return self._recording(recording_id, recording_id.removeprefix("id-of-"))

    def submit(self, kind: str, request: Any, *, priority: int = 0, idempotency_key: str | None = None) -> Job:
        assert priority == 0, "no command states it"
        assert idempotency_key is not None, "every command states it"
        self._note("submit", (kind, request, bool(idempotency_key)))
        return self._job("queued", None)

    def events(self, job_id: str, last_event_id: int | None = None) -> Iterator[JobEvent]:
        assert last_event_id is None, "no command states it"
        self._note("events", job_id)
        yield JobEvent(seq=1, at=NOW, state="running", attempt=1, progress=Progress(fraction=0.5, message="half"))

    def wait(self, job_id: str, timeout_s: float | None = None) -> Job:
        assert timeout_s is None, "no command states it"
        self._note("wait", job_id)
        return self._job(*self.ends)

    def cancel(self, job_id: str) -> Job:
        self._note("cancel", job_id)
        return self._job("cancelled", None)

    def result(self, job_id: str) -> JobResult:
        self._note("result", job_id)
        artifacts = [{"name": self.artifact, "media_type": "text/csv", "bytes": 1}]
        return JobResult.model_validate(
            {"kind": self.done["kind"], "input": self.done["input"], **self.done["result"], "artifacts": artifacts}
        )

    def download_artifact(self, job_id: str, name: str, target: Path) -> Path:
        self._note("download", name)
        return shutil.copyfile(self.files / name, target)

    def _recording(self, recording_id: str, filename: str) -> Recording:
        facts = {**INDEX["facts"], "subject": {}, "labels": self.labels}
        fixed = {"sha256": "0", "filename": filename, "bytes": 1, "created_at": NOW, "marker_map": {}}
        return Recording.model_validate({**facts, **fixed, "id": recording_id})

    def _job(self, state: Any, error: Problem | None) -> Job:
        return Job(
            id="j",
            kind="estimate-com",
            state=state,
            priority=0,
            progress=Progress(),
            attempt=1,
            created_at=NOW,
            error=error,
        )
