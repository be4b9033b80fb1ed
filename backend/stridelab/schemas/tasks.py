"""Tasks on recordings that a worker passes to a child process: JSON, with all files in the folder of the task.

The tasks of the robot jobs stand beside their inputs.
"""

from datetime import date

from pydantic import Field

from stridelab.schemas.base import Contract
from stridelab.schemas.comparison import CompareEstimatorsInput
from stridelab.schemas.cycloid import FitCycloidInput
from stridelab.schemas.marker_sets import SourceMarkerSet
from stridelab.schemas.measures import GaitReportInput
from stridelab.schemas.population import PersonFields
from stridelab.schemas.recording_tasks import EstimateComTask


class CompareEstimatorsTask(EstimateComTask):
    """Task of ``compare-estimators``; ``truth`` is the file with the true motion, if it is known."""

    input: CompareEstimatorsInput
    truth: str | None = Field(default=None, description="file name inside the task's folder")


class FitCycloidTask(EstimateComTask):
    """Task of ``fit-cycloid``."""

    input: FitCycloidInput


class PopulationMember(Contract):
    """One recording of a population: its task, and the fields of the subject table."""

    recording_id: str
    folder: str = Field(description="folder inside the task's folder that holds its files")
    task: FitCycloidTask
    person: PersonFields = PersonFields()


class StudyPopulationTask(Contract):
    """Task of ``study-population``."""

    members: list[PopulationMember]
    pooled: bool = False
    seed: int = 0


class MeasuresMember(Contract):
    """One recording of ``gait-measures``: its task and the sub-folder that holds its files."""

    recording_id: str
    folder: str
    task: EstimateComTask


class BenchMember(MeasuresMember):
    """One recording of ``com-bench``; ``subject`` is a pseudonym, null if it is not stated."""

    subject: str | None = None


class ComBenchTask(Contract):
    """Task of ``com-bench``."""

    members: list[BenchMember]
    seed: int = 0


class GaitMeasuresTask(Contract):
    """Task of ``gait-measures``."""

    members: list[MeasuresMember]


class ReferencePerson(Contract):
    """All recordings of one person of the reference group of ``gait-report``."""

    members: list[MeasuresMember]


class GaitReportTask(GaitMeasuresTask):
    """Task of ``gait-report``; ``members`` are the recordings of the person, ``before`` the earlier ones."""

    input: GaitReportInput
    before: list[MeasuresMember] = Field(default_factory=list)
    reference: list[ReferencePerson] = Field(default_factory=list)
    created_on: date = Field(description="the only date in the report beside those of the recordings")
    lab_name: str = ""
    logo: str | None = Field(default=None, description="file name inside the task's folder")


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
