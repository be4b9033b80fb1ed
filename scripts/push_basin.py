"""Pushes a scenario's motion in physics and says what is survived."""

import csv
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

import stridelab as sl
from stridelab.errors import StridelabError

out, log = Console(highlight=False), Console(stderr=True, highlight=False)


def main(
    scenario: Annotated[str, typer.Argument(help="A bundled scenario or a JSON file.")] = "long-stride",
    speed: Annotated[float, typer.Option(help="Change of the CoM's velocity by a push, m/s.")] = 0.2,
    pushes: Annotated[int, typer.Option(help="Number of pushes.")] = 50,
    seed: Annotated[int, typer.Option(help="Of times and directions.")] = 0,
    robot: Annotated[str | None, typer.Option(help="In place of that of the scenario.")] = None,
    csv_file: Annotated[Path | None, typer.Option("--out", help="Write a row per push into this CSV file.")] = None,
) -> None:
    """Replay a motion with one random push at a time."""
    try:
        basin = sl.push_basin(scenario, speed_m_s=speed, n=pushes, seed=seed, robot=robot, progress=show)
    except StridelabError as error:
        sys.exit(f"error: {error.message} ({error.code})")
    s, (low, high) = basin.summary, basin.summary.survived_ci95
    impulse = f"{s.speed_m_s:g} m/s ({s.impulse_ns:.1f} N s)"
    out.print(f"{s.scenario_name}, {s.robot}: {s.n} pushes of {impulse}, seed {s.seed}")
    out.print(f"survived {s.survived} ({low:.0%} to {high:.0%}), completed {s.completed}")
    out.print(f"proved lost {s.proved_lost}, unexplained {s.unexplained}")
    for remark in s.warnings:
        out.print(f"{remark.code}: {remark.message}")
    if csv_file is not None:
        with csv_file.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(basin.columns)
            rows.writerows(zip(*basin.columns.values(), strict=True))


def show(_fraction: float, message: str) -> None:
    """Print the progress of the pushes."""
    if message.startswith("pushes"):
        log.print(message)


if __name__ == "__main__":
    typer.run(main)
