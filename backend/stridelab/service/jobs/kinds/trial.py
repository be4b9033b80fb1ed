"""From a stored file to a trial that can be worked on: read, marker set, windows, weight.

Shared by the parsing of uploads and by the estimation, so that both see the same facts.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from stridelab.errors import Fault, StridelabError
from stridelab.recordings.marker_sets import MarkerSetMatch, identify
from stridelab.recordings.mass import mass_from_force_kg
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import PlateSwitches, Recording, Remark, Subject, Window
from stridelab.recordings.windows import find_windows
from stridelab.schemas.recordings import PlateSwitch, SubjectFields
from stridelab.service.jobs.kinds.tasks import RecordingSource


@dataclass(frozen=True)
class Trial:
    """A recording with everything that follows from the file and its switches alone; ``remarks`` are all of it."""

    recording: Recording
    match: MarkerSetMatch
    windows: tuple[Window, ...]
    force_mass_kg: float | None
    remarks: tuple[Remark, ...]


def read(source: RecordingSource, folder: Path) -> Recording:
    """Read the file of a source with the user's marker map and plate switches.

    Raises ``UnreadableFile`` or ``InvalidInput``; messages name the uploaded file, not its copy in ``folder``.
    """
    try:
        return read_recording(
            folder / source.file, marker_map=source.marker_map, plate_switches=switches(source.plates)
        )
    except StridelabError as error:
        raise _renamed(error, source.file, source.filename) from error


def examine(source: RecordingSource, folder: Path) -> Trial:
    """Read a source and find its marker set, its measured windows and the mass that the force shows."""
    recording = read(source, folder)
    match = identify(tuple(recording.markers_m), source.marker_map)
    found = find_windows(recording, match.landmarks)
    remarks = (*recording.remarks, *match.degraded, *found.remarks)
    return Trial(recording, match, found.windows, mass_from_force_kg(recording, found.windows), remarks)


def switches(plates: Mapping[int, PlateSwitch]) -> dict[int, PlateSwitches]:
    """Plate switches of the contract as those of the reader."""
    return {index: PlateSwitches(**switch.model_dump(exclude_none=True)) for index, switch in plates.items()}


def subject_fields(subject: Subject) -> SubjectFields:
    """What a file says of the person, as in the contract; the reader has dropped what cannot be true."""
    return SubjectFields(
        height_m=subject.height_m, mass_kg=subject.mass_kg, sex=subject.sex, age_years=subject.age_years
    )


def _renamed(error: StridelabError, stored: str, uploaded: str) -> StridelabError:
    faults = [
        Fault(uploaded if f.where == stored else f.where, f.message.replace(stored, uploaded)) for f in error.faults
    ]
    return type(error)(error.code, error.message.replace(stored, uploaded), faults)
