"""The command ``stridelab fit-cycloid`` as it is typed; what it does is in ``cli_cycloid``."""

from typing import Annotated, Literal

import typer

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
    WithoutLearning,
    WithoutPlates,
)
from stridelab.schemas.methods import Method


def fit_cycloid(
    file: Trial,
    height_m: Height = None,
    mass_kg: Mass = None,
    sex: PersonSex = None,
    age_years: Age = None,
    steps: Annotated[
        Literal["measured", "all"], typer.Option("--steps", help="Steps with all force measured, or all.")
    ] = "measured",
    method: Annotated[
        Method | None, typer.Option("--method", help="Estimator; the best that exists if omitted.")
    ] = None,
    latency: Latency = "apply",
    segment_table: Segments = "auto",
    cutoffs: Cutoffs = "auto",
    prior: Priors = None,
    no_learn: WithoutLearning = False,
    segment_momentum: SegmentMomentum = False,
    window: Measured = None,
    static: Static = None,
    marker: Markers = None,
    without_plate: WithoutPlates = None,
    out_dir: OutFolder = None,
    force: Force = False,
    as_json: AsJson = False,
    server: Server = None,
    token: Token = None,
) -> None:
    """Fit the rolling wheel to every step of one recording; needs no server."""
    from stridelab.cli_cycloid import fit as run
    from stridelab.cli_estimate import EstimateRequest

    request = EstimateRequest(
        file=file,
        height_m=height_m,
        mass_kg=mass_kg,
        sex=sex,
        age_years=age_years,
        method=method,
        latency=latency,
        segment_table=segment_table,
        cutoffs=cutoffs,
        priors=tuple(prior or ()),
        learn=not no_learn,
        segment_momentum=segment_momentum,
        window=window,
        static=static,
        markers=tuple(marker or ()),
        without_plates=tuple(without_plate or ()),
        steps=steps,
    )
    run(request, out_dir=out_dir, force=force, as_json=as_json, server=server, token=token)
