"""Parses a recording's file in a child process with limits on time and memory."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import anyio
import structlog

from stridelab.errors import Fault, UnreadableFile
from stridelab.machine.time_limit import BUSY_FACTOR
from stridelab.schemas.marker_sets import MarkerSetProposal
from stridelab.schemas.recordings import PlateSwitch, RecordingFacts
from stridelab.schemas.streams import Triple
from stridelab.schemas.tasks import ParseUploadTask, RecordingSource
from stridelab.service.api.dependencies import Parts
from stridelab.service.filenames import PARSER_CRASHED, child_output_file
from stridelab.service.kinds.registry import PARSE_UPLOAD, PROPOSE_MARKERS, READ_POSE
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.processes.sandbox import STRICT, Sandbox
from stridelab.service.stored_marker_sets import source_marker_sets

log = structlog.get_logger(__name__)

TRACKS: Final = "tracks.parquet"


def _reader_failures(what: str, damaged: tuple[str, str]) -> Mapping[str, tuple[str, str]]:
    """Code and sentence by the state of a child that did not read ``what``; ``damaged`` is for an unexpected error."""
    return {
        "crashed": PARSER_CRASHED,
        "killed": ("parser-killed", f"The process that read the {what} was killed, possibly for lack of memory."),
        "timeout": ("parser-timed-out", f"Reading the {what} took longer than this service allows."),
        "memory": ("parser-out-of-memory", f"Reading the {what} needed more memory than this service allows."),
        "error": damaged,
    }


FILE_FAILURES: Final = _reader_failures(
    "file", ("unreadable-file", "The file could not be read; it is damaged, or its content does not match its format.")
)
ROBOT_FAILURES: Final = _reader_failures(
    "robot", ("robot-data-unreadable", "The robot could not be read; its description is damaged.")
)
TERRAIN_FAILURES: Final = _reader_failures(
    "terrain",
    ("terrain-mesh-unreadable", "The terrain could not be read; its file is damaged."),
)


@dataclass(frozen=True)
class Switches:
    """User settings of a recording that affect parsing: marker map and plate switches."""

    marker_map: Mapping[str, str]
    plates: Mapping[int, PlateSwitch]

    @staticmethod
    def of_row(row: Mapping[str, Any]) -> "Switches":
        """The switches of a recording's row."""
        plates = {int(index): PlateSwitch.model_validate(switch) for index, switch in row["plate_switches"].items()}
        return Switches(dict(row["marker_map"]), plates)

    def to_columns(self) -> dict[str, Any]:
        """Values of the columns of the recording's row."""
        plates = {str(index): switch.model_dump(exclude_none=True) for index, switch in self.plates.items()}
        return {"marker_map": dict(self.marker_map), "plate_switches": plates}


NO_SWITCHES: Final = Switches({}, {})


@dataclass(frozen=True)
class Parsed:
    """Result of parsing a file: its facts, and the path of the table of tracks."""

    facts: RecordingFacts
    tracks: Path


async def parse_recording(
    parts: Parts,
    folder: Path,
    file: str,
    filename: str,
    switches: Switches,
    static_labels: Sequence[str] = (),
    *,
    owner: str | None,
) -> Parsed:
    """Parse ``folder / file`` with ``switches`` and write the tracks to ``folder``.

    ``filename`` is the uploaded name; the marker map may also refer to ``static_labels``. Marker sets of ``owner`` are
    preferred to those of other users. Raises ``UnreadableFile`` or
    ``InvalidInput`` with the reader's code, and ``UnreadableFile`` if the reader crashes or exceeds its limits.
    """
    async with parts.engine.connect() as connection:
        own_sets = await source_marker_sets(connection, owner)
    source = RecordingSource(
        file=file,
        filename=filename,
        marker_map=dict(switches.marker_map),
        plates=dict(switches.plates),
        static_labels=list(static_labels),
        marker_sets=own_sets,
    )
    outcome = await _run_in_child(parts, PARSE_UPLOAD, source, folder)
    return Parsed(RecordingFacts.model_validate(outcome.value["summary"]), child_output_file(folder, TRACKS))


async def propose_of_file(parts: Parts, folder: Path, file: str, filename: str) -> MarkerSetProposal:
    """Propose the landmarks of the markers in ``folder / file``. Raises as ``parse_recording``."""
    source = RecordingSource(file=file, filename=filename)
    outcome = await _run_in_child(parts, PROPOSE_MARKERS, source, folder)
    return MarkerSetProposal.model_validate(outcome.value["summary"])


async def static_pose_of_file(parts: Parts, folder: Path, file: str, filename: str) -> dict[str, Triple]:
    """Median position of each marker in ``folder / file``, in metres with z up. Raises as ``parse_recording``."""
    outcome = await _run_in_child(parts, READ_POSE, RecordingSource(file=file, filename=filename), folder)
    return {label: (x, y, z) for label, (x, y, z) in outcome.value["summary"].items()}


async def _run_in_child(parts: Parts, function: str, source: RecordingSource, folder: Path) -> IsolatedOutcome:
    """Run ``function`` on ``source`` within the limits of parsing. Raises as ``parse_recording``."""
    task = ParseUploadTask(recording=source).model_dump(mode="json")
    return await run_reader(parts, function, task, folder, FILE_FAILURES, source.filename)


async def run_reader(
    parts: Parts,
    function: str,
    task: Mapping[str, Any],
    folder: Path,
    failures: Mapping[str, tuple[str, str]],
    where: str,
    timeout_s: float | None = None,
    limiter: anyio.CapacityLimiter | None = None,
    sandbox: Sandbox = STRICT,
) -> IsolatedOutcome:
    """Run ``function`` on ``task`` in a confined child within the limits of parsing, or in turn of ``limiter``.

    Raises the error of the child, and ``UnreadableFile`` with one of ``failures`` at the place ``where``.
    """
    limit_s = timeout_s or parts.settings.parse_timeout_s
    async with limiter or parts.parsers:
        outcome = await parts.pool.run(
            function,
            task,
            folder,
            timeout_s=BUSY_FACTOR * limit_s,
            processor_s=limit_s,
            memory_mb=parts.settings.parse_memory_mb,
            low_priority=False,
            sandbox=sandbox,
        )
    if outcome.error_class is not None:
        raise outcome.as_error()
    if outcome.state != "ok":
        log.warning("upload not read", state=outcome.state, log_tail=outcome.log_tail[-2000:])
        code, sentence = failures.get(outcome.state, failures["error"])
        raise UnreadableFile(code, sentence, [Fault(where, "cannot be read")])
    return outcome
