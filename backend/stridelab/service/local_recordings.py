"""Recordings of this machine as tasks of jobs, for commands and for the library.

Files are copied into a folder as the worker stages stored recordings, and recordings of one day share what the
recordings of a session share in the service.
"""

import contextlib
import hashlib
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.pipelines.session_values import TrialFacts, share_session
from stridelab.recordings.files.trial_pairs import copy_recording
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.measures import GaitReportInput, GaitReportTask, MeasuresMember, ReferencePerson
from stridelab.schemas.recordings import SubjectFields
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.local_runs import collect_recordings, validate_options


@dataclass(frozen=True)
class ReportWalks:
    """Recordings of the person, of each person of the reference group, and of the person before."""

    person: Sequence[Path]
    people: Sequence[Sequence[Path]]
    before: Sequence[Path]

    def refuse_shared_files(self) -> None:
        """Raise ``InvalidInput`` (``recording-twice``) for a file of two people, or from both before and after.

        The service refuses the same recording in two groups. Files that cannot be read are passed over: measuring them
        states the reason.
        """
        groups = [("the recordings", self.person)]
        groups += [("the recordings from before", self.before)] if self.before else []
        groups += [(f"person {number} of the reference group", one) for number, one in enumerate(self.people, start=1)]
        first: dict[str, tuple[str, Path]] = {}
        for group, paths in groups:
            own: dict[str, tuple[str, Path]] = {}
            for path in paths:
                try:
                    digest = _file_sha256(path)
                except OSError:
                    continue
                if digest in first:
                    where, other = first[digest]
                    message = f"{path} of {group} is the same file as {other} of {where}: a recording counts once."
                    raise InvalidInput("recording-twice", message, [Fault(str(path), f"the same as {other}")])
                own[digest] = (group, path)
            first |= own


def people_in(folder: Path) -> list[list[Path]]:
    """Recordings of a reference group by person: each subfolder of ``folder``, and each file directly in it.

    Raises ``InvalidInput`` (``no-recordings``) without any.
    """
    people: dict[Path, list[Path]] = {}
    for path in collect_recordings([folder]):
        people.setdefault(folder / path.relative_to(folder).parts[0] if folder.is_dir() else path, []).append(path)
    return list(people.values())


def stage_walks(
    paths: Sequence[Path], folder: Path, subject: SubjectFields, method: str | None, static: Path | None = None
) -> list[MeasuresMember]:
    """Copy each recording and the static trial of its person into a new subfolder of ``folder``.

    A file that cannot be copied is left out: reading it then states the reason, as for any other recording. Equal names
    of files are shown behind those of their folders.
    """
    members = []
    names = [path.name for path in paths]
    for path in paths:
        shown = path.name if names.count(path.name) == 1 else f"{path.absolute().parent.name}-{path.name}"
        name = f"recording-{len(list(folder.glob('recording-*'))):03d}"
        (folder / name).mkdir()
        with contextlib.suppress(OSError):
            copy_recording(path, folder / name / "trial")
        source = RecordingSource(file="trial", filename=shown, subject=subject)
        static_source = None
        if static is not None:
            shutil.copyfile(static, folder / name / "static-trial")
            static_source = RecordingSource(file="static-trial", filename=static.name)
        one = validate_options(EstimateComInput, {"recording_id": name, "method": method})
        task = EstimateComTask(recording=source, static=static_source, input=one)
        members.append(MeasuresMember(recording_id=name, folder=name, task=task))
    return members


def share_by_day(members: Sequence[MeasuresMember], folder: Path) -> list[MeasuresMember]:
    """Give staged recordings of one person the values and the static trial that those of one day share.

    ``folder`` has the sub-folders of ``members``. The service gives the same to the recordings of a session. A
    recording that cannot be read shares nothing: measuring it then states the reason.
    """
    if len(members) < 2:
        return list(members)
    trials: dict[str, TrialFacts] = {}
    for one in members:
        with contextlib.suppress(StridelabError):
            trials[one.recording_id] = trial_facts(one.recording_id, one.task.recording, folder / one.folder)
    staged = {one.recording_id: one for one in members}
    shared = []
    for one in members:
        own, task = trials.get(one.recording_id), one.task
        if own is not None:
            same_day = [other for other in trials.values() if other.facts.recorded_on == own.facts.recorded_on]
            others = [other for other in same_day if other is not own]
            day = str(own.facts.recorded_on or "session")
            share = share_session(day, own, others, static_stated=task.static is not None)
            static = task.static
            if share.static is not None:
                chosen = staged[share.static.recording_id]
                source = chosen.task.recording
                static = source.model_copy(update={"file": f"static-{source.file}"})
                shutil.copyfile(folder / chosen.folder / source.file, folder / one.folder / static.file)
            task = task.model_copy(update={"session": share.values, "static": static})
            one = one.model_copy(update={"session_id": day})
        shared.append(one.model_copy(update={"task": task}))
    return shared


def trial_facts(name: str, source: RecordingSource, folder: Path) -> TrialFacts:
    """What the trials of a session share of the recording ``source`` in ``folder``, under ``name``."""
    from stridelab.pipelines.trial import examine_trial
    from stridelab.service.kinds.parse_upload import recording_facts

    facts = recording_facts(examine_trial(source, folder))
    return TrialFacts(name, source.filename, _file_sha256(folder / source.file), facts)


def _file_sha256(path: Path) -> str:
    with path.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def report_task(
    walks: ReportWalks,
    subject: SubjectFields,
    fields: Mapping[str, Any],
    static: Path | None,
    folder: Path,
) -> GaitReportTask:
    """Task of ``gait-report`` with copies of all files in ``folder``; ``fields`` are title, method and language.

    Raises as ``ReportWalks.refuse_shared_files`` does.
    """
    from stridelab.service.kinds.gait_report.kind import stage_logo
    from stridelab.service.settings import current_settings

    walks.refuse_shared_files()
    method = fields["method"]
    people = [share_by_day(stage_walks(paths, folder, SubjectFields(), method), folder) for paths in walks.people]
    staged = stage_walks([*walks.person, *walks.before], folder, subject, method, static)
    members = share_by_day(staged, folder)
    groups = members[: len(walks.person)], members[len(walks.person) :]
    ids = [[one.recording_id for one in group] for group in groups]
    request = {
        **fields,
        "recording_ids": ids[0],
        "before_recording_ids": ids[1],
        "reference_recording_ids": [one.recording_id for person in people for one in person],
    }
    settings = current_settings()
    return GaitReportTask(
        members=groups[0],
        before=groups[1],
        reference=[ReferencePerson(members=person) for person in people],
        input=validate_options(GaitReportInput, request),
        created_on=date.today(),
        lab_name=settings.lab_name,
        logo=stage_logo(settings, folder),
    )
