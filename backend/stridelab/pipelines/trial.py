"""Reading of a stored file: recording, marker set, measured windows and body mass.

Shared by the parsing of uploads and the estimation, so that both use the same facts.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import Points
from stridelab.errors import Fault, StridelabError
from stridelab.recordings.body_mass import MassEstimate, best_mass, weigh
from stridelab.recordings.force_windows import find_windows
from stridelab.recordings.marker_sets import MarkerSetMatch, identify
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import PlateSwitches, Recording, Remark, Subject, Window
from stridelab.recordings.vertical_motion import VerticalMotion, vertical_motion
from stridelab.schemas.recordings import PlateSwitch, SubjectFields
from stridelab.schemas.tasks import RecordingSource


@dataclass(frozen=True)
class Trial:
    """A recording with all facts that follow from the file and its plate switches.

    ``masses`` are the masses estimated from the force, at most one of each kind. ``motion`` and ``stated_kg`` (the
    user's mass, else the file's) are the inputs of the window search.
    """

    recording: Recording
    match: MarkerSetMatch
    windows: tuple[Window, ...]
    masses: tuple[MassEstimate, ...]
    remarks: tuple[Remark, ...]
    motion: VerticalMotion | None = None
    stated_kg: float | None = None

    @property
    def force_mass(self) -> MassEstimate | None:
        """The most accurate mass estimate from the force."""
        return best_mass(self.masses)

    @property
    def force_mass_kg(self) -> float | None:
        """Value of ``force_mass`` in kilograms."""
        return None if self.force_mass is None else self.force_mass.mass_kg


def read_source(source: RecordingSource, folder: Path) -> Recording:
    """Read the file of a source with the user's marker map and plate switches.

    Raises ``UnreadableFile`` or ``InvalidInput``; messages name the uploaded file, not its copy in ``folder``. The map
    may also contain labels of the static trial (``source.static_labels``).
    """
    static_labels = frozenset(source.static_labels)
    own = {landmark: label for landmark, label in source.marker_map.items() if label not in static_labels}
    try:
        path, plates = folder / source.file, reader_switches(source.plates)
        return read_recording(path, name=source.filename, marker_map=own, plate_switches=plates)
    except StridelabError as error:
        raise _with_uploaded_name(error, source.file, source.filename) from error


def examine_trial(source: RecordingSource, folder: Path) -> Trial:
    """Read a source; identify its marker set, measured windows and the masses estimated from the force."""
    recording = read_source(source, folder)
    match = identify(tuple(recording.markers_m), map_of_present_labels(source.marker_map, recording))
    motion = vertical_motion(recording, match.landmarks, _markers_com_m(recording, match))
    stated_kg = source.subject.mass_kg or recording.subject.mass_kg
    search = find_windows(recording, match.landmarks, motion, stated_kg=stated_kg)
    remarks = (*recording.remarks, *match.degraded, *search.remarks)
    masses = weigh(recording, search.windows, motion)
    return Trial(recording, match, search.windows, masses, remarks, motion, stated_kg)


def _markers_com_m(recording: Recording, match: MarkerSetMatch) -> Points | None:
    """Geometric CoM, shape (n, 3), used for its velocity; None if the segments cannot be placed."""
    if match.name is None or not recording.plates or recording.n_frames < 2:
        return None
    try:
        return SegmentModel().com(recording, match.landmarks, subject=recording.subject).com_m
    except StridelabError:
        return None


def map_of_present_labels(marker_map: Mapping[str, str], recording: Recording) -> dict[str, str]:
    """The entries of a map (landmark to label) whose label is in the recording."""
    return {landmark: label for landmark, label in marker_map.items() if label in recording.markers_m}


def reader_switches(plates: Mapping[int, PlateSwitch]) -> dict[int, PlateSwitches]:
    """Convert plate switches from the request schema to those of the reader."""
    return {index: PlateSwitches(**switch.model_dump(exclude_none=True)) for index, switch in plates.items()}


def subject_fields(subject: Subject) -> SubjectFields:
    """Convert the subject of a file to the response schema; implausible values were removed by the reader."""
    return SubjectFields(
        height_m=subject.height_m, mass_kg=subject.mass_kg, sex=subject.sex, age_years=subject.age_years
    )


def _with_uploaded_name(error: StridelabError, stored: str, uploaded: str) -> StridelabError:
    faults = [Fault(uploaded if fault.where == stored else fault.where, fault.message) for fault in error.faults]
    return type(error)(error.code, error.message, faults)
