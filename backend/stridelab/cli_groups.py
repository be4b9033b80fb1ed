"""Groups of options that several commands take whole, and the decorator that lets a command take them."""

from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Any, get_type_hints

from stridelab.cli_options import (
    Age,
    AsJson,
    Cutoffs,
    Force,
    Height,
    Latency,
    Markers,
    Mass,
    Measured,
    OutFolder,
    PersonSex,
    Priors,
    SegmentMomentum,
    Segments,
    Server,
    Static,
    Token,
    Trial,
    Trials,
    WithoutLearning,
    WithoutPlates,
)


@dataclass(frozen=True)
class Walk:
    """A recording, and what is stated of the person in it."""

    file: Trial
    height_m: Height = None
    mass_kg: Mass = None
    sex: PersonSex = None
    age_years: Age = None


@dataclass(frozen=True)
class Walks:
    """One recording or several, and what is stated of the person in them."""

    files: Trials
    height_m: Height = None
    mass_kg: Mass = None
    sex: PersonSex = None
    age_years: Age = None

    def each(self, files: Sequence[Path]) -> list[Walk]:
        """A recording each."""
        return [Walk(file, self.height_m, self.mass_kg, self.sex, self.age_years) for file in files]


@dataclass(frozen=True)
class Estimation:
    """How the centre of mass is estimated, the method apart."""

    latency: Latency = "apply"
    segment_table: Segments = "auto"
    cutoffs: Cutoffs = "auto"
    prior: Priors = None
    no_learn: WithoutLearning = False
    segment_momentum: SegmentMomentum = False
    window: Measured = None


@dataclass(frozen=True)
class Preparation:
    """What is done to a recording before anything is computed from it."""

    static: Static = None
    marker: Markers = None
    without_plate: WithoutPlates = None


@dataclass(frozen=True)
class Delivery:
    """Where the result goes, and which machine computes it: this one, or that of the service at ``server``."""

    out_dir: OutFolder = None
    force: Force = False
    as_json: AsJson = False
    server: Server = None
    token: Token = None

    def folder(self, usual: str) -> Path:
        """Where the result goes: ``usual`` in the working folder unless something else was asked for."""
        return self.out_dir or Path(usual)


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """``command`` as typer reads it: every parameter that is a group stands as the group's fields, in its place."""
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

    def call(**values: Any) -> None:
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        command(**values)

    call.__name__, call.__doc__ = command.__name__, command.__doc__
    call.__signature__ = Signature(typed)  # type: ignore[attr-defined]
    return call
