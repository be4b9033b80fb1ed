"""The command ``stridelab study-population`` as it is typed; what it does is in ``cli_population``."""

from pathlib import Path
from typing import Annotated

import typer

from stridelab.cli_groups import Delivery
from stridelab.cli_options import BestMethod, Force, OutFolder, Server, StepChoice, Token


def study_population(
    files: Annotated[
        list[Path],
        typer.Argument(help="Recordings (.c3d, .trc, or .zip of TRC and MOT), folders of them, or zips of them."),
    ],
    subjects: Annotated[
        Path | None, typer.Option("--subjects", help="CSV: file, subject, group, height_m, mass_kg, sex, age, static.")
    ] = None,
    method: BestMethod = None,
    steps: StepChoice = "measured",
    pooled: Annotated[bool, typer.Option("--pooled", help="Also look at everybody together.")] = False,
    seed: Annotated[int, typer.Option("--seed", help="Of the bootstrap intervals.")] = 0,
    out_dir: OutFolder = None,
    force: Force = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON instead of tables.")] = False,
    server: Server = None,
    token: Token = None,
) -> None:
    """Fit the wheels of many people, and correlate them with height, leg, speed and step length."""
    from stridelab.cli_population import study

    study(
        files,
        subjects=subjects,
        options={"method": method, "steps": steps, "pooled": pooled, "seed": seed},
        delivery=Delivery(out_dir, force, as_json, server, token),
    )
