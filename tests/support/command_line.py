"""What a command that was run to its end left behind.

A progress callback that checks what it is told, and a staged folder for runs.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from stridelab.resources import models_dir
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.recordings import SubjectFields
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
class Told:
    """Fractions never fall, end at 1, and every stage says what it does."""

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
    file: Path, folder: Path, *, subject: SubjectFields | None = None, **asked: object
) -> EstimateComTask:
    """Copy ``file`` into ``folder`` and ask for its centre of mass."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, folder / "trial")
    return EstimateComTask(
        recording=RecordingSource(file="trial", filename=file.name, subject=subject or SubjectFields()),
        input=EstimateComInput.model_validate({"recording_id": "r", **asked}),
    )
