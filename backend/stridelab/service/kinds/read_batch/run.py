"""Parses a bulk upload: unpacks archives, matches the subject table to the files, reads each file in its own process.

Runs in a killable child of ``POST /recordings/batch`` or of a job.
"""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any, Final

from stridelab.errors import Fault, InvalidInput, StridelabError, TooLarge
from stridelab.machine.parallel import map_isolated
from stridelab.machine.time_limit import BUSY_FACTOR
from stridelab.pipelines.progress import ProgressCallback
from stridelab.recordings.files.batch_zip import BatchLimits, is_batch, unpack_batch
from stridelab.schemas.population import MAX_RECORDINGS
from stridelab.schemas.tasks import ParseBatchTask, ParseUploadTask, RecordingSource
from stridelab.service.kinds import parse_upload
from stridelab.service.kinds.base import Json, Outcome
from stridelab.service.kinds.read_batch.parsed_upload import ParsedUpload
from stridelab.service.processes.child import limit_memory
from stridelab.service.subject_table import match_files, read_subject_table

PRELOAD: Final = ("stridelab.service.kinds.read_batch.run",)
ARENA_MB: Final = 1536
"""Address space that pyarrow reserves at its first use, mostly without using it."""
PROCESS_ERRORS: Final = {
    "computation-crashed": ("parser-crashed", "The file broke its reader; it is damaged, or not what it claims to be."),
    "computation-timed-out": ("parser-timed-out", "Reading the file took longer than this service allows."),
}


def parse_batch(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """Parse a bulk upload; returns ``files`` and ``rows``.

    ``files`` have, in order, name, path in ``folder``, hash, size, and either ``facts`` or a ``problem``. ``rows`` are
    the lines of the table with the indices of their file and its static trial. Raises ``UnreadableFile`` for an invalid
    archive, ``InvalidInput`` for an invalid table.
    """
    request = ParseBatchTask.model_validate(task)
    progress(0.0, "unpacking")
    files, table = _unpack_archives(request, folder)
    rows = [] if table is None else read_subject_table(table)
    matched = match_files([name for name, _ in files], rows)
    results = [_describe_file(name, path, folder) for name, path in files]
    _mark_duplicates(results)
    items = [
        {"file": one["file"], "filename": one["name"], "bytes": one["bytes"], "folder": str(folder), "place": place,
         "limit_bytes": request.file_bytes, "memory_mb": request.memory_mb,
         "marker_sets": request.marker_sets}
        for place, one in enumerate(results) if "problem" not in one
    ]  # fmt: skip
    limit_s = request.timeout_s
    done = map_isolated(
        read_one, items, preload=PRELOAD, timeout_s=BUSY_FACTOR * limit_s, processor_s=limit_s, spans_nodes=False
    )
    for count, (index, answer) in enumerate(done, start=1):
        one = results[items[index]["place"]]
        if isinstance(answer, StridelabError):
            code, sentence = PROCESS_ERRORS.get(answer.code, (answer.code, answer.message))
            one["problem"] = {"code": code, "message": sentence}
        else:
            one |= answer
        progress(count / len(items), f"{count} of {len(items)} files read")
    lines = [
        {"place": m.index, "static": m.static_index, "person": m.row.person.model_dump(mode="json")}
        for m in matched
        if m.row is not None
    ]
    return {"files": results, "rows": lines}


def run(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """``parse_batch`` for the job ``read-batch``; its result is added to the outcome as ``read``.

    Raises ``UnreadableFile`` (``nothing-readable``), and the errors of ``parse_batch``.
    """
    read = parse_batch(json.loads(task["task"]), folder, progress)
    ParsedUpload.from_parse_result(read)
    return Outcome(summary={}, references=(), artifacts=()).to_json() | {"read": read}


def read_one(item: Json) -> Json:
    """Read one file; runs in a separate process and writes the tracks to a separate folder."""
    if item["bytes"] > item["limit_bytes"]:
        limit = f"{item['limit_bytes'] / 1e6:g} MB"
        raise TooLarge("upload-too-large", f"The file is larger than {limit}, the limit of this service.")
    limit_memory(item["memory_mb"] + ARENA_MB)
    folder = Path(item["folder"])
    own = folder / f"parsed-{item['place']:04d}"
    own.mkdir()
    try:
        (own / "trial").hardlink_to(folder / item["file"])
    except OSError:  # Landlock ABI 1 forbids hard links between folders
        shutil.copyfile(folder / item["file"], own / "trial")
    source = RecordingSource(file="trial", filename=item["filename"], marker_sets=item["marker_sets"])
    outcome = parse_upload.run(ParseUploadTask(recording=source), own, lambda _fraction, _message: None)
    return {"facts": outcome.summary, "tracks": f"{own.name}/tracks.parquet"}


def _unpack_archives(request: ParseBatchTask, folder: Path) -> tuple[list[tuple[str, Path]], bytes | None]:
    table = None if request.table is None else (folder / request.table).read_bytes()
    files: list[tuple[str, Path]] = []
    left = request.total_bytes
    for index, one in enumerate(request.files):
        path = folder / one.file
        if not is_batch(path):
            files.append((one.filename, path))
            continue
        own = folder / f"zip-{index:04d}"
        own.mkdir()
        held = unpack_batch(path, own, BatchLimits(MAX_RECORDINGS, request.file_bytes, left))
        left -= sum(member.stat().st_size for _, member in held.files)
        files += held.files
        if held.table is not None:
            if table is not None:
                fault = Fault(one.filename, "contains a .csv, and there is another table")
                raise InvalidInput("subject-table-twice", "There are two subject tables; only one is allowed.", [fault])
            table = held.table
    if len(files) > MAX_RECORDINGS:
        message = f"These are {len(files)} recordings; at most {MAX_RECORDINGS} are allowed at a time."
        raise InvalidInput("too-many-files", message, [Fault("file", "too many")])
    return files, table


def _describe_file(name: str, path: Path, folder: Path) -> dict[str, Any]:
    with path.open("rb") as content:
        digest = hashlib.file_digest(content, "sha256").hexdigest()
    place = path.relative_to(folder).as_posix()
    return {"name": name, "file": place, "sha256": digest, "bytes": path.stat().st_size}


def _mark_duplicates(files: list[dict[str, Any]]) -> None:
    first: dict[str, str] = {}
    for one in files:
        if one["sha256"] in first:
            message = f"The same file as {first[one['sha256']]}: a recording counts once."
            one["problem"] = {"code": "recording-twice", "message": message}
        first.setdefault(one["sha256"], one["name"])
