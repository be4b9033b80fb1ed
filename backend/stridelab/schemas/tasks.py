"""Tasks on one recording that a worker passes to a child process: JSON, with all files in the folder of the task.

The tasks of the other jobs stand beside their inputs.
"""

from pydantic import Field

from stridelab.schemas.base import Contract
from stridelab.schemas.jobs import EstimateComInput, SimulateRecordingInput
from stridelab.schemas.marker_sets import SourceMarkerSet
from stridelab.schemas.recordings import PlateSwitch, SubjectFields
from stridelab.schemas.sessions import SessionValues


class RecordingSource(Contract):
    """File of a recording and its user settings; ``filename`` is the uploaded name, used in messages only."""

    file: str = Field(description="file name inside the task's folder")
    filename: str
    subject: SubjectFields = SubjectFields()
    marker_map: dict[str, str] = Field(default_factory=dict)
    plates: dict[int, PlateSwitch] = Field(default_factory=dict)
    static_labels: list[str] = Field(
        default_factory=list, description="labels of its static trial, to which the marker map may refer"
    )
    marker_sets: list[SourceMarkerSet] = Field(default_factory=list, description="sets of users, preferred ones first")
    shipped_sets: bool = Field(default=True, description="false: only `marker_sets` are considered")


class ParseUploadTask(Contract):
    """Task of ``parse_upload``."""

    recording: RecordingSource


class BatchFile(Contract):
    """One uploaded file of a form."""

    file: str = Field(description="file name inside the task's folder")
    filename: str


class ParseBatchTask(Contract):
    """Task of ``parse_batch``; ``table`` is the file of the uploaded subject table."""

    files: list[BatchFile]
    marker_sets: list[SourceMarkerSet] = Field(default_factory=list)
    table: str | None = None
    file_bytes: int
    total_bytes: int
    timeout_s: float
    memory_mb: int


class EstimateComTask(Contract):
    """Task of ``estimate-com``."""

    recording: RecordingSource
    static: RecordingSource | None = None
    session: SessionValues | None = Field(default=None, description="values of the recording's session")
    input: EstimateComInput


class SimulateRecordingTask(Contract):
    """Task of ``simulate-recording``."""

    input: SimulateRecordingInput
