"""Options of ``stridelab estimate`` and similar commands, validated and converted to a job's input."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from stridelab.cli.options import Estimation, Preparation, Walk
from stridelab.cli.results import validate_options
from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.marker_set_files import absent_landmarks, labels_by_form, read_marker_set
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.marker_sets import SourceMarkerSet
from stridelab.schemas.recordings import PlateSwitch, SubjectFields
from stridelab.schemas.tasks import RecordingSource

Input = TypeVar("Input", bound=EstimateComInput)


@dataclass(frozen=True)
class EstimateRequest:
    """Options of ``stridelab estimate``, ``compare``, ``fit-cycloid``, ``stream``; ``steps`` is for the wheel alone."""

    walk: Walk
    method: str | None = None
    estimation: Estimation = field(default_factory=Estimation)
    preparation: Preparation = field(default_factory=Preparation)
    steps: str | None = None

    @property
    def file(self) -> Path:
        """The recording."""
        return self.walk.file

    @property
    def static(self) -> Path | None:
        """The static trial of the same person, or None."""
        return self.preparation.static

    def subject_fields(self) -> SubjectFields:
        """Given data of the subject. Raises ``InvalidInput`` naming the invalid option."""
        stated = asdict(self.walk)
        del stated["file"]
        return validate_options(SubjectFields, stated)

    def to_input(self, recording_id: str, model: type[Input]) -> Input:
        """Input of a job on this recording. Raises ``InvalidInput`` naming the invalid option."""
        latency, cutoffs, window = self.estimation.latency, self.estimation.cutoffs, self.estimation.window
        fields = {
            "recording_id": recording_id,
            "method": self.method,
            "latency": latency if latency in {"report", "apply"} else parse_numbers("--latency", latency, 1)[0],
            "segment_table": self.estimation.segment_table,
            "cutoffs": cutoffs if cutoffs in {"auto", "thesis", "spectra"} else parse_numbers("--cutoffs", cutoffs, 2),
            "smoother": self._smoother_fields(),
            "window_s": None if window is None else parse_numbers("--window", window, 2),
        }
        if self.steps is not None:
            fields["steps"] = self.steps
        return validate_options(model, fields)

    def _smoother_fields(self) -> dict[str, Any] | None:
        """Options of the smoother, or None if none is given, which leaves the choice of the method open."""
        stated, learn = self.estimation.prior or (), not self.estimation.no_learn
        if not stated and learn and not self.estimation.segment_momentum:
            return None
        priors = {}
        for name, value in (parse_named_value("--prior", text) for text in stated):
            sizes = parse_numbers("--prior", value, value.count(",") + 1)
            priors[name] = sizes[0] if len(sizes) == 1 else sizes
        return {"priors": priors, "learn": learn, "segment_momentum": self.estimation.segment_momentum}

    def marker_map(self) -> dict[str, str]:
        """Marker label of each given landmark."""
        return dict(parse_named_value("--marker", text) for text in self.preparation.marker or ())

    def marker_map_for(self, labels: Sequence[str]) -> dict[str, str]:
        """Marker map of a recording with these labels: of ``--marker-set``, changed by ``--marker``.

        Raises ``InvalidInput`` (``marker-set-does-not-fit``) if the set requires landmarks without a label there.
        """
        stated, path = self.marker_map(), self.preparation.marker_set
        if path is None:
            return stated
        known = read_marker_set(path)
        mapped = known.matching_labels(labels_by_form(labels)) | stated
        if absent := absent_landmarks(known.required, mapped):
            message = f"The marker set {known.name} does not fit {self.file.name}: no label for {', '.join(absent)}."
            raise InvalidInput("marker-set-does-not-fit", message, [Fault("labels found", ", ".join(labels))])
        return mapped

    def marker_sets(self) -> list[SourceMarkerSet]:
        """The marker set of ``--marker-set``, or none. Raises as ``read_marker_set``."""
        if self.preparation.marker_set is None:
            return []
        known = read_marker_set(self.preparation.marker_set)
        return [SourceMarkerSet(name=known.name, landmarks=dict(known.labels), required=list(known.required))]

    def to_source(self, file: str, **fields: Any) -> RecordingSource:
        """Source of the recording, stored as ``file``; ``fields`` are further fields of the source."""
        own_sets = self.marker_sets()
        return RecordingSource(
            file=file,
            filename=self.file.name,
            marker_map=self.marker_map(),
            plates=self.plate_switches(),
            marker_sets=own_sets,
            shipped_sets=not own_sets,
            **fields,
        )

    def plate_switches(self) -> dict[int, PlateSwitch]:
        """Switches of the excluded plates, by plate index."""
        return {index: PlateSwitch(use=False) for index in self.preparation.without_plate or ()}


def parse_numbers(option: str, text: str, count: int) -> list[float]:
    """Parse ``count`` comma-separated numbers. Raises ``InvalidInput`` naming the option."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        wanted = "a number" if count == 1 else f"{count} numbers with a comma between them"
        raise InvalidInput("option-invalid", f"{option} takes {wanted}.", [Fault(option, f"got {text!r}")])
    return values


def parse_named_value(option: str, text: str) -> tuple[str, str]:
    """Parse ``NAME=VALUE``. Raises ``InvalidInput`` (``option-invalid``) naming the option."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise InvalidInput("option-invalid", f"{option} takes NAME=VALUE.", [Fault(option, f"got {text!r}")])
    return name.strip(), value.strip()
