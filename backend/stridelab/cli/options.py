"""Options that several commands share, groups of them, and the request of ``stridelab estimate`` made of them."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import cached_property
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_type_hints

import typer

from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.files.trial_pairs import TRC, forces_beside, pack_trial
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.marker_sets import SourceMarkerSet
from stridelab.schemas.methods import NODE_RATE_HZ, Formulation, Method
from stridelab.schemas.recordings import PlateSwitch, Sex, SubjectFields
from stridelab.schemas.tasks import RecordingSource
from stridelab.service.local_runs import validate_options

Lab = Literal["walkway", "two_plates"]
Gait = Literal["walking", "running"]
PostureMeasure = Literal["uniform", "conditioned"]
PlanSolver = Literal["auto", "native", "casadi", "ipopt", "fatrop"]
OnlineMethod = Literal["complementary", "smoother"]
SegmentTable = Literal["auto", "dumas2007", "deleva1996", "carried"]

ControlOption = Annotated[
    Formulation,
    typer.Option("--formulation", help="Control variables: contact forces, forces in circular cones, or the wrench."),
]
SolverOption = Annotated[PlanSolver, typer.Option("--solver", help="auto: the C++ solver if available, else CasADi's.")]
NodeRate = Annotated[
    float, typer.Option("--node-rate", min=NODE_RATE_HZ[0], max=NODE_RATE_HZ[1], help="Nodes per second.")
]
Densities = Annotated[
    PostureMeasure | None, typer.Option("--measure", help="Bundled reachability densities to plan with.")
]

ScenarioName = Annotated[str, typer.Argument(help="A scenario's JSON file, or the name of a bundled one: six-stairs.")]
Trial = Annotated[Path, typer.Argument(help="A .c3d, .trc, .tsv, .csv, .mvnx file, or a .zip of a trial.")]
Trials = Annotated[
    list[Path],
    typer.Argument(
        help="A .c3d, .trc, .tsv, .csv, .mvnx file, or a .zip of a trial; or several, or folders: trials of one person "
        "and day are a session."
    ),
]
Height = Annotated[float | None, typer.Option("--height", help="Stature in metres.")]
Mass = Annotated[float | None, typer.Option("--mass", help="Body mass in kilograms.")]
PersonSex = Annotated[Sex | None, typer.Option("--sex", help="Sex; selects columns of the segment table.")]
Age = Annotated[float | None, typer.Option("--age", help="Age in years.")]
BestMethod = Annotated[Method | None, typer.Option("--method", help="Estimator; by default the best available.")]
StepChoice = Annotated[
    Literal["measured", "all"], typer.Option("--steps", help="Steps with all force measured, or all.")
]
Latency = Annotated[str, typer.Option("--latency", help="apply (where significant), report, or seconds to apply.")]
Segments = Annotated[SegmentTable, typer.Option("--segment-table", help="Table of segment masses.")]
Cutoffs = Annotated[str, typer.Option("--cutoffs", help="auto, thesis, spectra, or LOW,HIGH in Hz.")]
Priors = Annotated[
    list[str] | None, typer.Option("--prior", help="For the smoother: ERROR=SIZE, e.g. plate_force_n=5; repeatable.")
]
WithoutLearning = Annotated[
    bool, typer.Option("--no-learn", help="For the smoother: use the given error sizes unchanged.")
]
SegmentMomentum = Annotated[
    bool, typer.Option("--segment-momentum", help="For the smoother: always use the segments' angular momentum.")
]
MeasuredWindow = Annotated[str | None, typer.Option("--window", help="START,END in seconds, inside a measured window.")]
Static = Annotated[Path | None, typer.Option("--static", help="Static trial of the same person.")]
BodyModelFile = Annotated[
    Path | None, typer.Option("--model", help="OpenSim model (.osim) of the joint angles in FILE (.mot or .sto).")
]
ForceFiles = Annotated[
    list[Path] | None,
    typer.Option("--forces", help="Ground forces (.mot, .sto) of FILE, or external loads (.xml); repeatable."),
]
Markers = Annotated[list[str] | None, typer.Option("--marker", help="LANDMARK=LABEL; may be repeated.")]
MarkerSetFile = Annotated[
    Path | None, typer.Option("--marker-set", help="TOML file of a marker set, used instead of the shipped sets.")
]
WithoutPlates = Annotated[list[int] | None, typer.Option("--without-plate", help="Plate index to leave out.")]
BeltSpeeds = Annotated[
    list[str] | None,
    typer.Option("--belt-speed", help="PLATE=M_S: speed of the treadmill belt on a plate; repeatable."),
]
MomentOffsets = Annotated[
    list[str] | None,
    typer.Option("--moment-offset", help="PLATE=X,Y,Z: metres from where a plate's moments refer to; repeatable."),
]

OutFolder = Annotated[Path | None, typer.Option("--out", "-o", help="Folder for the result; must not exist yet.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result in that folder.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON instead of a table.")]
Server = Annotated[str | None, typer.Option("--server", help="Run on this service (http://...) instead.")]
Token = Annotated[str | None, typer.Option("--token", envvar="STRIDELAB_API_TOKEN", help="Its API token.")]


@dataclass(frozen=True, kw_only=True)
class StatedPerson:
    """The given data of the subject of a command's recordings."""

    height_m: Height = None
    mass_kg: Mass = None
    sex: PersonSex = None
    age_years: Age = None

    @property
    def stated(self) -> dict[str, Any]:
        """The given data by the names of ``SubjectFields``."""
        return {one.name: getattr(self, one.name) for one in fields(StatedPerson)}

    def subject_fields(self) -> SubjectFields:
        """The given data. Raises ``InvalidInput`` naming the invalid option."""
        return validate_options(SubjectFields, self.stated)


@dataclass(frozen=True)
class Walk(StatedPerson):
    """A recording and the given data of its subject."""

    file: Trial


@dataclass(frozen=True)
class Walks(StatedPerson):
    """One or several recordings and the given data of their subject."""

    files: Trials

    def to_walks(self, files: Sequence[Path]) -> list[Walk]:
        """One ``Walk`` per file."""
        return [Walk(file, **self.stated) for file in files]


@dataclass(frozen=True)
class Estimation:
    """Options of the estimation, except its method."""

    latency: Latency = "apply"
    segment_table: Segments = "auto"
    cutoffs: Cutoffs = "auto"
    prior: Priors = None
    no_learn: WithoutLearning = False
    segment_momentum: SegmentMomentum = False
    window: MeasuredWindow = None


@dataclass(frozen=True)
class Preparation:
    """Options of the preparation of a recording."""

    static: Static = None
    marker: Markers = None
    without_plate: WithoutPlates = None
    marker_set: MarkerSetFile = None
    belt_speed: BeltSpeeds = None
    moment_offset: MomentOffsets = None
    model: BodyModelFile = None
    forces: ForceFiles = None


@dataclass(frozen=True)
class Delivery:
    """Where the result goes, and whether it is computed here or by the service at ``server``."""

    out_dir: OutFolder = None
    force: Force = False
    as_json: AsJson = False
    server: Server = None
    token: Token = None

    def result_path(self, default_name: str) -> Path:
        """Path of the result: ``--out``, or the default name in the working folder."""
        return self.out_dir or Path(default_name)


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Decorator for typer commands that replaces each option group in the signature by the fields of the group."""
    hints = get_type_hints(command, include_extras=True)
    groups = {name: hint for name, hint in hints.items() if isinstance(hint, type) and is_dataclass(hint)}
    typed: list[Parameter] = []
    for parameter in signature(command).parameters.values():
        group = groups.get(parameter.name)
        if group is None:
            typed.append(parameter.replace(annotation=hints[parameter.name], kind=Parameter.KEYWORD_ONLY))
            continue
        own = get_type_hints(group, include_extras=True)
        for option in fields(group):
            default = Parameter.empty if option.default is MISSING else option.default
            typed.append(Parameter(option.name, Parameter.KEYWORD_ONLY, default=default, annotation=own[option.name]))

    def call_with_groups(**values: Any) -> None:
        for name, group in groups.items():
            values[name] = group(**{option.name: values.pop(option.name) for option in fields(group)})
        command(**values)

    call_with_groups.__name__, call_with_groups.__doc__ = command.__name__, command.__doc__
    call_with_groups.__signature__ = Signature(typed)  # type: ignore[attr-defined]
    return call_with_groups


Input = TypeVar("Input", bound=EstimateComInput)


@dataclass(frozen=True)
class EstimateRequest:
    """Options of ``stridelab estimate``, ``compare``, ``fit-cycloid``, ``imitate``, ``stream``.

    ``steps`` is for the wheel alone, ``more`` holds fields of one job's input alone; None is the default.
    """

    walk: Walk
    method: str | None = None
    estimation: Estimation = field(default_factory=Estimation)
    preparation: Preparation = field(default_factory=Preparation)
    steps: str | None = None
    more: Mapping[str, Any] = field(default_factory=dict)

    @property
    def file(self) -> Path:
        """The recording."""
        return self.walk.file

    @property
    def static(self) -> Path | None:
        """The static trial of the same person, or None."""
        return self.preparation.static

    @cached_property
    def unstated_forces(self) -> Path | None:
        """Forces beside a TRC file for which neither forces nor a body model are given."""
        stated = self.preparation.model is not None or bool(self.preparation.forces)
        return None if stated or self.file.suffix.lower() != TRC else forces_beside(self.file)

    @cached_property
    def files(self) -> tuple[Path, ...]:
        """The files of the recording: itself, its body model and its forces, given or beside a TRC file."""
        more = (self.preparation.model, *(self.preparation.forces or ()), self.unstated_forces)
        return (self.file, *(path for path in more if path is not None))

    @property
    def upload_name(self) -> str:
        """Name of the file that holds the recording: its own, or that of a zip of ``files``."""
        return self.file.name if len(self.files) == 1 else f"{self.file.stem}.zip"

    def write_upload(self, target: Path) -> None:
        """Write the recording as one file: a copy, or a zip of ``files`` if there are several.

        Raises ``InvalidInput`` (``option-invalid``) if two files have the same name.
        """
        names = [path.name for path in self.files]
        if len(set(names)) < len(names):
            fault = Fault("--forces", "the name of each file must differ")
            raise InvalidInput("option-invalid", "Two files of the recording have the same name.", [fault])
        if len(names) == 1:
            shutil.copyfile(self.file, target)
        else:
            pack_trial(self.files, target)

    def subject_fields(self) -> SubjectFields:
        """Given data of the subject. Raises ``InvalidInput`` naming the invalid option."""
        return self.walk.subject_fields()

    def to_input(self, recording_id: str, model: type[Input]) -> Input:
        """Input of a job on this recording. Raises ``InvalidInput`` naming the invalid option."""
        latency, cutoffs, window = self.estimation.latency, self.estimation.cutoffs, self.estimation.window
        fields: dict[str, Any] = {
            "recording_id": recording_id,
            "method": self.method,
            "latency": latency if latency in {"report", "apply"} else parse_numbers("--latency", latency, 1)[0],
            "segment_table": self.estimation.segment_table,
            "cutoffs": cutoffs if cutoffs in {"auto", "thesis", "spectra"} else parse_numbers("--cutoffs", cutoffs, 2),
            "window_s": None if window is None else parse_numbers("--window", window, 2),
        }
        of_some = {"smoother": self._smoother_fields(), "steps": self.steps, **self.more}
        fields |= {name: value for name, value in of_some.items() if value is not None}
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
        from stridelab.recordings.marker_sets import absent_landmarks, labels_by_form, read_marker_set

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
        from stridelab.recordings.marker_sets import read_marker_set

        known = read_marker_set(self.preparation.marker_set)
        return [SourceMarkerSet(name=known.name, landmarks=dict(known.labels), required=list(known.required))]

    def to_source(self, file: str, **fields: Any) -> RecordingSource:
        """Source of the recording, stored as ``file``; ``fields`` are further fields of the source."""
        own_sets = self.marker_sets()
        return RecordingSource(
            file=file,
            filename=self.upload_name,
            marker_map=self.marker_map(),
            plates=self.plate_switches(),
            marker_sets=own_sets,
            shipped_sets=not own_sets,
            **fields,
        )

    def plate_switches(self) -> dict[int, PlateSwitch]:
        """Switches of the excluded plates, the stated belt speeds and the offsets of moments, by plate index.

        Raises ``InvalidInput`` naming the option.
        """
        switches = {index: PlateSwitch(use=False) for index in self.preparation.without_plate or ()}
        switches = with_plate_values(switches, self.preparation.belt_speed, "--belt-speed", "belt_speed_m_s", 1)
        return with_plate_values(switches, self.preparation.moment_offset, "--moment-offset", "moment_offset_m", 3)


def with_plate_values(
    switches: Mapping[int, PlateSwitch], texts: Sequence[str] | None, option: str, field: str, count: int
) -> dict[int, PlateSwitch]:
    """``switches`` with a field set by PLATE=VALUE of an option. Raises ``InvalidInput`` naming the option."""
    changed = dict(switches)
    for text in texts or ():
        plate, value = parse_named_value(option, text)
        if not plate.isdecimal():
            fault = Fault(option, f"got {text!r}")
            example = ",".join(["0.01"] * count)
            raise InvalidInput("option-invalid", f"{option} takes the index of a plate: 1={example}.", [fault])
        before = changed.get(int(plate), PlateSwitch()).model_dump(exclude_none=True)
        numbers = parse_numbers(option, value, count)
        changed[int(plate)] = validate_options(
            PlateSwitch, before | {field: numbers[0] if count == 1 else tuple(numbers)}
        )
    return changed


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
