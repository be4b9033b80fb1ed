"""Options that several commands share, groups of them, and the decorator that lets a command take groups."""

from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import typer

from stridelab.schemas.methods import Method
from stridelab.schemas.plans import NODE_RATE_HZ, Formulation
from stridelab.schemas.recordings import Sex

Lab = Literal["walkway", "two_plates"]
Walker = Literal["human", "talos"]
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

Trial = Annotated[Path, typer.Argument(help="A .c3d, .trc, .tsv or .csv file, or a .zip of markers and forces.")]
Trials = Annotated[
    list[Path],
    typer.Argument(
        help="A .c3d, .trc, or .zip of TRC and MOT; or several, or folders: trials of one person and day are a session."
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
    bool, typer.Option("--segment-momentum", help="For the smoother: use the segments' angular momentum.")
]
MeasuredWindow = Annotated[str | None, typer.Option("--window", help="START,END in seconds, inside a measured window.")]
Static = Annotated[Path | None, typer.Option("--static", help="Static trial of the same person.")]
Markers = Annotated[list[str] | None, typer.Option("--marker", help="LANDMARK=LABEL; may be repeated.")]
MarkerSetFile = Annotated[
    Path | None, typer.Option("--marker-set", help="TOML file of a marker set, used instead of the shipped sets.")
]
WithoutPlates = Annotated[list[int] | None, typer.Option("--without-plate", help="Plate index to leave out.")]

OutFolder = Annotated[Path | None, typer.Option("--out", help="Folder for the result; must not exist yet.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result in that folder.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON instead of a table.")]
Server = Annotated[str | None, typer.Option("--server", help="Run on this service (http://...) instead.")]
Token = Annotated[str | None, typer.Option("--token", envvar="STRIDELAB_API_TOKEN", help="Its API token.")]


@dataclass(frozen=True)
class Walk:
    """A recording and the given data of its subject."""

    file: Trial
    height_m: Height = None
    mass_kg: Mass = None
    sex: PersonSex = None
    age_years: Age = None


@dataclass(frozen=True)
class Walks:
    """One or several recordings and the given data of their subject."""

    files: Trials
    height_m: Height = None
    mass_kg: Mass = None
    sex: PersonSex = None
    age_years: Age = None

    def to_walks(self, files: Sequence[Path]) -> list[Walk]:
        """One ``Walk`` per file."""
        return [Walk(file, self.height_m, self.mass_kg, self.sex, self.age_years) for file in files]


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
        for field in fields(group):
            default = Parameter.empty if field.default is MISSING else field.default
            typed.append(Parameter(field.name, Parameter.KEYWORD_ONLY, default=default, annotation=own[field.name]))

    def call_with_groups(**values: Any) -> None:
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        command(**values)

    call_with_groups.__name__, call_with_groups.__doc__ = command.__name__, command.__doc__
    call_with_groups.__signature__ = Signature(typed)  # type: ignore[attr-defined]
    return call_with_groups
