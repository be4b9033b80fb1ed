"""The command ``stridelab study-population`` as it is typed; what it does is in ``cli_population``."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from stridelab.schemas.methods import Method


def study_population(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings (.c3d, or .zip of TRC and MOT), folders of them, or zips of them.")
    ],
    subjects: Annotated[
        Path | None, typer.Option("--subjects", help="CSV: file, subject, group, height_m, mass_kg, sex, age, static.")
    ] = None,
    method: Annotated[
        Method | None, typer.Option("--method", help="Estimator; the best that exists if omitted.")
    ] = None,
    steps: Annotated[
        Literal["measured", "all"], typer.Option("--steps", help="Steps with all force measured, or all.")
    ] = "measured",
    pooled: Annotated[bool, typer.Option("--pooled", help="Also look at everybody together.")] = False,
    seed: Annotated[int, typer.Option("--seed", help="Of the bootstrap intervals.")] = 0,
    out_dir: Annotated[Path | None, typer.Option("--out", help="Folder for the result; must not exist yet.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result in that folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON instead of tables.")] = False,
    server: Annotated[str | None, typer.Option("--server", help="Run on this service (http://...) instead.")] = None,
    token: Annotated[str | None, typer.Option("--token", envvar="STRIDELAB_API_TOKEN", help="Its API token.")] = None,
) -> None:
    """Fit the wheels of many people, and correlate them with height, leg, speed and step length."""
    from stridelab.cli_population import study

    study(
        files,
        subjects=subjects,
        options={"method": method, "steps": steps, "pooled": pooled, "seed": seed},
        out_dir=out_dir,
        force=force,
        as_json=as_json,
        server=server,
        token=token,
    )
