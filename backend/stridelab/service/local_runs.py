"""Runs of jobs for commands and for the library: their requests, the files given to them, and their result folders.

A result folder has the files that the service would publish, ``result.json`` and ``references.bib``.
"""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from stridelab.errors import Conflict, Fault, InvalidInput, UnreadableFile
from stridelab.recordings.files.recording_files import recordings_in
from stridelab.schemas.base import Contract
from stridelab.schemas.jobs import Artifact, JobResult
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.provenance import bibtex_of, software_versions

RESULT_FILE = "result.json"
REFERENCES_FILE = "references.bib"
OPTIONS = {
    "belt_speed_m_s": "--belt-speed",
    "moment_offset_m": "--moment-offset",
    "height_m": "--height",
    "mass_kg": "--mass",
    "sex": "--sex",
    "age_years": "--age",
    "latency": "--latency",
    "cutoffs": "--cutoffs",
    "smoother": "--prior",
    "ahead": "--ahead",
    "window_s": "--window",
    "robot": "--robot",
    "effectors": "--effector",
    "samples": "--samples",
    "measure": "--measure",
    "gait": "--gait",
    "duration_s": "--duration",
    "speed_m_s": "--speed",
    "seed": "--seed",
    "noise": "--noise",
    "lab": "--lab",
    "item": "ITEM",
    "seeds": "--seeds",
    "pushes": "--push",
    "vary": "--vary",
    "payload_kg": "--payload",
    "friction": "--friction",
    "delay_s": "--delay",
}
"""Option that sets a field of the contract, for messages."""
T = TypeVar("T", bound=Contract)


def validate_options(model: type[T], fields: Mapping[str, Any]) -> T:
    """Instance of a contract model. Raises ``InvalidInput`` naming the options of invalid fields."""
    try:
        return model.model_validate(fields)
    except ValidationError as error:
        faults = [
            _fault_of_option(item["loc"], item["msg"].removeprefix("Value error, "), model)
            for item in error.errors(include_url=False)
        ]
        raise InvalidInput("option-invalid", "An option has an invalid value.", faults) from error


def _fault_of_option(path: Sequence[int | str], message: str, model: type[Contract]) -> Fault:
    """Fault with the option in its place; messages on several fields begin with the name of the wrong one."""
    field, _, reason = message.partition(": ")
    if not path and field in model.model_fields:
        path, message = (field,), reason
    path = [part for part in path if part != "[key]"]  # Pydantic's place of a name in a mapping
    name = str(path[0]) if path else "options"
    inside = f"{path[-1]}: " if len(path) > 1 else ""
    return Fault(OPTIONS.get(name, name), inside + message)


def require_file(path: Path) -> None:
    """Raise ``UnreadableFile`` unless the path is a file that can be opened."""
    reasons: tuple[tuple[Callable[[], bool], str], ...] = (
        (path.exists, "there is no such file"),
        (path.is_file, "it is not a file"),
    )
    for holds, reason in reasons:
        if not holds():
            raise UnreadableFile("file-not-found", f"Cannot read {path}: {reason}.", [Fault(str(path), reason)])
    try:
        path.open("rb").close()
    except OSError as error:
        reason = error.strerror or "it cannot be opened"
        raise UnreadableFile("file-not-readable", f"Cannot read {path}: {reason}.") from error


def collect_recordings(paths: Sequence[Path]) -> list[Path]:
    """Given files and the recordings in given folders, in their order.

    Raises ``UnreadableFile`` for a path that does not exist, ``InvalidInput`` (``no-recordings``) without any.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            files += recordings_in(path)
        else:
            require_file(path)
            files.append(path)
    if not files:
        named = ", ".join(str(path) for path in paths)
        sought = "In a folder, C3D, TRC and MVNX files and zips are sought; exports as TSV or CSV are named themselves."
        message = f"There is no recording in {named}. {sought}"
        raise InvalidInput("no-recordings", message, [Fault("FILES", "nothing")])
    return files


@contextmanager
def result_folder(target: Path, *, force: bool) -> Iterator[Path]:
    """A temporary folder beside ``target`` that takes its name when the block succeeds, and is removed when it fails.

    Raises ``Conflict`` when ``target`` exists and ``force`` is off, or when it is not an earlier result: only a folder
    that holds a ``result.json`` and no subfolders is ever replaced.
    """
    target = target.expanduser().absolute()
    refuse_to_overwrite(target, force=force)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{target.name}.part-", dir=target.parent))
    except OSError as error:
        raise cannot_write(target, error) from error
    try:
        yield part
        part.chmod(0o777 & ~_read_umask())
        _move_into_place(part, target)
    except OSError as error:
        raise cannot_write(target, error) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def refuse_to_overwrite(target: Path, *, force: bool) -> None:
    """Raise ``Conflict`` where ``result_folder`` would; call it before the computation."""
    if not target.exists() and not target.is_symlink():
        return
    if not force:
        raise Conflict("output-exists", f"{target} exists; choose another --out or pass --force to replace it.")
    entries = list(target.iterdir()) if target.is_dir() and not target.is_symlink() else []
    is_result = any(entry.name == RESULT_FILE for entry in entries) and all(entry.is_file() for entry in entries)
    if not is_result and (entries or not target.is_dir() or target.is_symlink()):
        raise Conflict("output-not-a-result", f"{target} is not an earlier result, so --force does not replace it.")


def write_file(target: Path, text: str, *, force: bool, option: str) -> None:
    """Write a text file. Raises ``Conflict`` (``output-exists``), ``InvalidInput`` (``output-not-writable``)."""
    target = target.expanduser().absolute()
    if target.is_symlink() or (target.exists() and not (force and target.is_file())):
        advice = (
            f"choose another {option} or pass --force to replace it" if target.is_file() else "it is not a regular file"
        )
        raise Conflict("output-exists", f"{target} exists; {advice}.")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.part-", dir=target.parent) as folder:
            part = Path(folder) / target.name
            part.write_text(text, encoding="utf-8")
            part.replace(target)
    except OSError as error:
        raise cannot_write(target, error, option) from error


def write_result(
    folder: Path, kind: str, input_: Contract, outcome: "Outcome", *, versions: Mapping[str, str] | None = None
) -> JobResult:
    """Write ``result.json`` and ``references.bib`` beside the artifacts, by default with this machine's versions."""
    result = JobResult(
        kind=kind,
        input=input_.model_dump(mode="json"),
        versions=dict(versions or software_versions()),
        references=list(outcome.references),
        summary=outcome.summary,
        artifacts=[
            Artifact(name=a.name, media_type=a.media_type, bytes=(folder / a.name).stat().st_size)
            for a in outcome.artifacts
        ],
    )
    (folder / RESULT_FILE).write_text(result.model_dump_json(indent=2) + "\n", encoding="utf-8")
    (folder / REFERENCES_FILE).write_text(bibtex_of(outcome.references), encoding="utf-8")
    return result


def _move_into_place(part: Path, target: Path) -> None:
    if not target.exists():
        part.replace(target)
        return
    aside = Path(tempfile.mkdtemp(prefix=f".{target.name}.old-", dir=target.parent))
    target.replace(aside)
    try:
        part.replace(target)
    except OSError:
        aside.replace(target)
        raise
    shutil.rmtree(aside, ignore_errors=True)


def _read_umask() -> int:
    # The mask can only be read by setting it; the command line is single-threaded here.
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def cannot_write(target: Path, error: OSError, option: str = "--out") -> InvalidInput:
    """Error for a path that cannot be written (``output-not-writable``)."""
    reason = error.strerror or type(error).__name__
    return InvalidInput("output-not-writable", f"Cannot write to {target}: {reason}.", [Fault(option, reason)])
