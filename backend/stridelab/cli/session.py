"""``stridelab estimate`` with several recordings, or folders of them: trials of a session share its clock and mass.

Every recording is read once for the values of its session; then each is estimated with these values into its own
result folder. Static trials are estimated only if there are no other recordings.
"""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.markup import escape

from stridelab.cli.estimate import estimate_here, show_estimate
from stridelab.cli.options import Delivery, EstimateRequest
from stridelab.cli.results import Bar, err, out, progress_bar
from stridelab.errors import Fault, InvalidInput, NotEstimable, StridelabError
from stridelab.pipelines.session_values import TrialFacts, share_session
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.recordings import RecordingFacts
from stridelab.schemas.sessions import SessionValues
from stridelab.service.local_recordings import trial_facts
from stridelab.service.local_runs import collect_recordings, refuse_to_overwrite, result_folder


@dataclass(frozen=True)
class Member:
    """A recording that was read; ``name`` is unique among the recordings."""

    path: Path
    name: str
    trial: TrialFacts

    @property
    def parent_folder(self) -> str:
        """Absolute path of the recording's folder."""
        return str(self.path.absolute().parent)


def estimate_session(requests: Sequence[EstimateRequest], delivery: Delivery) -> None:
    """Estimate every recording with the values of its session; each has a folder ``<name>-com`` below ``--out``.

    Raises ``InvalidInput`` (``option-invalid`` with ``--server``), ``Conflict`` where a folder exists, and
    ``NotEstimable`` (``nothing-estimated``) where no recording gives an estimate; single failures are printed.
    """
    if delivery.server is not None:
        message = (
            "Several recordings are estimated on this machine only; a service finds the trials of a session itself."
        )
        raise InvalidInput("option-invalid", message, [Fault("--server", "takes one recording")])
    if any(request.preparation.model or request.preparation.forces for request in requests):
        message = "The options --model and --forces belong to one recording; estimate one file at a time."
        raise InvalidInput("option-invalid", message, [Fault("--model", "takes one recording")])
    request_of = {request.file: request for request in requests}
    names = _result_names([request.file for request in requests])
    with progress_bar("reading the session") as bar:
        members, refused = _read_members(request_of, names, bar)
    estimated = [one for one in members if not one.trial.facts.still] or members
    place = delivery.out_dir or Path()
    targets = {one.name: place / f"{one.name}-com" for one in estimated}
    for target in targets.values():
        refuse_to_overwrite(target, force=delivery.force)
    stated = any(request.subject_fields().model_dump(exclude_none=True) for request in requests)
    sessions = sessions_of(members, one_person=stated)
    results: list[JobResult] = []
    for one in estimated:
        others = [other for other in members if other is not one and sessions[other.name] == sessions[one.name]]
        request, values = _with_session(request_of[one.path], one, others, sessions[one.name])
        try:
            with result_folder(targets[one.name], force=delivery.force) as folder:
                result = estimate_here(request, folder, session=values)
        except StridelabError as error:
            refused[one.name] = error
            continue
        results.append(result)
        if not delivery.as_json:
            out.print(f"[bold]{escape(one.name)}[/]")
            show_estimate(result, targets[one.name])
    for name, why in refused.items():
        err.print(f"[yellow]left out[/] {escape(name)}: {escape(why.message)} [dim]({escape(why.code)})[/]")
    if not results:
        faults = [Fault(name, f"{why.message} ({why.code})") for name, why in refused.items()]
        raise NotEstimable("nothing-estimated", "None of the recordings gives an estimate.", faults)
    if delivery.as_json:
        out.print_json(json.dumps([result.model_dump(mode="json") for result in results]))


def recordings_below(paths: Sequence[Path]) -> list[Path]:
    """Given files and the recordings in given folders, in order and without duplicates.

    Raises ``UnreadableFile`` for a path that does not exist, ``InvalidInput`` (``no-recordings``).
    """
    return list({file.absolute(): file for file in collect_recordings(paths)}.values())


def sessions_of(members: Sequence[Member], *, one_person: bool = False) -> dict[str, str]:
    """Session of each recording, by name: one subject, identified by height and mass, and one day.

    A recording without subject data belongs to the only subject of its folder, else to the only subject of all.
    With ``one_person`` all recordings have the same subject.
    """
    subject_of = {one.name: "" if one_person else _subject_key(one.trial.facts) for one in members}
    subjects = set(subject_of.values()) - {""}
    sessions = {}
    for one in members:
        folder_subjects = {subject_of[other.name] for other in members if other.parent_folder == one.parent_folder} - {
            ""
        }
        subject = subject_of[one.name]
        if not subject and len(subjects) > 1:
            subject = folder_subjects.pop() if len(folder_subjects) == 1 else one.parent_folder
        elif not subject:
            subject = "".join(subjects)
        sessions[one.name] = f"{subject} {one.trial.facts.recorded_on or ''}".strip() or "session"
    return sessions


def _subject_key(facts: RecordingFacts) -> str:
    stated = facts.subject.model_dump(exclude={"name"}, exclude_none=True)
    if "height_m" not in stated or "mass_kg" not in stated:
        return ""
    return " ".join(f"{name}={stated[name]}" for name in sorted(stated))


def _result_names(files: Sequence[Path]) -> dict[Path, str]:
    """Names of the results: file names, prefixed with the folder's name if two are equal."""
    stems = [file.stem for file in files]
    names = {
        file: file.stem if stems.count(file.stem) == 1 else f"{file.absolute().parent.name}-{file.stem}"
        for file in files
    }
    if len(set(names.values())) < len(files):
        names = {file: f"{index:03d}-{file.stem}" for index, file in enumerate(files)}
    return names


def _read_members(
    request_of: Mapping[Path, EstimateRequest], names: Mapping[Path, str], bar: Bar
) -> tuple[list[Member], dict[str, StridelabError]]:
    members: list[Member] = []
    refused: dict[str, StridelabError] = {}
    for count, (path, request) in enumerate(request_of.items()):
        bar(count / len(request_of), path.name)
        source = request.to_source("trial", static_labels=list(request.marker_map().values()))
        try:
            with tempfile.TemporaryDirectory(prefix="stridelab-") as work:
                request.write_upload(Path(work, "trial"))
                trial = trial_facts(names[path], source, Path(work))
        except StridelabError as error:
            refused[names[path]] = error
            continue
        members.append(Member(path, names[path], trial))
    return members, refused


def _with_session(
    request: EstimateRequest, one: Member, others: Sequence[Member], session_id: str
) -> tuple[EstimateRequest, SessionValues | None]:
    """The request, with the session's static trial if it has none, and the values of the session."""
    share = share_session(
        session_id, one.trial, [other.trial for other in others], static_stated=request.static is not None
    )
    if share.static is None:
        return request, share.values
    path = next(other.path for other in others if other.name == share.static.recording_id)
    return replace(request, preparation=replace(request.preparation, static=path)), share.values
