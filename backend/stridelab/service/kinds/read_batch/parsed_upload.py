"""A parsed bulk upload: its recordings with their subjects, and the files that were refused."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stridelab.errors import Fault, UnreadableFile
from stridelab.schemas.population import PersonFields, ReadBatchSummary, RefusedFile, SubjectOfRecording
from stridelab.schemas.recordings import RecordingFacts, SubjectFields
from stridelab.service.filenames import safe_filename


@dataclass(frozen=True)
class ParsedFile:
    """A readable recording of the upload: its index among the files, its facts, and its subject."""

    index: int
    file: str
    filename: str
    tracks: str
    facts: RecordingFacts
    person: PersonFields

    @property
    def stated_subject(self) -> SubjectFields:
        """The subject's fields in the subject table."""
        return SubjectFields(name=self.person.subject, **self.person.model_dump(exclude={"subject", "group"}))


@dataclass(frozen=True)
class ParsedUpload:
    """A parsed bulk upload; ``people`` and ``statics`` map a file's index to its subject and static trial's index."""

    files: tuple[ParsedFile, ...]
    refused_files: tuple[RefusedFile, ...]
    people: Mapping[int, PersonFields]
    statics: Mapping[int, int | None]

    @staticmethod
    def from_parse_result(parse_result: Mapping[str, Any]) -> "ParsedUpload":
        """From the result of ``run.parse_batch``. Raises ``UnreadableFile`` (``nothing-readable``)."""
        people = {row["place"]: PersonFields.model_validate(row["person"]) for row in parse_result["rows"]}
        files, refused = [], []
        for place, one in enumerate(parse_result["files"]):
            name = safe_filename(one["name"])
            if "problem" in one:
                refused.append(RefusedFile(filename=name, **one["problem"]))
                continue
            facts = RecordingFacts.model_validate(one["facts"])
            person = people.get(place, PersonFields())
            files.append(ParsedFile(place, one["file"], name, one["tracks"], facts, person))
        if not files:
            faults = [Fault(one.filename, f"{one.message} ({one.code})") for one in refused]
            raise UnreadableFile("nothing-readable", "None of the files is a readable recording.", faults)
        return ParsedUpload(
            tuple(files), tuple(refused), people, {row["place"]: row["static"] for row in parse_result["rows"]}
        )

    def static_trial_ids(self, ids: Mapping[int, str]) -> dict[str, str]:
        """Ids of static trials by recording id, for those among ``ids`` (by index)."""
        return {
            ids[place]: ids[static]
            for place, static in self.statics.items()
            if static is not None and place in ids and static in ids
        }

    def batch_summary(self, ids: Mapping[int, str]) -> ReadBatchSummary:
        """Summary of the upload for the user, with recording ``ids`` (by index)."""
        standing = set(self.statics.values()) - set(self.statics)
        subjects = [
            SubjectOfRecording(recording_id=ids[place], **person.model_dump())
            for place, person in self.people.items()
            if place in ids
        ]
        studied = [recording_id for place, recording_id in ids.items() if place not in standing]
        return ReadBatchSummary(
            recording_ids=list(ids.values()), studied=studied, subjects=subjects, refused=list(self.refused_files)
        )
