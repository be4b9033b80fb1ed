"""``sl.read``, ``sl.estimate_com`` and ``sl.fit_cycloid``: recordings of human gait.

Three lines give the first result::

    import stridelab as sl

    com = sl.estimate_com("walk.c3d", mass_kg=60.0)
    print(com.summary.window_s, com.sd_m.max())

Each function calls the same pipeline as the job of the service and the command line.
"""

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Series
from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.library.job_files import write_job_files
from stridelab.library.options import Progress, data_frame, ignore_progress, validate_fields
from stridelab.pipelines.estimate_com import ComResult
from stridelab.pipelines.estimate_com import estimate_com as _estimate_com
from stridelab.pipelines.fit_cycloid import CycloidResult, fit_cycloid_of_recording
from stridelab.pipelines.trial import read_source as _read
from stridelab.recordings.recording import Recording
from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidSummary, FitCycloidTask
from stridelab.schemas.jobs import EstimateComInput, EstimateComSummary
from stridelab.schemas.recordings import SubjectFields
from stridelab.schemas.tasks import EstimateComTask, RecordingSource

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from stridelab.service.kinds.base import ArtifactFile

AXES = "xyz"


@dataclass(frozen=True)
class LoadedRecording:
    """A recording that has been read, and the given data about it.

    ``recording`` holds markers (metres, z up), plates and events; ``subject`` and ``marker_map`` are used by
    ``estimate_com`` and ``fit_cycloid``. ``static`` is the path of a static trial of the same person.
    """

    path: Path
    recording: Recording
    subject: SubjectFields = field(default_factory=SubjectFields)
    marker_map: Mapping[str, str] = field(default_factory=dict)
    static: Path | None = None

    @property
    def source(self) -> RecordingSource:
        """Source of the file for the pipelines."""
        return RecordingSource(
            file=self.path.name, filename=self.path.name, subject=self.subject, marker_map=dict(self.marker_map)
        )


def read(
    path: str | Path,
    *,
    height_m: float | None = None,
    mass_kg: float | None = None,
    sex: Literal["female", "male"] | None = None,
    age_years: float | None = None,
    marker_map: Mapping[str, str] | None = None,
    static: str | Path | None = None,
) -> LoadedRecording:
    """Read a gait recording: a C3D, TRC, MVNX, Qualisys TSV or Vicon Nexus CSV file, or a zip of one trial.

    Args:
        path: The file.
        height_m: Height of the person; given values take precedence over those in the file.
        mass_kg: Body mass.
        sex: "female" or "male".
        age_years: Age.
        marker_map: Landmark to marker label, for marker sets that are not recognised.
        static: A static trial of the same person.

    Raises:
        UnreadableFile: The file is damaged or of an unknown format; the error names the file and the place.
        InvalidInput: A given value is invalid.
    """
    path = Path(path)
    _require_file(path)
    if static is not None:
        _require_file(Path(static))
    stated = {"height_m": height_m, "mass_kg": mass_kg, "sex": sex, "age_years": age_years}
    subject = validate_fields(SubjectFields, stated)
    source = RecordingSource(file=path.name, filename=path.name, subject=subject, marker_map=dict(marker_map or {}))
    recording = _read(source, path.parent)
    return LoadedRecording(path, recording, subject, dict(marker_map or {}), None if static is None else Path(static))


@dataclass(frozen=True)
class CentreOfMass:
    """The centre of mass of a recording, from ``estimate_com``.

    ``summary`` is that of the job ``estimate-com``: window, method, masses, latency, ``quality`` and remarks.
    """

    loaded: LoadedRecording
    request: EstimateComInput
    result: ComResult

    @property
    def summary(self) -> EstimateComSummary:
        """The summary of the result."""
        return self.result.summary

    @property
    def time_s(self) -> Series:
        """Instants of the window, shape (n,)."""
        return self.result.estimate.time_s

    @property
    def com_m(self) -> Points:
        """Position in the world frame, z up, shape (n, 3)."""
        return self.result.estimate.com_m

    @property
    def velocity_m_s(self) -> Points:
        """Velocity, shape (n, 3)."""
        return self.result.estimate.velocity_m_s

    @property
    def sd_m(self) -> Points:
        """Standard deviation of the position, shape (n, 3)."""
        return self.result.estimate.sd_m

    def to_dataframe(self) -> Any:
        """The track as a data frame of pandas, or of polars if pandas is not installed.

        Raises:
            Unavailable: ``dataframe-unavailable`` where neither is installed.
        """
        columns: dict[str, Float[np.ndarray, " n"]] = {"time_s": self.time_s}
        for name, track in (("{}_m", self.com_m), ("v{}_m_s", self.velocity_m_s), ("sd_{}_m", self.sd_m)):
            columns |= {name.format(axis): track[:, k] for k, axis in enumerate(AXES)}
        return data_frame(columns)

    def plot(self) -> "go.Figure":
        """The position over time with its 95 % band, one panel per axis."""
        from plotly.subplots import make_subplots

        figure = make_subplots(rows=3, cols=1, shared_xaxes=True)
        for k, axis in enumerate(AXES):
            middle_m, half_m = self.com_m[:, k], 1.96 * self.sd_m[:, k]
            band = np.concatenate([middle_m + half_m, (middle_m - half_m)[::-1]])
            outline_s = np.concatenate([self.time_s, self.time_s[::-1]])
            filled = {"fill": "toself", "line": {"width": 0}, "opacity": 0.3, "hoverinfo": "skip"}
            figure.add_scatter(x=outline_s, y=band, name=f"{axis}, 95 %", row=k + 1, col=1, **filled)
            figure.add_scatter(x=self.time_s, y=middle_m, name=axis, row=k + 1, col=1)
            figure.update_yaxes(title_text=f"{axis} (m)", row=k + 1, col=1)
        figure.update_xaxes(title_text="time (s)", row=3, col=1)
        return figure

    def save(self, folder: str | Path, *, replace: bool = False) -> Path:
        """Write the files of the job into a folder: ``com.csv``, ``com.parquet``, ``com.c3d``, ``result.json``.

        Raises:
            Conflict: ``output-exists`` where the folder exists; ``replace`` allows it for an earlier result.
        """
        from stridelab.service.kinds.estimate_com.run import write_com_result

        def write(made: Path) -> "tuple[ArtifactFile, ...]":
            copy = made / self.loaded.path.name
            shutil.copyfile(self.loaded.path, copy)
            artifacts = write_com_result(made, self.loaded.source, self.result)
            copy.unlink()
            return artifacts

        keys = self.result.citation_keys
        return write_job_files(folder, "estimate-com", self.request, self.summary, keys, write, replace=replace)


def estimate_com(
    recording: LoadedRecording | str | Path,
    *,
    method: str | None = None,
    latency: Literal["report", "apply"] | float = "apply",
    segment_table: str = "auto",
    cutoffs: Literal["auto", "thesis", "spectra"] | tuple[float, float] = "auto",
    window_s: tuple[float, float] | None = None,
    progress: Progress | None = None,
    **stated: Any,
) -> CentreOfMass:
    """Estimate the centre of mass of a recording (chapter 2 of the thesis).

    Args:
        recording: Result of ``read``, or a path; ``stated`` are then options of ``read``, such as ``mass_kg``.
        method: An estimator by name; None takes the best one.
        latency: "apply" corrects the delay of the force, "report" only estimates it; a number is a delay in seconds.
        segment_table: "auto" or a table of segment masses by name.
        cutoffs: Cut-off frequencies of the complementary filter, Hz, or how they are chosen.
        window_s: Begin and end of the interval to estimate, seconds; None takes the whole measured interval.
        progress: Called with a fraction from 0 to 1 and a message.

    Returns:
        The track with its standard deviation; look at ``summary.quality`` before the numbers.

    Raises:
        InvalidInput: An option is invalid; the error names it.
        NotEstimable: The data do not allow an estimate; code and message say what is missing.
    """
    loaded = load_recording(recording, stated)
    fields = {"method": method, "latency": latency, "segment_table": segment_table, "cutoffs": cutoffs}
    request = validate_fields(EstimateComInput, {"recording_id": loaded.path.name, "window_s": window_s, **fields})
    with staged_sources(loaded) as (folder, recorded, static):
        task = EstimateComTask(recording=recorded, static=static, input=request)
        return CentreOfMass(loaded, request, _estimate_com(task, folder, progress or ignore_progress))


@dataclass(frozen=True)
class CycloidFit:
    """The rolling wheel of every step of a recording, from ``fit_cycloid``."""

    loaded: LoadedRecording
    request: FitCycloidInput
    result: CycloidResult

    @property
    def summary(self) -> FitCycloidSummary:
        """The summary of the job ``fit-cycloid``; ``summary.steps`` has one entry per fitted step."""
        return self.result.summary

    def to_dataframe(self) -> Any:
        """One row per step: radius, tracing point, hub height, angular speed, errors, timing.

        Raises:
            Unavailable: ``dataframe-unavailable`` where neither pandas nor polars is installed.
        """
        from stridelab.service.kinds.fit_cycloid.files import step_columns

        return data_frame(step_columns(self.summary))

    def plot(self) -> "go.Figure":
        """Measured and modelled path of every step in the sagittal plane."""
        import plotly.graph_objects as go

        figure = go.Figure()
        for fit in self.result.fits:
            model = fit.path.wheel.position_m(fit.path.theta_rad)
            name = f"{fit.step.side} {fit.step.start_s:.2f} s"
            figure.add_scatter(x=fit.path_m[:, 0], y=fit.path_m[:, 1], mode="markers", name=name)
            figure.add_scatter(x=model[:, 0], y=model[:, 1], mode="lines", name=f"{name}, cycloid")
        figure.update_xaxes(title_text="ahead (m)")
        figure.update_yaxes(title_text="height (m)", scaleanchor="x")
        return figure

    def save(self, folder: str | Path, *, replace: bool = False) -> Path:
        """Write the files of the job into a folder: ``steps`` and ``wheel`` as CSV and Parquet, ``result.json``.

        Raises:
            Conflict: ``output-exists`` where the folder exists; ``replace`` allows it for an earlier result.
        """
        from stridelab.service.kinds.fit_cycloid.files import write_cycloid

        write = partial(write_cycloid, source=self.loaded.source, result=self.result)
        keys = self.result.citation_keys
        return write_job_files(folder, "fit-cycloid", self.request, self.summary, keys, write, replace=replace)


def fit_cycloid(
    recording: LoadedRecording | str | Path,
    *,
    steps: Literal["measured", "all"] = "measured",
    method: str | None = None,
    progress: Progress | None = None,
    **stated: Any,
) -> CycloidFit:
    """Fit the rolling wheel (curtate cycloid) to every step of a walk (chapter 3 of the thesis).

    Args:
        recording: Result of ``read``, or a path; ``stated`` are then options of ``read``.
        steps: "measured" fits steps with all force on plates, "all" also those known from the markers alone.
        method: An estimator of the centre of mass by name; None takes the best one.
        progress: Called with a fraction from 0 to 1 and a message.

    Raises:
        NotEstimable: The recording is not a walk, or no step is measured; code and message say what is missing.
    """
    loaded = load_recording(recording, stated)
    request = validate_fields(FitCycloidInput, {"recording_id": loaded.path.name, "steps": steps, "method": method})
    with staged_sources(loaded) as (folder, recorded, static):
        task = FitCycloidTask(recording=recorded, static=static, input=request)
        return CycloidFit(loaded, request, fit_cycloid_of_recording(task, folder, progress or ignore_progress))


def load_recording(recording: LoadedRecording | str | Path, stated: dict[str, Any]) -> LoadedRecording:
    """The recording itself, or the one read from a path with the options ``stated`` of ``read``."""
    if not isinstance(recording, LoadedRecording):
        return read(recording, **stated)
    if stated:
        names = ", ".join(stated)
        raise InvalidInput("option-invalid", f"Pass {names} to read(), which reads the recording.")
    return recording


@contextmanager
def staged_sources(loaded: LoadedRecording) -> Iterator[tuple[Path, RecordingSource, RecordingSource | None]]:
    """Folder and sources of the recording; a static trial from another folder is copied to a common one."""
    if loaded.static is None or loaded.static.parent == loaded.path.parent:
        static = None if loaded.static is None else _source_of_file(loaded.static)
        yield loaded.path.parent, loaded.source, static
        return
    with tempfile.TemporaryDirectory(prefix="stridelab-") as name:
        folder = Path(name)
        shutil.copyfile(loaded.path, folder / loaded.path.name)
        copy = folder / f"static-{loaded.static.name}"
        shutil.copyfile(loaded.static, copy)
        yield folder, loaded.source, RecordingSource(file=copy.name, filename=loaded.static.name)


def _source_of_file(path: Path) -> RecordingSource:
    return RecordingSource(file=path.name, filename=path.name)


def _require_file(path: Path) -> None:
    if not path.is_file():
        raise UnreadableFile("file-not-readable", f"There is no file {path}.", [Fault(str(path), "not a file")])
